"""How well a fault can be known by when, beside noise, discrepancy and uncertain constants.

The healthy filter, linearised at the middle of the training envelope, is in its steady state when a
constant fault of unit size begins, which acts as strongly as it does over the envelope in root mean
square: a loss of gain does nothing at the middle where that is an input of 0. What it leaves in the
innovations adds up (Willsky and Jones, IEEE TAC 21 (1976)),

    1 / sd(t)^2 = sum |S^-1/2 dv|^2,

on times that reach as far as a quarter of the healthy logs, row by row at first. Where the
discrepancy lasts shorter than that, sd falls on; where it lasts longer, sd ends at what the
discrepancy hides.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.extended import process_of, sampled_within, spread_of_start
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.bank.priors import stated_size
from faultgauge.detection.rows.judged import operating_points
from faultgauge.observers.observer import OperatingPoints, linearise
from faultgauge.plants.disturbed import Disturbed
from faultgauge.plants.model import Model

__all__ = ["Knowledge", "knowledge_of", "longest_delay"]

TIMES = 400  # points of the grid
SHARE = 0.25  # of the healthy logs: how far the times reach
CLEAR = 8.0  # standard deviations by which a fault of its widest size shows
NEARLY_SETTLED = 1.25  # times what a standard deviation comes to in the end: it falls no further
EARLIER = (
    3.0  # times what shows in the end: the widest of what is given no size, which shows sooner
)
FEWEST = 20  # samples of the memory


class Knowledge(NamedTuple):
    """`sd` of each declared fault at times `t` [s] after its onset (inf: nothing shows); its widest
    `size`; `when` one of that size shows [s after its onset], and the median of that, the bank's
    memory; which `drive` of each state that a discrepancy acts on shows as
    soon."""

    t: Float[np.ndarray, "times"]
    sd: Float[np.ndarray, "times faults"]
    size: Float[np.ndarray, "faults"]
    when: Float[np.ndarray, "faults"]
    memory: float
    drive: Float[np.ndarray, "driven"]

    def at(self, fault: int, t: float) -> float:
        """sd of `fault` `t` [s] after its onset."""
        k = self._index(t)
        return float(self.sd[k, fault]) if k >= 0 else np.inf

    def _index(self, t: float) -> int:
        return int(np.searchsorted(self.t, t, "right")) - 1


def knowledge_of(
    model: Model,
    plant: Disturbed,
    noise: Noise,
    size: Float[np.ndarray, "faults"],
    step: float,
    outputs: Sequence[str],
    rows: Sequence[int],
    healthy: float,
) -> Knowledge:
    """`rows` between the samples of each of `outputs`; times reach a share of `healthy` [s]. A
    `size` is taken for larger where it would never show, unless the file says how large it is: what
    acts on a plant that is held in one place has no range of its own."""
    stride = max(1, int(SHARE * healthy / (TIMES * step)))
    given = model, plant, noise, step, outputs, rows
    t, sd = _over(*given, stride)
    wide = EARLIER * CLEAR * sd[-1]
    drive = wide[len(plant.signals.faults) :]
    if stride > 1:
        t, sd = _joined(_over(*given, 1), (t, sd))
    declared = model.plant.signals.faults
    sd, size = sd[:, : len(declared)], size[: len(declared)].copy()
    for k, fault in enumerate(declared):
        if fault.enters == "state" and stated_size(fault) is None:
            size[k] = max(size[k], wide[k] if np.isfinite(wide[k]) else 0.0)
    # or as clearly as it ever does
    shows = sd <= np.maximum(size / CLEAR, NEARLY_SETTLED * sd[-1])
    when = np.clip(t[np.argmax(shows, axis=0)], FEWEST * step, t[-1])
    return Knowledge(t, sd, size, when, float(np.median(when)), drive)


def _over(
    model: Model,
    plant: Disturbed,
    noise: Noise,
    step: float,
    outputs: Sequence[str],
    rows: Sequence[int],
    stride: int,
) -> tuple[Float[np.ndarray, "times"], Float[np.ndarray, "times both"]]:
    """(times, the standard deviations of faults and drives by then) on a grid of `stride` rows."""
    dt = stride * step
    points = operating_points(model)
    more = len(plant.signals.states) - points.x.shape[1]
    x = np.concatenate([points.x, np.zeros((len(points.x), more))], axis=1)
    linear = linearise(plant, OperatingPoints(x, points.u), dt, None)
    measured = [plant.signals.output_names.index(name) for name in outputs]
    A, C = np.median(linear.A, axis=0), np.median(linear.C, axis=0)[measured]
    B, D = np.split(_typical(np.concatenate([linear.B, linear.D[:, measured]], axis=1)), [len(A)])
    parts = plant.parts
    drives = np.where(np.arange(len(A))[:, None] < points.x.shape[1], A[:, parts.d], 0.0)
    B, D = np.hstack([B, drives]), np.hstack([D, C[:, parts.d]])
    # white noise as strong as sigma at one sample in n is sigma sqrt(n) at every row
    R = np.diag(sampled_within(model, noise)[measured] ** 2 * np.array(rows) / stride)
    q = process_of(noise, spread_of_start(model, noise.sigma, ())[1])
    states = points.x.shape[1]
    Q = np.diag(q**2 * dt)
    start = np.ones(len(q))
    start[:states] = q[:states] * np.sqrt(dt)
    start[states : states + len(noise.size)] = noise.size
    start[parts.lag] = start[parts.g] = 0.0
    start[parts.b] = noise.wander[list(noise.wanders)]
    start[parts.a] = noise.stray[list(noise.strays)]
    start[parts.z] = noise.zero[list(noise.zeros)]
    start[parts.q] = noise.grip[list(noise.grips)]
    sd = _deviations(A, B, C, D, Q, R, np.diag(start**2))
    return dt * np.arange(1, TIMES + 1), np.where(sd > 1e100, np.inf, sd)


def _joined(
    fine: tuple[Float[np.ndarray, "times"], Float[np.ndarray, "times both"]],
    coarse: tuple[Float[np.ndarray, "times"], Float[np.ndarray, "times both"]],
) -> tuple[Float[np.ndarray, "more"], Float[np.ndarray, "more both"]]:
    """The `fine` grid and what the `coarse` one has behind it, where nothing is known worse than
    before: in steps of many rows what jumps from one to the next is lost."""
    behind = coarse[0] > fine[0][-1]
    t, sd = (np.concatenate([a, b[behind]]) for a, b in zip(fine, coarse, strict=True))
    return t, np.minimum.accumulate(sd, axis=0)


def _deviations(
    A: Float[np.ndarray, "n n"],
    B: Float[np.ndarray, "n faults"],
    C: Float[np.ndarray, "m n"],
    D: Float[np.ndarray, "m faults"],
    Q: Float[np.ndarray, "n n"],
    R: Float[np.ndarray, "m m"],
    P: Float[np.ndarray, "n n"],
) -> Float[np.ndarray, "times faults"]:
    """sd(t) of the docstring above, of a filter that begins its way to the steady state at `P`."""
    for _ in range(TIMES):
        P = _predicted(A, C, Q, R, P)
    shift, total = np.zeros(B.shape), np.zeros(B.shape[1])
    sd = np.zeros((TIMES, B.shape[1]))
    for k in range(TIMES):
        S = C @ P @ C.T + R
        K, white = np.linalg.solve(S, C @ P).T, np.linalg.inv(np.linalg.cholesky(S))
        shift = A @ shift + B
        change = C @ shift + D
        total += np.sum((white @ change) ** 2, axis=0)
        shift = shift - K @ change
        sd[k] = 1 / np.sqrt(np.maximum(total, 1e-300))
        P = _predicted(A, C, Q, R, P)
    return sd


def _typical(
    directions: Float[np.ndarray, "points rows faults"],
) -> Float[np.ndarray, "rows faults"]:
    """Along which each fault acts over all points, as long as its root mean square: the leading
    singular vector of all of its directions (where these differ, it depends on the units)."""
    _, strength, along = np.linalg.svd(np.moveaxis(directions, 2, 0), full_matrices=False)
    return (strength[:, :1] * along[:, 0] / np.sqrt(len(directions))).T


def _predicted(
    A: Float[np.ndarray, "n n"],
    C: Float[np.ndarray, "m n"],
    Q: Float[np.ndarray, "n n"],
    R: Float[np.ndarray, "m m"],
    P: Float[np.ndarray, "n n"],
) -> Float[np.ndarray, "n n"]:
    """The predicted covariance one step on."""
    S = C @ P @ C.T + R
    P = A @ (P - P @ C.T @ np.linalg.solve(S, C @ P)) @ A.T + Q
    return (P + P.T) / 2


def longest_delay(known: Knowledge, fault: int, size: float, onset: float, level: float) -> float:
    """After how long [s] a fault of this `size` is told, at the latest (97.5 %).

    It leaves f^2 / (2 sd(t)^2) of log-likelihood after a time t, with a standard deviation of the
    root of twice that (a Gaussian mean shift), and is told when this outweighs the prior odds of an
    `onset` [1/s] up to the alarm's log-odds.
    """
    needed = level - np.log(onset * (known.t[-1] - known.t[-2]))
    spread = 1.96 * np.sqrt(2.0)
    longest = ((spread + np.sqrt(spread**2 + 4 * needed)) / 2) ** 2
    told = np.flatnonzero(size**2 / (2 * known.sd[:, fault] ** 2) >= longest)
    return float(known.t[told[0] if len(told) else -1])
