"""How well a fault can be known by when, beside noise, discrepancy and uncertain constants.

The healthy filter, linearised at the middle of the training envelope, is in its steady state when a
constant fault of unit size begins. What it leaves in the innovations adds up (Willsky and Jones,
IEEE TAC 21 (1976)),

    1 / sd(t)^2 = sum |S^-1/2 dv|^2,

on a grid of times that reaches as far as the healthy logs are long. Where the discrepancy lasts
shorter than that, sd falls on; where it lasts longer, sd ends at what the discrepancy hides. To be
named, a fault must not leave what another one of some size would, whenever that began:

    1 / apart(t)^2 = min over others of size s, onsets of  J - J_12^2 / (J_22 + 1 / s^2).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.detection.judged import operating_points
from faultgauge.detection.noise import Noise, process_of, spread_of_start
from faultgauge.observers.observer import OperatingPoints, linearise
from faultgauge.plants.disturbed import Disturbed
from faultgauge.plants.model import Model
from faultgauge.simulation.free_run import substeps_for

__all__ = ["Knowledge", "knowledge_of", "longest_delay"]

TIMES = 400
SHARE = 0.25  # of the healthy logs: how far the times reach
CLEAR = 8.0  # standard deviations by which a fault of its widest size shows
FEWEST = 20  # samples of the memory
ONSETS = 40  # of another fault
ALIKE = 1e-6  # of the information: two faults that differ by less are one


class Knowledge(NamedTuple):
    """`sd` of each declared fault at times `t` [s] after its onset (inf: nothing shows); `when` one
    of its widest size shows [s after its onset], and the median of that, the bank's memory; `left`
    is what a unit of each leaves in the whitened innovations."""

    t: Float[np.ndarray, "times"]
    sd: Float[np.ndarray, "times faults"]
    when: Float[np.ndarray, "faults"]
    memory: float
    left: Float[np.ndarray, "times outputs faults"]

    def at(self, fault: int, t: float) -> float:
        """sd of `fault` `t` [s] after its onset."""
        k = self._index(t)
        return float(self.sd[k, fault]) if k >= 0 else np.inf

    def apart(self, fault: int, t: float, others: Mapping[int, float]) -> float:
        """sd of `fault` `t` [s] after its onset beside the one of `others`, each of a standard
        deviation, that is most like it; those that only a change of the input tells apart do not
        count."""
        k = self._index(t)
        if k < 0:
            return np.inf
        own = self.left[: k + 1, :, fault]
        least = J = float(np.sum(own**2))
        for other, size in others.items():
            onsets = _onsets(k + 1, len(self.left))
            J12, J22 = np.array([self._shared(own, other, later) for later in onsets]).T
            if J - np.max(J12**2 / J22) > ALIKE * J:
                least = min(least, J - np.max(J12**2 / (J22 + 1 / size**2)))
        return 1 / np.sqrt(least) if least > 0 else np.inf

    def _shared(
        self, own: Float[np.ndarray, "times outputs"], other: int, later: int
    ) -> tuple[float, float]:
        """(J_12, J_22) of `own` and what `other` leaves if it began `later` (negative: before)."""
        whole = self.left[: len(own) - later, :, other]
        J12 = np.sum(own[max(later, 0) :] * whole[max(-later, 0) :])
        return float(J12), float(np.sum(whole**2)) + 1e-300

    def _index(self, t: float) -> int:
        return int(np.searchsorted(self.t, t, "right")) - 1


def _onsets(count: int, kept: int) -> list[int]:
    """Steps by which another fault may begin later (or earlier: negative), ever sparser."""
    far = sorted({int(each) for each in np.geomspace(1, max(count - 1, 1), ONSETS)})
    return [0, *far, *[-each for each in far if count + each <= kept]]


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
    """`rows` between the samples of each of `outputs`; times reach a share of `healthy` [s]."""
    stride = max(1, int(SHARE * healthy / (TIMES * step)))
    dt = stride * step
    points = operating_points(model)
    more = len(plant.signals.states) - points.x.shape[1]
    x = np.concatenate([points.x, np.zeros((len(points.x), more))], axis=1)
    linear = linearise(plant, OperatingPoints(x, points.u), dt, substeps_for(dt, model.max_step))
    measured = [plant.signals.output_names.index(name) for name in outputs]
    A, B = np.median(linear.A, axis=0), np.median(linear.B, axis=0)
    C, D = np.median(linear.C, axis=0)[measured], np.median(linear.D, axis=0)[measured]
    # white noise as strong as sigma at one sample in n is sigma sqrt(n) at every row
    R = np.diag(noise.sigma[measured] ** 2 * np.array(rows) / stride)
    q = process_of(noise, spread_of_start(model, noise.sigma, ())[1])
    states = points.x.shape[1]
    Q = np.diag(q**2 * dt)
    start = np.ones(len(q))
    start[:states] = q[:states] * np.sqrt(dt)
    start[states : states + len(noise.size)] = noise.size
    start[states + len(noise.size) :][: len(noise.share)] = 0.0
    P = np.diag(start**2)
    for _ in range(TIMES):
        P = _predicted(A, C, Q, R, P)
    shift, total = np.zeros(B.shape), np.zeros(B.shape[1])
    sd, left = np.zeros((TIMES, B.shape[1])), np.zeros((TIMES, len(measured), B.shape[1]))
    for k in range(TIMES):
        S = C @ P @ C.T + R
        K, white = np.linalg.solve(S, C @ P).T, np.linalg.inv(np.linalg.cholesky(S))
        shift = A @ shift + B
        change = C @ shift + D
        left[k] = white @ change
        total += np.sum(left[k] ** 2, axis=0)
        shift = shift - K @ change
        sd[k] = 1 / np.sqrt(np.maximum(total, 1e-300))
        P = _predicted(A, C, Q, R, P)
    sd = np.where(sd > 1e100, np.inf, sd)
    t = dt * np.arange(1, TIMES + 1)
    declared = len(model.plant.signals.faults)
    shows = CLEAR * sd[:, :declared] <= size[:declared]
    when = np.array([t[np.argmax(each)] if each.any() else t[-1] for each in shows.T])
    when = np.clip(when, FEWEST * step, t[-1])
    return Knowledge(t, sd[:, :declared], when, float(np.median(when)), left[:, :, :declared])


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
    needed = level - np.log(onset * known.t[0])
    spread = 1.96 * np.sqrt(2.0)
    longest = ((spread + np.sqrt(spread**2 + 4 * needed)) / 2) ** 2
    told = np.flatnonzero(size**2 / (2 * known.sd[:, fault] ** 2) >= longest)
    return float(known.t[told[0] if len(told) else -1])
