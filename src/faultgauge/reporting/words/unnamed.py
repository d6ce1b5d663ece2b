"""The sentences of alarms without a name, of what is beside events without one, and of what a log
ends undecided about."""

from collections.abc import Sequence

import numpy as np

from faultgauge.detection.answer.shares import WHOLE, shares_of
from faultgauge.detection.answer.unnamed import unnamed_alarms
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.events import Cause, Unnamed
from faultgauge.detection.posterior.posterior import LIKELY
from faultgauge.detection.posterior.verdicts import NOT_JUDGED, PLAIN, Reason
from faultgauge.detection.words import UNDECLARED, duration, moment
from faultgauge.plants.model import Model
from faultgauge.reporting.words.probability import probability
from faultgauge.reporting.words.reliance import headed
from faultgauge.reporting.words.telling import Told, row_time, unit_of
from faultgauge.telemetry.clock import Clock

__all__ = ["alarm_sentence", "alarms", "unnamed"]

ALONE = 3  # alarms that nothing explains, that are told one by one


def unnamed(bank: FaultBank, decision: Decision) -> list[Told]:
    """Alarms without an event, and what the log ends undecided about."""
    judged = shares_of(decision).judged
    note = "" if judged >= WHOLE else f", of which {100 * judged:.0f} % could be judged"
    return [*alarms(bank, decision, note), *_undecided(bank, decision, note)]


def alarms(bank: FaultBank, decision: Decision, note: str = "") -> list[Told]:
    """Alarms without an event, with a `note` on the run; those that no declared fault explains
    together where there are many: what is undeclared often comes and goes."""
    found = unnamed_alarms(bank, decision)
    unexplained = [each for each in found if each.reason == PLAIN[Reason.UNDECLARED]]
    many = unexplained if len(unexplained) > ALONE else []
    told = [
        Told(
            each.start,
            each.end,
            alarm_sentence(
                bank.model, each, bank.step, decision.run.clock, note, float(decision.run.t[-1])
            ),
            causes=tuple(cause.name for cause in each.causes),
            brief="one more fault" if each.beside else "an alarm",
        )
        for each in found
        if each not in many
    ]
    together = _together(bank, many, decision.run.clock, note)
    return sorted([*told, *together], key=lambda each: each.start)


def _together(
    bank: FaultBank, many: Sequence[Unnamed], clock: Clock | None, note: str
) -> list[Told]:
    """One sentence of all alarms that no declared fault explains; none of none."""
    if not many:
        return []
    begun, ended = many[0].start, max(each.end for each in many)
    first, last = (moment(clock, t, bank.step) for t in (begun, ended))
    lasting = duration(sum(each.end - each.start for each in many))
    head = (
        f"{len(many)} alarms from {first} to {last} (run {many[0].run}{note}), {lasting} in all; "
        "no declared fault explains them"
    )
    return [Told(begun, ended, headed(bank.model, head), brief=f"{len(many)} alarms")]


def alarm_sentence(
    model: Model,
    alarm: Unnamed,
    step: float,
    clock: Clock | None,
    note: str = "",
    ends: float = np.inf,
) -> str:
    """From when to when, of rows that are `step` [s] apart, and why it has no event; with a `note`
    on the run, which `ends` [s]."""
    first, last = (moment(clock, t, step) for t in (alarm.start, alarm.end))
    over = ", the end of the log" if alarm.end >= ends else ""
    when = f"from {first} to {last}{over} (run {alarm.run}{note})"
    if alarm.beside:
        told = " and ".join(alarm.beside)
        causes = " or ".join(_likely(model, each) for each in alarm.causes)
        which = ":" if len(alarm.causes) != 1 else ", the likeliest being"
        return headed(model, f"One more fault than {told} {when}, not sure which{which} {causes}")
    return headed(model, f"An alarm {when}; {_why(model, alarm)}")


def _why(model: Model, alarm: Unnamed) -> str:
    if alarm.again:
        return f"it is not clear whether {alarm.named}, told before, was over"
    if alarm.named:
        return f"{alarm.named}, named there, was given up"
    return alarm.reason + " or ".join(_likely(model, each) for each in alarm.causes)


def _likely(model: Model, cause: Cause) -> str:
    """ "leak of +0.1 m/s (p 0.6)"."""
    of = ""
    if cause.size is not None:
        of = f" of {cause.size:+.3g} {unit_of(model, cause.name)}".rstrip()
    return f"{cause.name}{of} (p {probability(cause.p)})"


def _undecided(bank: FaultBank, decision: Decision, note: str) -> list[Told]:
    """What stands at the end of a log, without an alarm: likelier than not, and not sure."""
    run, found = decision.run, decision.posterior
    sampled = np.flatnonzero(np.isfinite(found.healthy))
    if not len(sampled) or decision.status[sampled[-1]] != NOT_JUDGED:
        return []
    if not found.healthy[sampled[-1]] < LIKELY:
        return []
    certain = sampled[found.healthy[sampled] >= LIKELY]
    first = int(certain[-1]) + 1 if len(certain) else int(sampled[0])
    shares = dict(zip(bank.model.plant.signals.fault_names, found.p[sampled[-1]], strict=True))
    shares[UNDECLARED] = found.unknown[sampled[-1]]
    cause = max(shares, key=lambda name: np.nan_to_num(shares[name]))
    size = ""
    if cause != UNDECLARED:
        k = bank.model.plant.signals.fault_names.index(cause)
        there = found.f[sampled[-1], k] / max(found.p[sampled[-1], k], 1e-300)
        size = f", {there:+.3g} {unit_of(bank.model, cause)}".rstrip() + " if it is there"
    begun = row_time(bank, decision, float(run.t[first]))
    text = (
        f"Undecided from {begun} to the end of the log (run {run.name}{note}); the likeliest cause "
        f"is {cause}{size} (p {probability(float(shares[cause]))}); that nothing is wrong has p "
        f"{probability(float(found.healthy[sampled[-1]]))}"
    )
    last = float(run.t[sampled[-1]])
    return [Told(float(run.t[first]), last, headed(bank.model, text), brief="undecided")]
