"""A state observer without a fault: the reference whose innovation is the residual."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.errors import InputError
from faultgauge.observers.gains import spectral_radius
from faultgauge.observers.observer import CurrentObserver, Design, OperatingPoints, linearise
from faultgauge.plants.plant import Plant
from faultgauge.simulation.free_run import substeps_for

__all__ = ["LuenbergerObserver", "design_luenberger"]

SPREAD = 0.05  # place_poles wants distinct poles: they differ by 5 % of the bandwidth


class LuenbergerObserver(CurrentObserver):
    """x = x- - L (h(x-) - y); no fault is estimated."""

    plant: Plant
    target: int = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    gain: Float[Array, "states outputs"]

    def correct(
        self, x: Float[Array, "states"], f: Float[Array, ""], e: Float[Array, "outputs"]
    ) -> tuple[Float[Array, "states"], Float[Array, ""]]:
        return x - self.gain @ e, f


def design_luenberger(
    plant: Plant,
    points: OperatingPoints,
    dt: float,
    bandwidth: float,
    measured: tuple[str, ...],
    max_step: float,
) -> Design:
    """Poles near exp(-bandwidth dt) at the median operating point (Tits and Yang's method).

    Raises `InputError` where the measured outputs do not determine all states.
    """
    signals = plant.signals
    substeps = substeps_for(dt, max_step)
    linear = linearise(plant, points, dt, substeps)
    used = [j for j, name in enumerate(signals.output_names) if name in measured]
    A = np.median(linear.A, axis=0)
    C = np.median(linear.C, axis=0)[used]
    n = len(A)
    observability = np.concatenate([C @ np.linalg.matrix_power(A - np.eye(n), k) for k in range(n)])
    if np.linalg.matrix_rank(observability / np.abs(observability).max(axis=0, initial=1e-300)) < n:
        raise InputError(
            f"the measured outputs ({', '.join(measured)}) do not determine all of the states "
            f"{', '.join(signals.state_names)}; measure one more, or use --reference free."
        )
    poles = np.exp(-bandwidth * dt * (1 + SPREAD * np.arange(n)))
    gain = np.zeros((n, len(signals.outputs)))
    from scipy.signal import place_poles  # half a second to load, which few commands need

    placed: Any = place_poles(A.T, (C @ A).T, poles)  # a Bunch, which SciPy does not type
    gain[:, used] = placed.gain_matrix.T
    error = (np.eye(n) - gain @ linear.C) @ linear.A
    observer = LuenbergerObserver(plant, -1, substeps, jnp.asarray(gain))
    names = ", ".join(signals.output_names[j] for j in used)
    continuous = tuple(complex(s) for s in np.log(poles) / dt)
    return Design(observer, names, n, continuous, True, spectral_radius(error))
