"""From the modes of the bank to probabilities, estimates, intervals and a status.

Every figure is of the one mixture over all modes: `p_<fault>` sums the modes that hold it, the
estimate is the mean (0 where the fault is absent), and the interval its 2.5 % and 97.5 %
quantiles, where an undeclared fault leaves each fault as uncertain as its prior.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr

from faultgauge.detection.bank import FaultBank, Rows
from faultgauge.plants.signals import Fault
from faultgauge.telemetry import Run

__all__ = [
    "FAULT",
    "HEALTHY",
    "NAMED",
    "NOT_JUDGED",
    "STALE",
    "Posterior",
    "marginals",
    "mixture_quantiles",
    "posterior_of",
    "statuses",
]

HEALTHY, FAULT, NOT_JUDGED, STALE = "HEALTHY", "FAULT", "NOT_JUDGED", "STALE"
ALARM = 0.05  # p_healthy at or below: a fault
QUIET = 0.5  # p_healthy above: nothing speaks of a fault
NAMED = 0.95  # p of a fault from which on it is named
TAIL = 0.025
WIDE = 1.959964  # standard deviations on either side of a 95 % interval
HALVINGS = 36
LIGHT = 1e-4  # weight below which a part of a mixture moves no 2.5 % quantile
FRESH = 10.0  # samples without any output after which the answer is stale


@dataclass(frozen=True)
class Posterior:
    """Columns of one run, NaN where nothing was sampled; faults in the plant's order.

    `x` is the posterior mean of [states, drifting parameters].
    """

    p: Float[np.ndarray, "samples faults"]
    f: Float[np.ndarray, "samples faults"]
    lo: Float[np.ndarray, "samples faults"]
    hi: Float[np.ndarray, "samples faults"]
    healthy: Float[np.ndarray, "samples"]
    unknown: Float[np.ndarray, "samples"]
    seen: Bool[np.ndarray, "samples faults two"]
    inside: Bool[np.ndarray, "samples"]
    x: Float[np.ndarray, "samples kept"]


def members(bank: FaultBank, fault: int) -> tuple[list[int], list[int]]:
    """(modes that hold the fault, the slot it has in each)."""
    found = [(m, each.index(fault)) for m, each in enumerate(bank.sets) if fault in each]
    return [m for m, _ in found], [slot for _, slot in found]


def marginals(
    bank: FaultBank, p: Float[np.ndarray, "samples modes"]
) -> Float[np.ndarray, "samples faults"]:
    """p of every fault, alone or with others."""
    faults = range(len(bank.model.plant.signals.faults))
    return np.stack([p[:, members(bank, k)[0]].sum(axis=1) for k in faults], axis=1)


def mixture_quantiles(
    weight: Float[np.ndarray, "samples parts"],
    mean: Float[np.ndarray, "samples parts"],
    sd: Float[np.ndarray, "samples parts"],
) -> tuple[Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]]:
    """(2.5 %, 97.5 %) quantiles of  sum_i w_i N(m_i, s_i^2), the rest being 0, by bisection."""
    lower, upper = np.zeros(len(weight)), np.zeros(len(weight))
    heavy = weight.max(axis=0, initial=0.0) > LIGHT
    weight, mean, sd = weight[:, heavy], mean[:, heavy], np.maximum(sd[:, heavy], 1e-300)
    at_zero = 1 - weight.sum(axis=1)
    for found, sign in ((lower, 1.0), (upper, -1.0)):
        m = sign * mean  # the upper quantile is the lower one of the mirrored mixture
        below = np.sum(weight * ndtr(-m / sd), axis=1)
        target = np.where(below >= TAIL, TAIL, TAIL - at_zero)
        rows = np.flatnonzero((below >= TAIL) | (below + at_zero < TAIL))
        if len(rows) == 0:
            continue
        w, m, s, goal = weight[rows], m[rows], sd[rows], target[rows]
        low = np.minimum((m - 9 * s).min(axis=1, initial=0.0, where=w > LIGHT), 0.0)
        high = np.maximum((m + 9 * s).max(axis=1, initial=0.0, where=w > LIGHT), 0.0)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            under = np.sum(w * ndtr((middle[:, None] - m) / s), axis=1) < goal
            low, high = np.where(under, middle, low), np.where(under, high, middle)
        found[rows] = sign * (low + high) / 2
    return lower, upper


def posterior_of(bank: FaultBank, run: Run, blocks: Iterable[Rows]) -> Posterior:
    """The columns of `run` from the bank's blocks of samples."""
    faults, count = bank.model.plant.signals.faults, len(run.t)
    p, f, lo, hi = (np.full((count, len(faults)), np.nan) for _ in range(4))
    healthy, unknown = np.full(count, np.nan), np.full(count, np.nan)
    seen = np.zeros((count, len(faults), 2), bool)
    inside = np.zeros(count, bool)
    kept = len(bank.model.plant.signals.states) + len(bank.modes.drifting)
    x = np.full((count, kept), np.nan)
    for rows in blocks:
        part = rows.part
        healthy[part] = rows.p[:, 0]
        unknown[part] = rows.p[:, len(bank.sets) :].sum(axis=1)
        seen[part], inside[part], x[part] = rows.seen, rows.inside, rows.x
        p[part] = marginals(bank, rows.p)
        for k, fault in enumerate(faults):
            f[part, k], lo[part, k], hi[part, k] = _estimate(bank, rows, k, fault)
    return Posterior(p, f, lo, hi, healthy, unknown, seen, inside, x)


def _estimate(
    bank: FaultBank, rows: Rows, k: int, fault: Fault
) -> tuple[
    Float[np.ndarray, "samples"], Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]
]:
    """(mean, lower, upper) of one fault; as wide as its prior where it would not be seen."""
    modes, slots = members(bank, k)
    weight, size = rows.p[:, modes], float(bank.levels.size[k])
    mean = np.clip(rows.f[:, modes, slots], fault.min, fault.max)
    f = np.sum(weight * mean, axis=1)
    unknown = np.zeros((len(f), 1))
    undeclared = rows.p[:, len(bank.sets) :].sum(axis=1, keepdims=True)
    lo, hi = mixture_quantiles(
        np.concatenate([weight, undeclared], axis=1),
        np.concatenate([mean, unknown], axis=1),
        np.concatenate([rows.sd[:, modes, slots], unknown + size], axis=1),
    )
    blind = ~rows.seen[:, k]
    absent = weight.sum(axis=1) < QUIET
    blind &= (absent | blind.all(axis=1))[:, None]
    lo = np.where(blind[:, 0], np.minimum(lo, -WIDE * size), lo)
    hi = np.where(blind[:, 1], np.maximum(hi, WIDE * size), hi)
    lo, hi = np.clip(lo, fault.min, fault.max), np.clip(hi, fault.min, fault.max)
    return f, np.minimum(lo, f), np.maximum(hi, f)  # the mean of a mixture may lie outside


def statuses(bank: FaultBank, run: Run, found: Posterior) -> tuple[list[str], list[str]]:
    """(status, reason) of every sample."""
    old = _age(bank, run) > FRESH * bank.step
    sampled = np.isfinite(found.healthy)
    alarm = _told(sampled & (np.nan_to_num(found.healthy, nan=1.0) <= ALARM), found.inside)
    quiet = np.asarray(found.healthy > QUIET)
    clear = np.asarray(found.seen.all(axis=(1, 2)))
    status, reason = [], []
    for k in range(len(run.t)):
        if not sampled[k]:
            answer = NOT_JUDGED, "not sampled"
        elif old[k]:
            answer = STALE, "no output was sampled for a while"
        elif alarm[k]:
            answer = FAULT, _cause(bank, found, k)
        elif not found.inside[k]:
            answer = NOT_JUDGED, "outside the training envelope"
        elif not quiet[k]:
            answer = NOT_JUDGED, "undecided whether there is a fault"
        elif not clear[k]:
            answer = NOT_JUDGED, _blind(bank, run, found, k)
        else:
            answer = HEALTHY, ""
        status.append(answer[0])
        reason.append(answer[1])
    return status, reason


def _age(bank: FaultBank, run: Run) -> Float[np.ndarray, "samples"]:
    """Seconds since any output was sampled."""
    any_output = np.any([np.isfinite(run.columns[n]) for n in bank.outputs], axis=0)
    last = np.maximum.accumulate(np.where(any_output, run.t, run.t[0]))
    return run.t - last


def _told(
    alarm: Bool[np.ndarray, "samples"], inside: Bool[np.ndarray, "samples"]
) -> Bool[np.ndarray, "samples"]:
    """Alarms that began inside the training envelope, or have come back into it."""
    told = alarm.copy()
    for start, stop in np.flatnonzero(np.diff(alarm, prepend=False, append=False)).reshape(-1, 2):
        within = np.flatnonzero(inside[start:stop])
        told[start : start + (within[0] if len(within) else stop - start)] = False
    return told


def _cause(bank: FaultBank, found: Posterior, k: int) -> str:
    names = bank.model.plant.signals.fault_names
    if found.unknown[k] >= QUIET:
        return "no declared fault explains it"
    if found.p[k].max(initial=0.0) >= NAMED:
        return ""
    shares = {"something undeclared": found.unknown[k], **dict(zip(names, found.p[k], strict=True))}
    likely = sorted(shares, key=lambda name: -shares[name])[:2]
    return f"cause undecided: {' or '.join(likely)}"


def _blind(bank: FaultBank, run: Run, found: Posterior, k: int) -> str:
    """Why a fault would not show."""
    signals = bank.model.plant.signals
    fault = signals.faults[int(np.argmax(~found.seen[k].all(axis=1)))]
    if fault.enters in ("input", "gain"):
        target = signals.inputs[signals.input_names.index(fault.target)]
        value = run.columns[target.name][k]
        room = 1e-6 * max(abs(target.min), abs(target.max)) if np.isfinite(value) else 0.0
        if fault.enters == "input" and (value <= target.min + room or value >= target.max - room):
            return f"{fault.name} would not show: {target.name} is at its limit"
        if fault.enters == "gain":
            return f"{fault.name} would not show: {target.name} does not excite it"
    return f"{fault.name} would not show yet, after a start, a gap or in these data"
