"""The paper's satellite: three large wheels, a slew of 64 degrees in pitch, then hold.

Constants as in the resolved case of the paper's section 5: an inertia and sensors of the class of
a large observatory; the disturbances are 1 to 4 mN*m constant and at the orbital rate.
"""

from collections.abc import Mapping, Sequence
from typing import cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Stuck
from faultgauge.plants.signals import Signals
from faultgauge.simulation.channels import every_channel, happening
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.policy import Policy
from faultgauge.simulation.satellite.controller import AttitudeController
from faultgauge.simulation.satellite.determination import AttitudeFilter
from faultgauge.simulation.satellite.loop import (
    NOISES,
    Now,
    Satellite,
    SatelliteState,
    Telemetry,
    fly,
    start,
)
from faultgauge.simulation.satellite.orbit import Orbit
from faultgauge.simulation.satellite.sensors import EarthSensor, Gyro, SunSensors
from faultgauge.simulation.schedules import Schedule, grid

__all__ = [
    "AXES",
    "HOLD",
    "INERTIA",
    "KNOWN_TO",
    "MOMENTA",
    "PERIOD",
    "SLEW",
    "STEPS_PER_PERIOD",
    "Three",
    "paper_satellite",
    "paper_start",
    "run",
    "run_satellite",
]

Three = tuple[float, float, float]
AXES: tuple[str, ...] = ("roll", "pitch", "yaw")
PERIOD, STEPS_PER_PERIOD = 0.25, 5  # s: control at 4 Hz, integration at 20 Hz
PIECE = 4000  # control periods
INERTIA = (3000.0, 2800.0, 2500.0)  # kg*m^2, roll, pitch, yaw
MOMENTA = (20.0, 40.0, -20.0)  # N*m*s
SLEW = (3.0, 64.0, -2.0)  # deg, roll, pitch, yaw
HOLD = (0.0, 0.0, 0.0)  # deg: nothing to turn
KNOWN_TO = (0.2, -0.3, 0.2)  # deg: the first attitude estimate is off by this
CONSTANT, ORBITAL = (2e-3, 1e-3, -4e-3), (1e-3, 4e-3, 2e-3)  # N*m


def paper_satellite(
    wheel: GrayBoxPlant, policy: Policy | None = None, tachometer: float = 0.0
) -> Satellite:
    """The satellite with a `wheel` on each axis."""
    gyro, inertia = Gyro(), jnp.array(INERTIA)
    return Satellite(
        wheel=wheel,
        axes=jnp.eye(3),
        allocation=jnp.eye(3),
        inertia=inertia,
        disturbance=jnp.array([CONSTANT, ORBITAL]),
        orbit=Orbit(),
        gyro=gyro,
        earth=EarthSensor(),
        sun=SunSensors(),
        filter=AttitudeFilter(gyro.arw, gyro.rrw),
        controller=AttitudeController(inertia),
        dt=PERIOD,
        substeps=STEPS_PER_PERIOD,
        policy=policy,
        tachometer=tachometer,
    )


def paper_start(
    satellite: Satellite, angles: Three = SLEW, momenta: Sequence[float] = MOMENTA
) -> SatelliteState:
    """Turned by `angles` (roll, pitch, yaw) [deg]; the wheels' `momenta` in N*m*s."""
    return start(
        satellite,
        jnp.deg2rad(jnp.array(angles)),
        jnp.array(tuple(momenta), float),
        jnp.deg2rad(jnp.array(KNOWN_TO)),
    )


def run(
    wheel: GrayBoxPlant,
    seconds: float,
    seed: int,
    everywhere: Sequence[Schedule] = (),
    faults: Mapping[str, Sequence[Schedule]] | None = None,
    angles: Three = SLEW,
    momenta: Three = MOMENTA,
    policy: Policy | None = None,
    tachometer: float = 0.0,
) -> Telemetry:
    """Fly the paper's satellite for `seconds` with `everywhere` in each wheel and `faults` in the
    wheel of an axis; NumPy arrays, one row per control period. A `policy` that commands the
    wheels reads their momenta with noise of standard deviation `tachometer` [N*m*s].

    A flight is made of pieces of one length with the same channels open to faults, so that every
    flight is the same compiled program and a day takes no more memory than an hour.
    """
    if not set(faults or ()) <= set(AXES):
        raise ValueError(
            f"faults name an axis that is none of {', '.join(AXES)}: {list(faults or ())}"
        )
    per_wheel = [[*everywhere, *(faults or {}).get(axis, ())] for axis in AXES]
    satellite = paper_satellite(wheel, policy, tachometer)
    return run_satellite(satellite, seconds, seed, per_wheel, angles, momenta)


def run_satellite(
    satellite: Satellite,
    seconds: float,
    seed: int,
    per_wheel: Sequence[Sequence[Schedule]],
    angles: Three,
    momenta: Sequence[float],
) -> Telemetry:
    """`run` for any satellite at the paper's rates, with schedules and momenta for each wheel."""
    signals = satellite.wheel.signals
    channels = every_channel(signals)
    wheel = cast(GrayBoxPlant, satellite.wheel)
    if satellite.stacked:
        opened = eqx.filter_vmap(lambda one: with_faults(one, channels))(wheel)
    else:
        opened = with_faults(wheel, channels)
    satellite = eqx.tree_at(lambda s: s.wheel, satellite, opened)
    steps = round(seconds / PERIOD)
    state, flown = paper_start(satellite, angles, momenta), []
    rng, read = (np.random.default_rng([seed, stream]) for stream in (1, 2))
    for first in range(0, steps, PIECE):
        times = grid(first + PIECE, PERIOD, STEPS_PER_PERIOD)[first:]
        happens = [_on(schedules, signals, times) for schedules in per_wheel]
        during = jax.tree.map(lambda *wheels: jnp.asarray(np.stack(wheels, axis=2)), *happens)
        noise = rng.standard_normal((PIECE, NOISES))
        if satellite.policy is not None:
            noise = np.concatenate([noise, read.standard_normal((PIECE, len(per_wheel)))], axis=1)
        state, telemetry = fly(satellite, state, Now(jnp.asarray(noise), *during))
        flown.append(jax.device_get(telemetry))
    return jax.tree.map(lambda *pieces: np.concatenate(pieces)[:steps], *flown)


def _on(
    schedules: Sequence[Schedule],
    signals: Signals,
    times: Float[np.ndarray, "steps substeps"],
) -> tuple[Float[np.ndarray, "steps substeps channels"], Stuck]:
    """(sizes by channel, what is stuck) in one wheel."""
    happens = happening(schedules, signals, times)
    if happens.dropped.any():
        raise ValueError("a flight has no samples to drop: its telemetry is the truth")
    return happens.f, happens.stuck
