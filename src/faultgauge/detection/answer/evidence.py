"""The evidence of an event: the shortest part of its run over which the bank gives the same answer.

The part ends where the event's size was read, and begins before its onset, twice as early each
time until a replay names the same fault, with a size and an onset inside the intervals of the
first answer; at worst at the start of the run.
"""

from dataclasses import dataclass

import numpy as np

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision, decide
from faultgauge.detection.posterior.events import BankEvent
from faultgauge.telemetry import Run, cut

__all__ = ["MOST_SHOWN", "Evidence", "evidence", "same"]

MOST_SHOWN = 6  # windows in a report, which is read, not scrolled


@dataclass(frozen=True)
class Evidence:
    """The samples `part` of the judged run, and what the bank says of them alone: `replayed`, or
    None where not even the whole run up to there gives the same answer."""

    event: BankEvent
    decision: Decision
    part: slice
    replayed: BankEvent | None

    @property
    def run(self) -> Run:
        """The window alone."""
        return cut(self.decision.run, self.part)


def evidence(bank: FaultBank, decision: Decision, event: BankEvent) -> Evidence:
    """The evidence window of `event`."""
    t = decision.run.t
    stop = int(np.searchsorted(t, event.end, "right"))
    onset = int(np.searchsorted(t, event.onset_lo))
    before = max(100, (stop - onset) // 4)
    while True:
        part = slice(max(onset - before, 0), stop)
        run = cut(decision.run, part)
        again = [e for e in decide(bank, run, None).events if same(bank, event, e)]
        if again or part.start == 0:
            return Evidence(event, decision, part, again[-1] if again else None)
        before *= 2


def same(bank: FaultBank, first: BankEvent, second: BankEvent) -> bool:
    """Whether two events are the same answer: the same fault, intervals of size and onset that
    hold each other's values."""
    if first.fault != second.fault:
        return False
    room = bank.step
    begun = first.onset_lo - room <= second.onset <= first.onset_hi + room
    if first.size is None or first.lo is None or first.hi is None:
        return begun
    return begun and second.size is not None and first.lo <= second.size <= first.hi
