"""What the posterior means: a status with its reason, an alarm, and the faults that are named.

An alarm begins where the log-odds of an active fault, ln (1 - p0) / p0 with p0 the probability that
there is none, reach the calibrated level, where the model is trusted and outside the hold-off, and
have done so for `persistence`. It ends where the probability falls
below `release`. A fault is named while there is an alarm and its own probability has been 0.98 for
`persistence`, and for a quarter of the bank's memory at least, from when on its sign is known:
while one fault follows another, a third may fit for a while. A passive fault is named without an
alarm.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.envelope import bounds_of
from faultgauge.detection.flat_line import standing_still
from faultgauge.detection.limit_checker import LimitChecker
from faultgauge.detection.posterior import Posterior
from faultgauge.telemetry import Run

__all__ = [
    "FAULT",
    "HEALTHY",
    "NAMED",
    "NOT_JUDGED",
    "QUIET",
    "STALE",
    "Verdict",
    "Verdicts",
    "log_odds",
]

HEALTHY, FAULT, NOT_JUDGED, STALE = "HEALTHY", "FAULT", "NOT_JUDGED", "STALE"
QUIET = 0.5  # p of no fault above: nothing speaks of one
NAMED = 0.98  # p of a fault from which on it is named
UNDECIDED = "undecided whether there is a fault"
FRESH = 10.0  # samples without any output after which the answer is stale


class Verdict(NamedTuple):
    """Of every sample; `named` are the declared faults and, last, an undeclared one."""

    status: list[str]
    reason: list[str]
    alarm: Bool[np.ndarray, "samples"]
    named: Bool[np.ndarray, "samples causes"]


def log_odds(calm: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "samples"]:
    """ln (1 - p0) / p0; -inf where nothing was sampled."""
    p0 = np.where(np.isfinite(calm), np.clip(calm, 1e-300, 1.0), 1.0)
    with np.errstate(divide="ignore"):
        return np.log1p(-p0) - np.log(p0)


class Verdicts:
    """Judges a run, all its samples at once or a few at a time."""

    def __init__(self, bank: FaultBank) -> None:
        self.bank = bank
        rules = bank.model.plant.signals.detection
        count = len(bank.model.plant.signals.faults) + 1

        wait = max(rules.persistence, bank.wait)
        self.release = rules.release
        self.alarm = LimitChecker(rules.persistence, rules.latch)
        self.names = [LimitChecker(wait, rules.latch) for _ in range(count)]
        self.signs = [LimitChecker(0.0, rules.latch) for _ in range(count)]
        self.passive = np.append(bank.with_monitor("passive"), False)
        self.fresh: float | None = None  # time of the last sampled output

    def judge(self, run: Run, found: Posterior, standing: Sequence[str]) -> Verdict:
        """The next samples, `run`, with what the bank says about them, and the output of each that
        stands on one value ("": none)."""
        sampled = np.isfinite(found.healthy)
        free = sampled & ~found.held
        alarm = self._alarm(run.t, found, free)
        named = self._named(run.t, found, free, alarm)
        age = self._age(run)
        old = age > FRESH * self.bank.step
        quiet, calm = np.asarray(found.healthy > QUIET), np.asarray(found.calm > QUIET)
        disabled = self.bank.with_monitor("disabled")
        shown = np.any(found.seen[:, ~disabled], axis=2)
        clear, blind = np.any(shown, axis=1), ~np.all(shown, axis=1)
        status, reason = [], []
        for k in range(len(run.t)):
            if not sampled[k]:
                answer = NOT_JUDGED, "not sampled"
            elif standing[k] and (age[k] > 0 or not alarm[k]):
                answer = NOT_JUDGED, standing_still(standing[k])
            elif old[k]:
                answer = STALE, "no output was sampled for a while"
            elif found.held[k]:
                answer = NOT_JUDGED, "held off after a start or a gap"
            elif alarm[k]:
                answer = FAULT, self._cause(found, named, k)
            elif not found.inside[k]:
                answer = NOT_JUDGED, self._where(int(found.outside[k]))
            elif not quiet[k]:
                answer = NOT_JUDGED, self._small(found, k) if calm[k] else UNDECIDED
            elif not clear[k]:
                answer = NOT_JUDGED, _blind(self.bank, run, found, k)
            else:
                answer = HEALTHY, _blind(self.bank, run, found, k) if blind[k] else ""
            status.append(answer[0])
            reason.append(answer[1])
        return Verdict(status, reason, alarm, named)

    def _alarm(
        self,
        t: Float[np.ndarray, "samples"],
        found: Posterior,
        free: Bool[np.ndarray, "samples"],
    ) -> Bool[np.ndarray, "samples"]:
        over = free & found.inside & (log_odds(found.calm) >= self.bank.level)
        under = free & np.asarray(1 - found.calm < self.release)
        return self.alarm.judge(t, over, under)

    def _named(
        self,
        t: Float[np.ndarray, "samples"],
        found: Posterior,
        free: Bool[np.ndarray, "samples"],
        alarm: Bool[np.ndarray, "samples"],
    ) -> Bool[np.ndarray, "samples causes"]:
        p = np.concatenate([found.p, found.unknown[:, None]], axis=1)
        alone = found.inside & (log_odds(found.healthy) >= self.bank.level)
        signed = np.ones(p.shape, bool)
        signed[:, :-1] = ~((found.lo < 0) & (found.hi > 0))
        columns = []
        for k, checker in enumerate(self.names):
            may = free & (alone if self.passive[k] else alarm)
            over = may & np.asarray(p[:, k] >= NAMED)
            gone = np.asarray(p[:, k] < self.release) | (~alarm & ~self.passive[k])
            likely = checker.judge(t, over, free & gone)
            columns.append(self.signs[k].judge(t, likely & signed[:, k], ~likely))
        return np.stack(columns, axis=1)

    def _age(self, run: Run) -> Float[np.ndarray, "samples"]:
        """Seconds since any output was sampled."""
        any_output = np.any([np.isfinite(run.columns[n]) for n in self.bank.outputs], axis=0)
        if self.fresh is None:
            self.fresh = float(run.t[0])
        last = np.maximum.accumulate(np.where(any_output, run.t, self.fresh))
        self.fresh = float(last[-1])
        return run.t - last

    def _cause(self, found: Posterior, named: Bool[np.ndarray, "samples causes"], k: int) -> str:
        if found.unknown[k] >= QUIET:
            return "no declared fault explains it"
        if named[k, :-1].any():
            return ""
        names = self.bank.model.plant.signals.fault_names
        p = np.nan_to_num(found.p[k])
        shares = {"something undeclared": found.unknown[k], **dict(zip(names, p, strict=True))}
        likely = sorted(shares, key=lambda name: -shares[name])[:2]
        return f"cause undecided: {' or '.join(likely)}"

    def _where(self, outside: int) -> str:
        """What is not trusted."""
        regions = self.bank.regions
        if outside <= len(regions):
            return f"outside of what training covered of {regions[outside - 1].name}"
        name, _, _, low, high = bounds_of(self.bank.model)[outside - 1 - len(regions)]
        return f"{name} is outside of its trusted range, {low:g} to {high:g}"

    def _small(self, found: Posterior, k: int) -> str:
        """Why what is there raises no alarm."""
        likely = int(np.argmax(np.nan_to_num(found.p[k])))
        name = self.bank.model.plant.signals.fault_names[likely]
        if self.passive[likely]:
            return f"{name}, which is passive"
        return f"{name} is possible, but not certain enough for an alarm"


def _blind(bank: FaultBank, run: Run, found: Posterior, k: int) -> str:
    """Why a fault would not show."""
    signals = bank.model.plant.signals
    hidden = ~found.seen[k].any(axis=1) & ~bank.with_monitor("disabled")
    fault = signals.faults[int(np.argmax(hidden))]
    if fault.enters in ("input", "gain"):
        target = signals.inputs[signals.input_names.index(fault.target)]
        value = run.columns[target.name][k]
        room = 1e-6 * max(abs(target.min), abs(target.max)) if np.isfinite(value) else 0.0
        if fault.enters == "input" and (value <= target.min + room or value >= target.max - room):
            return f"{fault.name} would not show: {target.name} is at its limit"
        if fault.enters == "gain":
            return f"{fault.name} would not show: {target.name} does not excite it"
    return f"{fault.name} would not show yet, after a start, a gap or in these data"
