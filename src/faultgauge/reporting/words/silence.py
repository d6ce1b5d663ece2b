"""What it means that nothing is told of a run: no fault, what could not be judged, and why."""

from collections.abc import Sequence

import numpy as np

from faultgauge.detection.answer.least import least_told
from faultgauge.detection.answer.shares import WHOLE, Shares, Silent, shares_of
from faultgauge.detection.answer.unnamed import unnamed_alarms
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.events import POSSIBLE
from faultgauge.detection.posterior.uncalibrated import level_in, uncalibrated
from faultgauge.detection.words import listed, number
from faultgauge.reporting.words.probability import probability
from faultgauge.reporting.words.reliance import headed
from faultgauge.reporting.words.telling import row_time, would_not_show_in

__all__ = ["hidden", "runs_said", "silence", "why_silent"]

SPOKEN = 3  # silent stretches that a sentence names, or reasons of more of them
LITTLE = 0.005  # of a log: what would be said as 0 %
SELDOM = 0.5  # of the rows: of a fault that shows in fewer, that is said


def silence(bank: FaultBank, silent: Sequence[Decision], runs: int) -> list[str]:
    """What it means that nothing is told of the `silent` ones of so many `runs`."""
    shares = {one.run.name: shares_of(one) for one in silent}
    whole = [one for one in silent if shares[one.run.name].judged >= WHOLE]
    said = []
    alone = runs == 1
    if whole:
        where = "" if len(whole) == runs else f" in {_runs(whole)}"
        seldom = _seldom(bank, [shares[one.run.name] for one in whole])
        small = would_not_show_in(bank, whole)
        text = f"No fault{where}; {small}{seldom}{_at_the_end(bank, whole)}"
        said.append(headed(bank.model, text))
    for one in silent:
        judged, _, gaps = shares[one.run.name]
        log = "log" if alone else f"run {one.run.name}"
        if judged >= WHOLE:
            continue
        why = why_silent(bank, one, gaps)
        if judged == 0:
            of = "" if alone else f" of {log}"
            said.append(f"Nothing{of} could be judged: {why}{_wide(bank)}")
            continue
        text = (
            f"No fault in the {100 * judged:.0f} % of the {log} that could be judged; not judged "
            f"{why}; {would_not_show_in(bank, [one])} there{_at_the_end(bank, [one])}"
        )
        said.append(headed(bank.model, text))
    return said


def _at_the_end(bank: FaultBank, silent: Sequence[Decision]) -> str:
    """What may be there where a log ends, as likely as what is told beside another fault."""
    said = []
    for one in silent:
        sampled = np.flatnonzero(np.isfinite(one.posterior.healthy))
        if not len(sampled):
            continue
        p = np.nan_to_num(one.posterior.p[sampled[-1]]).tolist()
        names = zip(bank.model.plant.signals.fault_names, p, strict=True)
        there = [f"{name} (p {probability(each)})" for name, each in names if each > POSSIBLE]
        where = "the log" if len(silent) == 1 else f"run {one.run.name}"
        if there:
            said.append(f"; at the end of {where} there may be {listed(there)}")
    return "".join(said)


def hidden(bank: FaultBank, speaking: Sequence[Decision], runs: int) -> list[str]:
    """Of the `speaking` ones of so many `runs`, which faults would not have shown in any: what is
    told there says nothing of them."""
    if not speaking:
        return []
    told = {each.fault for one in speaking for each in one.events}
    # what an alarm without a name may be did show
    alarms = [alarm for one in speaking for alarm in unnamed_alarms(bank, one)]
    told |= {cause.name for alarm in alarms for cause in alarm.causes}
    names = [
        name
        for k, name in enumerate(bank.model.plant.signals.fault_names)
        if name not in told and all(least_told(bank, one, k) is None for one in speaking)
    ]
    where = "this log" if runs == 1 else _runs(speaking)
    if not names:
        return []
    return [headed(bank.model, f"{would_not_show_in(bank, speaking, names)} in {where}")]


def _seldom(bank: FaultBank, found: Sequence[Shares]) -> str:
    """Which faults show in few rows only."""
    shares = np.mean([each.faults for each in found], axis=0).tolist()
    names = zip(bank.model.plant.signals.fault_names, shares, strict=True)
    rare = [f"{name} ({100 * share:.0f} %)" for name, share in names if 0 < share < SELDOM]
    return f"; few rows could have shown {listed(rare)}" if rare else ""


def why_silent(bank: FaultBank, one: Decision, gaps: Sequence[Silent]) -> str:
    """When and why not, of few stretches; of many which share for what reason."""
    if len(gaps) <= SPOKEN:
        return listed([_part(bank, one, each) for each in gaps])
    shares = dict[str, float]()
    for each in gaps:
        reason = each.reason.partition("; ")[0]  # without what the columns were there
        shares[reason] = shares.get(reason, 0.0) + each.share
    largest = sorted(shares.items(), key=lambda each: -each[1])[:SPOKEN]
    parts = [f"{100 * share:.0f} % ({reason})" for reason, share in largest if share >= LITTLE]
    rest = sum(shares.values()) - sum(share for _, share in largest)
    return listed([*parts, "the rest for other reasons"] if rest >= LITTLE else parts)


def _wide(bank: FaultBank) -> str:
    """Why a calibration may leave nothing that shows."""
    if uncalibrated(bank.model) or level_in(bank.model).widened <= 1:
        return ""
    times = number(level_in(bank.model).widened, 2)
    return (
        "; by the healthy logs the model errs more than its noise covers, and a fault must be "
        f"{times} times as large to be told"
    )


def _part(bank: FaultBank, one: Decision, part: Silent) -> str:
    first, last = (row_time(bank, one, t) for t in (part.start, part.end))
    return f"from {first} to {last} ({part.reason})"


def runs_said(names: Sequence[str]) -> str:
    """ "run a", "runs a, b and c"."""
    return f"run{'s' * (len(names) > 1)} {listed(names)}"


def _runs(decisions: Sequence[Decision]) -> str:
    return runs_said([one.run.name for one in decisions])
