"""Satellites to fly: any wheel, any axes, with or without noise and faults."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.plants.plant import Stuck
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.satellite.controller import AttitudeController
from faultgauge.simulation.satellite.determination import AttitudeFilter
from faultgauge.simulation.satellite.loop import NOISES, Now, Satellite
from faultgauge.simulation.satellite.orbit import Orbit
from faultgauge.simulation.satellite.sensors import EarthSensor, Gyro, SunSensors
from faultgauge.simulation.schedules import Constant, Schedule, Sine, grid, inject

INERTIA = (3000.0, 2800.0, 2500.0)
PART = 40  # steps, 10 s; runs of one length share one compiled program


@pytest.fixture(scope="session")
def happening() -> tuple[Schedule, ...]:
    """One fault after the other: all but the last are inside the wheel."""
    return (
        Schedule("friction", "state", "h", Constant(0.1, 30.0, 40.0)),
        Schedule("unbalance", "state", "h", Sine(6.72e-4, 0.2)),
        Schedule("command", "input", "u", Constant(0.1, 40.0, 50.0)),
        Schedule("gain", "gain", "u", Constant(0.5, 50.0, 60.0)),
        Schedule("stuck", "state", "h", Constant(0.1, 60.0, 70.0), "stuck"),
        Schedule("equation 18", "output", "T", Constant(0.1, 70.0, 80.0), "stuck"),
    )


@pytest.fixture(scope="session")
def parts() -> Callable[[Now], list[Now]]:
    """What happens, in parts of 10 s."""

    def cut(during: Now) -> list[Now]:
        steps = len(during.noise)
        return [jax.tree.map(lambda a, k=k: a[k : k + PART], during) for k in range(0, steps, PART)]

    return cut


@pytest.fixture(scope="session")
def large_wheel() -> GrayBoxPlant:
    return load_plant("reaction_wheel")


@pytest.fixture(scope="session")
def ideal_wheel() -> Callable[[str], GrayBoxPlant]:
    """A wheel without friction or limits: d(h)/dt as given, "u" or (a locked motor) "0*u"."""

    def wheel(derivative: str) -> GrayBoxPlant:
        text = f"""name = "ideal wheel"
[states.h]
derivative = "{derivative}"
[inputs.u]
[outputs.T]
value = "d(h)"
[outputs.hm]
value = "h"
"""
        return GrayBoxPlant.untrained(parse_plant(text))

    return wheel


@pytest.fixture(scope="session")
def build() -> Callable[..., Satellite]:
    """A satellite on which nothing acts from outside unless `disturbance` says so."""

    def satellite(wheel: GrayBoxPlant, **changes: object) -> Satellite:
        gyro = changes.get("gyro", Gyro())
        assert isinstance(gyro, Gyro)
        axes = np.asarray(changes.pop("axes", np.eye(3)))
        parts = {
            "inertia": jnp.array(INERTIA),
            "disturbance": jnp.zeros((2, 3)),
            "orbit": Orbit(),
            "gyro": gyro,
            "earth": EarthSensor(),
            "sun": SunSensors(),
            "filter": AttitudeFilter(gyro.arw, gyro.rrw),
            "controller": AttitudeController(jnp.array(INERTIA)),
            "dt": 0.25,
            "substeps": 5,
        }
        allocation = jnp.asarray(np.linalg.pinv(axes))
        return Satellite(
            wheel=wheel, axes=jnp.asarray(axes), allocation=allocation, **(parts | changes)
        )

    return satellite


@pytest.fixture(scope="session")
def conditions() -> Callable[..., tuple[GrayBoxPlant, Now]]:
    """(the wheel with its faults, what happens): `schedules` in the wheel `faulty`, no other."""

    def happens(
        wheel: GrayBoxPlant,
        steps: int,
        *,
        dt: float = 0.25,
        substeps: int = 5,
        wheels: int = 3,
        schedules: Sequence[Schedule] = (),
        faulty: int = 0,
        noise: np.ndarray | None = None,
    ) -> tuple[GrayBoxPlant, Now]:
        injection = inject(schedules, wheel.signals, grid(steps, dt, substeps))
        mine = np.arange(wheels) == faulty
        f = injection.f[:, :, None, :] * mine[:, None]
        stuck = [np.where(mine[:, None], a[:, :, None, :], np.nan) for a in injection.stuck]
        noise = np.zeros((steps, NOISES)) if noise is None else noise
        now = Now(jnp.asarray(noise), jnp.asarray(f), Stuck(*map(jnp.asarray, stuck)))
        return with_faults(wheel, injection.faults), jax.tree.map(jnp.asarray, now)

    return happens
