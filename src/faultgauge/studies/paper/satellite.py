"""The paper's satellite: three large wheels, a slew of 64 degrees in pitch, then hold.

Constants as in the resolved case of the paper's section 5: an inertia and sensors of the class of
a large observatory; the disturbances are 1 to 4 mN*m constant and at the orbital rate.
"""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Stuck
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.satellite.controller import AttitudeController
from faultgauge.simulation.satellite.determination import AttitudeFilter
from faultgauge.simulation.satellite.loop import (
    NOISES,
    Now,
    Satellite,
    State,
    Telemetry,
    fly,
    start,
)
from faultgauge.simulation.satellite.orbit import Orbit
from faultgauge.simulation.satellite.sensors import EarthSensor, Gyro, SunSensors
from faultgauge.simulation.schedules import Schedule, Sine, grid, inject

__all__ = [
    "AXES",
    "HOLD",
    "STEPS_PER_PERIOD",
    "inner_disturbance",
    "paper_satellite",
    "paper_start",
    "run",
]

AXES = ("roll", "pitch", "yaw")
PERIOD, STEPS_PER_PERIOD = 0.25, 5  # s: control at 4 Hz, integration at 20 Hz
INERTIA = (3000.0, 2800.0, 2500.0)  # kg*m^2, roll, pitch, yaw
MOMENTA = (20.0, 40.0, -20.0)  # N*m*s
SLEW = (3.0, 64.0, -2.0)  # deg, roll, pitch, yaw
HOLD = (0.0, 0.0, 0.0)
KNOWN_TO = (0.2, -0.3, 0.2)  # deg: the first attitude estimate is off by this
CONSTANT, ORBITAL = (2e-3, 1e-3, -4e-3), (1e-3, 4e-3, 2e-3)  # N*m
UNBALANCE, RIPPLE = 0.02, 0.2  # rad and rad/s: theta_a and omega_a of the disturbance f(t)


def inner_disturbance(wheel: GrayBoxPlant) -> Schedule:
    """f(t) = theta_a J omega_a^2 sin(omega_a t), N*m: inside the wheel, known to no model."""
    size = UNBALANCE * float(wheel.parameters["J"]) * RIPPLE**2
    return Schedule("f", "state", "h", Sine(size, RIPPLE), unit="N*m")


def paper_satellite(wheel: GrayBoxPlant) -> Satellite:
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
    )


def paper_start(satellite: Satellite, angles: tuple[float, float, float] = SLEW) -> State:
    """Turned by `angles` (roll, pitch, yaw) [deg]; momenta 20, 40 and -20 N*m*s."""
    return start(
        satellite,
        jnp.deg2rad(jnp.array(angles)),
        jnp.array(MOMENTA),
        jnp.deg2rad(jnp.array(KNOWN_TO)),
    )


def run(
    wheel: GrayBoxPlant,
    seconds: float,
    seed: int,
    everywhere: Sequence[Schedule] = (),
    faults: Mapping[str, Sequence[Schedule]] | None = None,
    angles: tuple[float, float, float] = SLEW,
) -> Telemetry:
    """Fly the paper's satellite for `seconds` with `everywhere` in each wheel and `faults` in the
    wheel of an axis; NumPy arrays, one row per control period."""
    faults = faults or {}
    every = [*everywhere, *(s for axis in AXES for s in faults.get(axis, ()))]
    owner = [None] * len(everywhere) + [axis for axis in AXES for _ in faults.get(axis, ())]
    additive = tuple(s.effect == "add" or s.enters == "gain" for s in every)
    satellite = paper_satellite(wheel)
    steps = round(seconds / satellite.dt)
    times = grid(steps, satellite.dt, satellite.substeps)
    injection = inject(every, wheel.signals, times)
    mine = np.array(
        [
            [axis in (None, wanted) for axis, added in zip(owner, additive, strict=True) if added]
            for wanted in AXES
        ],
        float,
    ).reshape(len(AXES), -1)
    stuck = [
        inject([*everywhere, *faults.get(axis, ())], wheel.signals, times).stuck for axis in AXES
    ]
    noise = np.random.default_rng([seed, 1]).standard_normal((steps, NOISES))
    during = Now(
        jnp.asarray(noise),
        jnp.asarray(injection.f[:, :, None, :] * mine),
        Stuck(*(jnp.asarray(np.stack(channel, axis=2)) for channel in zip(*stuck, strict=True))),
    )
    satellite = paper_satellite(with_faults(wheel, injection.faults))
    return jax.device_get(fly(satellite, paper_start(satellite, angles), during)[1])
