"""Events of one fault that come and go with either sign: told as one finding, which no declared
fault makes by itself.

A loose base, a gear that chatters or a contact that opens shakes what a declared fault would move,
and each half of the motion has that fault's name. Told one by one they would be a list of events;
together they say that the cause is another one.
"""

from collections.abc import Sequence
from itertools import pairwise

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.posterior.events import BankEvent
from faultgauge.detection.words import UNDECLARED, between, moment
from faultgauge.reporting.words.reliance import headed
from faultgauge.reporting.words.telling import Told, unit_of
from faultgauge.telemetry.clock import Clock

__all__ = ["together", "turns"]

TURNS = 4  # of a fault's sign: nobody repairs and breaks a thing so often


def turns(events: Sequence[BankEvent]) -> dict[str, list[BankEvent]]:
    """The events, in the order of time, of each fault whose sign turns `TURNS` times or more."""
    sized = dict[str, list[BankEvent]]()
    for each in sorted(events, key=lambda event: event.start):
        if each.size:
            sized.setdefault(each.fault, []).append(each)
    return {
        fault: own
        for fault, own in sized.items()
        if sum((a.size or 0) * (b.size or 0) < 0 for a, b in pairwise(own)) >= TURNS
    }


def together(bank: FaultBank, own: Sequence[BankEvent], clock: Clock | None) -> Told:
    """One sentence for all events of such a fault; the largest stands for them where one is asked
    for."""
    sizes = [each.size or 0.0 for each in own]
    first, last = (moment(clock, t, bank.step) for t in (own[0].start, own[-1].end))
    largest = max(own, key=lambda each: abs(each.size or 0.0))
    by = between(min(sizes), max(sizes), unit_of(bank.model, largest.fault))
    head = (
        f"{largest.fault} came and went {len(own)} times from {first} to {last} with either sign, "
        f"{by} (run {largest.run}): no fault that stays does that, and {UNDECLARED} may shake what "
        f"{largest.fault} would move"
    )
    return Told(
        own[0].start, own[-1].end, headed(bank.model, head), brief=largest.fault, event=largest
    )
