"""How far noise in what the equations read has shifted their constants.

Least squares holds its regressors for exact. Noise in them, the smoothed states x and the
derivatives that other equations read, shrinks what they explain, and no standard error knows it.
The shift is estimated by adding the same noise once more (J. R. Cook and L. A. Stefanski, J.
American Statistical Association 89, 1994): to first order in its variance, one Gauss-Newton step on
the noisier samples is as long as the shift that is there already,

    shift = -(sum J' J)^-1 (sum J' r - sum J0' r0)

A pair of draws of opposite sign takes off what is linear in the noise. Under one symmetric kernel
the noises of x and of its derivative at a sample are uncorrelated, so they are drawn apart.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float

from faultgauge.identification.equation.fit import Material
from faultgauge.identification.samples import Channels, Samples

__all__ = ["Left", "noise_left", "shift_by_noise"]

# (sum J' r, sum J' J) at samples
Normal: TypeAlias = Callable[
    [Samples], tuple[Float[np.ndarray, "unknowns"], Float[np.ndarray, "unknowns unknowns"]]
]


class Left(NamedTuple):
    """Standard deviations of the noise that the smoothing left in x and dx, in their units; 0 where
    nothing was smoothed."""

    x: Float[np.ndarray, "states"]
    dx: Float[np.ndarray, "states"]


def noise_left(how: Channels, states: tuple[str, ...], given: Material) -> Left | None:
    """What is left of the columns' noise; None where no kernel went over them."""
    first = given.stretches[0]
    if first.unsmoothed is None:
        return None
    kernel = first.unsmoothed.kernel
    x, dx = np.zeros(len(states)), np.zeros(len(states))
    for k, (state, (_, order)) in enumerate(zip(states, how.sources, strict=True)):
        if state in given.noise:
            sd = given.noise[state]["column_noise"]
            x[k] = sd * kernel.noise_gain(order, first.step)
            dx[k] = given.noise[state]["derivative_noise"]
    return Left(x, dx)


def shift_by_noise(
    normal: Normal, samples: Samples, left: Left, ridge: float
) -> Float[np.ndarray, "unknowns"]:
    """How far noise of the size of `left` moves the least squares over `samples`."""
    rng = np.random.default_rng(0)
    x, dx = (sd * rng.standard_normal(samples.x.shape) for sd in left)
    pull, _ = normal(samples)
    noisy = [normal(samples._replace(x=samples.x + s * x, dx=samples.dx + s * dx)) for s in (1, -1)]
    more, hessian = (np.mean(each, axis=0) for each in zip(*noisy, strict=True))
    return -np.linalg.pinv(hessian + ridge * np.eye(len(hessian))) @ (more - pull)
