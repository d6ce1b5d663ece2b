"""From the sets of faults to probabilities, estimates and intervals.

Every figure is of the one mixture over all sets: `p_<fault>` sums the sets that hold it, the
estimate is the mean (0 where the fault is absent), and the interval its 2.5 % and 97.5 %
quantiles, where an undeclared fault leaves each fault as uncertain as its prior.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtr

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.course import Rows
from faultgauge.plants.signals import Fault
from faultgauge.telemetry import Run

__all__ = ["Posterior", "calm_of", "marginals", "mixture_quantiles", "posterior_of", "untrusted"]

LIKELY = 0.5  # p of a fault from which on it is there rather than not
TAIL = 0.025
WIDE = 1.959964  # standard deviations on either side of a 95 % interval
HALVINGS = 36
LIGHT = 1e-4  # weight below which a part of a mixture moves no 2.5 % quantile


@dataclass(frozen=True)
class Posterior:
    """Columns of one run, NaN where nothing was sampled; faults in the plant's order, NaN where
    they are disabled.

    `calm` is the probability that there is no active fault, `x` the posterior mean of [states,
    discrepancy, directions], `outside` what is not trusted as in `Rows`, `held` whether a hold-off
    is on; `onset` how long ago each fault began if it is there (mean, standard deviation [s]),
    and the probability that it `ever` was.
    """

    p: Float[np.ndarray, "samples faults"]
    f: Float[np.ndarray, "samples faults"]
    lo: Float[np.ndarray, "samples faults"]
    hi: Float[np.ndarray, "samples faults"]
    healthy: Float[np.ndarray, "samples"]
    unknown: Float[np.ndarray, "samples"]
    calm: Float[np.ndarray, "samples"]
    seen: Bool[np.ndarray, "samples faults two"]
    outside: Int[np.ndarray, "samples"]
    x: Float[np.ndarray, "samples extended"]
    onset: Float[np.ndarray, "samples faults two"]
    ever: Float[np.ndarray, "samples faults"]
    held: Bool[np.ndarray, "samples"]

    @property
    def inside(self) -> Bool[np.ndarray, "samples"]:
        """Whether the model is trusted there."""
        return self.outside == 0


def members(bank: FaultBank, fault: int) -> list[int]:
    """The sets that hold the fault."""
    return [k for k, each in enumerate(bank.sets) if fault in each]


def marginals(
    bank: FaultBank, p: Float[np.ndarray, "samples sets"]
) -> Float[np.ndarray, "samples faults"]:
    """p of every fault, alone or with others."""
    faults = range(len(bank.model.plant.signals.faults))
    return np.stack([p[:, members(bank, k)].sum(axis=1) for k in faults], axis=1)


def calm_of(bank: FaultBank, p: Float[np.ndarray, "samples sets"]) -> Float[np.ndarray, "samples"]:
    """The probability that there is no active fault, declared or not."""
    active = bank.with_monitor("active")
    calm = [k for k, each in enumerate(bank.sets) if not active[list(each)].any()]
    return p[:, calm].sum(axis=1)


def mixture_quantiles(
    weight: Float[np.ndarray, "samples parts"],
    mean: Float[np.ndarray, "samples parts"],
    sd: Float[np.ndarray, "samples parts"],
) -> tuple[Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]]:
    """(2.5 %, 97.5 %) quantiles of  sum_i w_i N(m_i, s_i^2), the rest being 0, by bisection."""
    lower, upper = np.zeros(len(weight)), np.zeros(len(weight))
    weight, sd = np.where(weight > LIGHT, weight, 0.0), np.maximum(sd, 1e-300)
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
    healthy, unknown, calm = (np.full(count, np.nan) for _ in range(3))
    seen = np.zeros((count, len(faults), 2), bool)
    outside, held = np.ones(count, int), np.zeros(count, bool)
    x = np.full((count, len(bank.plant.signals.states)), np.nan)
    onset, ever = np.zeros((count, len(faults), 2)), np.zeros((count, len(faults)))
    for rows in blocks:
        part = rows.part
        healthy[part] = rows.p[:, 0]
        unknown[part] = rows.p[:, len(bank.sets) :].sum(axis=1)
        calm[part] = calm_of(bank, rows.p)
        seen[part], outside[part], x[part] = rows.seen, rows.outside, rows.x
        held[part] = rows.held
        onset[part], ever[part] = rows.onset, rows.ever
        p[part] = marginals(bank, rows.p)
        for k, fault in enumerate(faults):
            if fault.monitor == "disabled":
                p[part, k] = np.nan
                continue
            f[part, k], lo[part, k], hi[part, k] = _estimate(bank, rows, k, fault)
    return Posterior(p, f, lo, hi, healthy, unknown, calm, seen, outside, x, onset, ever, held)


def _estimate(
    bank: FaultBank, rows: Rows, k: int, fault: Fault
) -> tuple[
    Float[np.ndarray, "samples"], Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]
]:
    """(mean, lower, upper) of one fault; as wide as its prior where it would not be seen."""
    sets = members(bank, k)
    weight, size = rows.p[:, sets], float(bank.size[k])
    mean = np.clip(rows.f[:, sets, k], fault.min, fault.max)
    sd = rows.sd[:, sets, k]
    f = np.sum(weight * mean, axis=1)
    unknown = np.zeros((len(f), 1))
    undeclared = rows.p[:, len(bank.sets) :].sum(axis=1, keepdims=True)
    lo, hi = mixture_quantiles(
        np.concatenate([weight, undeclared], axis=1),
        np.concatenate([mean, unknown], axis=1),
        np.concatenate([sd, unknown + size], axis=1),
    )
    blind = ~rows.seen[:, k]
    absent = weight.sum(axis=1) < LIKELY
    blind &= absent[:, None]
    lo = np.where(blind[:, 0], np.minimum(lo, -WIDE * size), lo)
    hi = np.where(blind[:, 1], np.maximum(hi, WIDE * size), hi)
    lo, hi = np.clip(lo, fault.min, fault.max), np.clip(hi, fault.min, fault.max)
    return f, np.minimum(lo, f), np.maximum(hi, f)  # the mean of a mixture may lie outside


def untrusted(bank: FaultBank, found: Posterior, status: Sequence[str]) -> Posterior:
    """`found` with intervals as wide as the priors where the model is not trusted and no alarm that
    began before goes on: the network that was left may make up any fault."""
    where = (found.outside > 0) & (np.array(status) == "NOT_JUDGED")
    faults, reach = bank.model.plant.signals.faults, WIDE * bank.size
    lo = np.maximum(np.minimum(found.lo, -reach), [fault.min for fault in faults])
    hi = np.minimum(np.maximum(found.hi, reach), [fault.max for fault in faults])
    out = where[:, None]
    return replace(found, lo=np.where(out, lo, found.lo), hi=np.where(out, hi, found.hi))
