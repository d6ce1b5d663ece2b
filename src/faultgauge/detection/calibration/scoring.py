"""The likeliest levels by Fisher's method of scoring, within bounds.

What innovations e and their variances S tell of levels x,

    M_ij = sum  de/dx_i de/dx_j / S  +  1/2  dlnS/dx_i dlnS/dx_j,

needs first derivatives alone, which the slope needs anyway (N. K. Gupta and R. K. Mehra, IEEE TAC
19 (1974)), so that some steps do where a search that learns the curvature from its own way takes a
hundred. Steps are damped as Levenberg and Marquardt's; several dampings are tried at once, and
beside them where the last steps together lead, as M is not the curvature where a model errs (D. G.
Anderson, J. ACM 12 (1965)).

Where a plant bends within what its filter does not know, friction at a standstill, two levels that
are as good as one have likelihoods that are tens apart, and differences over so little tell that
and no slope. Where M promises what no step gains they are taken over more (C. T. Kelley, "Implicit
Filtering", SIAM 2011).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.calibration.innovation_likelihood import Likelihoods

__all__ = ["scored"]

# of a logarithm, for the slopes: where a filter is at times lost, less is rough
DIFFERENCES = (3e-3, 3e-2, 0.3)
DAMPING = 0.1  # times the information itself: the first
FACTORS = 10.0 ** np.arange(-1, 2)  # times the last damping: those that are tried
LATELY = 4  # places whose steps are mixed
WEAK = 1e-3  # information of what no sample tells, which so stays where it is
STRIDE = 2.0  # of a logarithm: the longest step
PULLS = 3  # sets of dampings that are tried before a step that promises enough is the last


class _Place(NamedTuple):
    """Where a search was, and the undamped step from there."""

    x: Float[np.ndarray, "levels"]
    step: Float[np.ndarray, "levels"]


def scored(
    tell: Callable[[Float[np.ndarray, "many levels"]], Likelihoods],
    near: Callable[[Float[np.ndarray, "many levels"]], Likelihoods],
    start: Float[np.ndarray, "levels"],
    low: Float[np.ndarray, "levels"],
    high: Float[np.ndarray, "levels"],
    center: Float[np.ndarray, "levels"],
    pull: Float[np.ndarray, "levels"],
    most: int,
    enough: float,
    stepped: Callable[[], None],
) -> tuple[Float[np.ndarray, "levels"], float]:
    """(logarithms of levels, their -ln likelihood) after at most `most` steps from `start`, or one
    that gains less than `enough`.

    `tell` says what data do under some levels, `near` what they do under levels near to the first.
    `center` and `pull` are mean and standard deviation (infinite: none) of a prior.
    """
    weight = 1 / pull**2

    def unlikely(x: Float[np.ndarray, "many levels"]) -> Float[np.ndarray, "many"]:
        return np.sum(np.where(weight > 0, (x - center) ** 2 * weight / 2, 0.0), axis=-1)

    x, damping, cost, length = np.clip(start, low, high), DAMPING, np.inf, 0
    lately = list[_Place]()
    for _ in range(most):
        stepped()
        h = DIFFERENCES[length]
        told = near(np.concatenate([x[None], x + h * np.eye(len(x))]))
        cost = float(told.cost[0] + unlikely(x[None])[0])
        M = _information(told, h)
        # a difference to one side is off by half of its length times the curvature
        slope = (told.cost[1:] - told.cost[0]) / h - h / 2 * np.diagonal(M)
        slope = slope + np.where(weight > 0, (x - center) * weight, 0.0)
        M = M + np.diag(weight + WEAK)
        free = ~(((x <= low) & (slope > 0)) | ((x >= high) & (slope < 0)))
        best, gain = x, 0.0
        whole = _step(M, slope, free, 0.0)
        lately = [*lately, _Place(x, whole)][-LATELY:]
        promised = -slope @ whole / 2
        for _ in range(PULLS if promised >= enough else 1):
            steps = [_step(M, slope, free, factor * damping) for factor in FACTORS]
            tries = np.clip(x + np.stack([*steps, _mixed(lately, M)]), low, high)
            costs = np.nan_to_num(tell(tries).cost + unlikely(tries), nan=np.inf)
            k = int(np.argmin(costs))
            if k < len(FACTORS):
                damping *= float(FACTORS[k])
            if costs[k] < cost:
                best, gain = tries[k], cost - float(costs[k])
                break
            damping *= float(FACTORS[-1])
        x, cost = best, cost - gain
        if gain >= enough:
            continue
        if promised < enough or h == DIFFERENCES[-1]:
            break
        length, damping = length + 1, DAMPING
    return x, cost


def _information(told: Likelihoods, h: float) -> Float[np.ndarray, "levels levels"]:
    """M of the docstring above, from the first levels and those `h` beside them."""
    e = told.white * np.exp(told.root)
    J = (e[1:] - e[0]) * np.exp(-told.root[0]) / h
    L = 2 * (told.root[1:] - told.root[0]) / h
    M = J @ J.T + 0.5 * L @ L.T
    return np.where(np.isfinite(M), M, 0.0)


def _mixed(
    lately: Sequence[_Place], M: Float[np.ndarray, "levels levels"]
) -> Float[np.ndarray, "levels"]:
    """The step from the last of some places, x with the step g, to where these mixed have the
    shortest by M,

        g - (dX + dG) c,    c = argmin |g - dG c|."""
    x, g = (np.stack(each) for each in zip(*lately, strict=True))
    dX, dG = np.diff(x, axis=0).T, np.diff(g, axis=0).T
    c = np.linalg.lstsq(dG.T @ M @ dG, dG.T @ M @ g[-1], rcond=1e-10)[0]
    return np.clip(g[-1] - (dX + dG) @ c, -STRIDE, STRIDE)


def _step(
    M: Float[np.ndarray, "levels levels"],
    slope: Float[np.ndarray, "levels"],
    free: Bool[np.ndarray, "levels"],
    damping: float,
) -> Float[np.ndarray, "levels"]:
    """Downhill, along the levels that are `free`; none where the slope is not finite."""
    own = M[np.ix_(free, free)]
    step = np.zeros(len(slope))
    if not np.all(np.isfinite(slope[free])):
        return step
    damped = own + damping * np.diag(np.diagonal(own))
    step[free] = -np.linalg.lstsq(damped, slope[free], rcond=None)[0]
    return np.clip(step, -STRIDE, STRIDE)
