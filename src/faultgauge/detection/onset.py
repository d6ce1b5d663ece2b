"""When a fault that was named began: the posterior over all onsets in a window around its alarm.

The innovations of the healthy filter, run through that window anew, tell by how much each onset is
likelier than none (`window`). How early the window begins depends on how late such a fault may have
been told: one of size f leaves f^2 / (2 sd(n)^2) of log-likelihood after n samples, with a standard
deviation of the root of twice that (a Gaussian mean shift). It is told when this outweighs the
prior odds, -ln(onset rate x step), up to the alarm's log-odds, and what the unknown size costs,
ln(prior size / sd(n)). What the model errs by adds to the variance sd(n)^2.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.levels import LONG, MEMORY
from faultgauge.detection.over_onsets import onset_over
from faultgauge.detection.posterior import WIDE
from faultgauge.detection.window import Window, causes_in, shocks_of, window_of
from faultgauge.plants.plant import Plant
from faultgauge.telemetry import Run

__all__ = ["EARLIEST", "Evidence", "Lasting", "longest_delay", "onset_of"]

EARLIEST = MEMORY + LONG  # samples before an alarm from which on an onset is looked for
PADDED = 512  # samples: most windows have one compiled program


class Evidence(NamedTuple):
    """Samples of a run that may tell an onset: inputs as they act, `x` what the bank took for
    [states, drifting parameters], and where the model is trusted."""

    plant: Plant
    run: Run
    x: Float[np.ndarray, "samples kept"]
    believed: Bool[np.ndarray, "samples"]


class Lasting(NamedTuple):
    """Fault `fault` of `size`, None for an undeclared one, from `onset` to `end` [s]."""

    fault: int
    size: float | None
    onset: float
    end: float


def longest_delay(bank: FaultBank, fault: int, size: float) -> int:
    """After how many samples a fault of this `size` is told, at the latest (97.5 %)."""
    known = np.hypot(bank.known[:, fault], bank.error[bank.sets.index((fault,)), 0])
    needed = -np.log(bank.levels.onset[fault] * bank.step) + bank.level
    unsure = np.log(np.maximum(bank.levels.size[fault] / known, 1.0))
    spread = WIDE * np.sqrt(2.0)
    longest = ((spread + np.sqrt(spread**2 + 4 * needed)) / 2) ** 2
    told = np.flatnonzero(size**2 / (2 * known**2) >= longest + unsure)
    return 1 + int(told[0] if len(told) else len(known))


def onset_of(
    bank: FaultBank,
    evidence: Evidence,
    part: slice,
    fault: int,
    size: float | None,
    others: list[Lasting],
) -> tuple[float, float, float]:
    """(mean, lower, upper) of the onset [s] of `fault`, of about this `size`, as the samples `part`
    tell it beside the `others`; an onset at the first one may lie before them.

    Linearised around the fault, at the second look: what it does to the state counts in full, and
    so does what a limit leaves of it.
    """
    faults = bank.model.plant.signals.faults
    believed, mean = evidence.believed, evidence.x[part.start]
    window = window_of(bank, evidence.plant, evidence.run, part, believed, mean, PADDED)
    known = np.zeros(window.record.f.shape)
    for other in others:
        lasts = (window.t > other.onset) & (window.t <= other.end)
        if other.size is not None:
            known[: len(lasts), other.fault] += other.size * lasts
    window = window._replace(record=window.record._replace(known=jnp.asarray(known)))
    if size is None:
        found = causes_in(bank, window, shocks_of(bank, window))
        weight = np.logaddexp.reduce(found.weight[:, len(faults) :], axis=1)
    else:
        weight = _weight(bank, window, fault, size, len(known))
        weight = _weight(bank, window, fault, size, int(np.argmax(weight)))
    mean, low, high = onset_over(window.t, np.exp(weight - np.logaddexp.reduce(weight)))
    assert mean is not None
    assert low is not None
    assert high is not None
    return mean, low, high


def _weight(
    bank: FaultBank, window: Window, fault: int, size: float, guess: int
) -> Float[np.ndarray, "samples"]:
    """ln of the posterior weight of every onset; the filter is told of one at sample `guess`."""
    f, span = np.zeros(window.record.f.shape), bank.levels.size.copy()
    f[guess:, fault] = span[fault] = size
    around = shocks_of(bank, window, jnp.asarray(f), jnp.asarray(span))
    return causes_in(bank, window, around).weight[:, fault]
