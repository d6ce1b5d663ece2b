"""Satellites whose wheels are redundant, each wheel with a learned model of its own."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.accommodation.allocation import NullMotion, Reconfiguration
from faultgauge.accommodation.units import Units
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.simulation.satellite.loop import Satellite, Telemetry
from faultgauge.simulation.satellite.observatory import paper_satellite
from faultgauge.simulation.schedules import Constant, Schedule
from faultgauge_studies.paper.accommodating.setting import (
    FLOOR,
    PERSISTENCE,
    TACHOMETER,
    by_posterior,
)
from faultgauge_studies.paper.learning import rms

__all__ = ["HELD", "held", "loss", "off_target", "satellite"]

HELD = 0.05  # deg: pointing is held within it


def satellite(
    wheels: Sequence[GrayBoxPlant],
    models: Sequence[Model],
    axes: Float[np.ndarray, "3 wheels"],
    spare_of: tuple[int, ...],
    null_motion: NullMotion | None = None,
) -> Satellite:
    """The paper's satellite on other wheels under `Reconfiguration`, a model for each."""
    each = stacked([by_posterior(one, "estimate_and_friction") for one in models])
    units = Units(spare_of, FLOOR, PERSISTENCE)
    policy = Reconfiguration(each, jnp.asarray(axes), units, 1, null_motion)
    plain = paper_satellite(wheels[0], policy, TACHOMETER)
    return replace(
        plain,
        wheel=stacked(list(wheels)),
        stacked=True,
        axes=jnp.asarray(axes),
        allocation=jnp.asarray(np.linalg.pinv(axes)),
    )


def stacked(alike: list[Any]) -> Any:
    """Modules of one structure as one, their arrays with the wheels first."""
    return jax.tree.map(lambda *a: jnp.stack(a) if eqx.is_array_like(a[0]) else a[0], *alike)


def loss(start: float, size: float = 1.0) -> Schedule:
    """Loss of effectiveness from `start` [s] on; 1 is all of it."""
    return Schedule("loss", "gain", "u", Constant(size, start))


def off_target(flown: Telemetry) -> Float[np.ndarray, "samples"]:
    """The angle between the true attitude and the wanted one, deg."""
    return np.rad2deg(np.linalg.norm(np.asarray(flown.attitude), axis=1))


def held(flown: Telemetry, onset: float) -> dict[str, float]:
    """Pointing from `onset` [s] on: peak, when it is back for good, and the RMS of the last 100 s;
    how close the wheels come to their limits; the wheels that are given up, and when."""
    t, off = np.asarray(flown.t), off_target(flown)
    after = t >= onset
    outside = t[after][off[after] > HELD]
    gone = ~flown.info.used
    late = t[after & np.any(np.diff(gone, axis=0, prepend=gone[:1]), axis=1)]
    return {
        "peak_deg": float(off[after].max()),
        "back_after_s": float(outside[-1] - onset) if outside.size else 0.0,
        "rms_end_deg": rms(off[t >= t[-1] - 100.0]),
        "decided_after_s": float(late[0] - onset) if late.size else np.inf,
        "largest_momentum": float(np.abs(flown.momentum).max()),
        "largest_command": float(np.abs(flown.u).max()),
        "rank": float(flown.info.rank[-1]),
    }
