"""A scenario one sample at a time, under faults that nobody knew beforehand.

The same pure steps as `simulate`, with every channel open to faults: what is injected later is a
number in the same compiled program. Everything is compiled when a bench has been made.
"""

import abc
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from faultgauge.errors import InputError
from faultgauge.simulation.channels import Happening, every_channel, happening
from faultgauge.simulation.closed_loop import Conditions, Loop, with_faults
from faultgauge.simulation.run_scenario import (
    INPUTS,
    REFERENCES,
    driven,
    noise,
    rehearse,
    simulate,
    truths,
)
from faultgauge.simulation.satellite import loop as attitude
from faultgauge.simulation.satellite.observatory import (
    AXES,
    PERIOD,
    STEPS_PER_PERIOD,
    paper_satellite,
    paper_start,
)
from faultgauge.simulation.scenario import Scenario
from faultgauge.simulation.schedules import Schedule, grid

__all__ = ["Bench", "Row", "bench_of"]

Row = dict[str, float]


class Bench(abc.ABC):
    """Inputs, outputs and whatever else a log holds, sample by sample."""

    columns: tuple[str, ...]

    @abc.abstractmethod
    def sample(self, schedules: Sequence[Schedule]) -> Row:
        """The next sample while `schedules` act."""


def bench_of(scenario: Scenario) -> Bench:
    """The scenario's bench, compiled. It has been run through once as it stands in its file, so
    what `simulate` refuses is refused here, as `InputError`; so is `[accommodation]`."""
    if scenario.accommodation is not None:
        raise InputError(
            f"{scenario.source}: [accommodation] does not run against the clock yet; take the "
            "table out, or leave --realtime out."
        )
    return _Flight(scenario) if scenario.flight else _ClosedLoop(scenario)


@eqx.filter_jit
def _loop_step(loop: Loop, state: Any, now: Conditions, later: Any) -> tuple:
    return loop.step(state, now, later)


class _ClosedLoop(Bench):
    """A plant under its own controller."""

    def __init__(self, scenario: Scenario) -> None:
        signals = scenario.plant.signals
        t = grid(scenario.samples, scenario.step)[:, 0]
        _, _, self.substeps = rehearse(scenario, t)
        truths(scenario, t)
        self.scenario = scenario
        holds = [each.hold != "zero" for each in signals.inputs]
        self.feedforward = driven(scenario, t, INPUTS, holds)
        self.reference = driven(scenario, t, REFERENCES, [False] * len(signals.outputs))
        self.noise = noise(scenario)
        self.columns = (*signals.input_names, *signals.output_names)
        plant = with_faults(scenario.plant, every_channel(signals))
        self.loop = Loop(plant, scenario.controller, scenario.step, self.substeps)
        start = self.loop.init(jnp.asarray(scenario.x0), jnp.asarray(self.feedforward[0]))
        self.state, self.at = start, 0
        self.sample(())  # compiles
        self.state, self.at = start, 0

    def sample(self, schedules: Sequence[Schedule]) -> Row:
        scenario, k = self.scenario, self.at
        every = [*schedules, *scenario.disturbances]
        times = grid(1, scenario.step, self.substeps, first=k)
        f, stuck, dropped = happening(every, scenario.plant.signals, times)
        now = Conditions(
            self.feedforward[k],
            self.reference[k],
            self.noise[k],
            f[0],
            jax.tree.map(lambda a: a[0], stuck),
            dropped[0, 0],
        )
        later = self.feedforward[min(k + 1, scenario.samples - 1)]
        self.state, (record, _) = _loop_step(self.loop, self.state, now, later)
        u, x, y, measured = jax.device_get((record.u, record.x, record.y, record.measured))
        if not np.isfinite(np.concatenate([u, x, y])).all():
            raise _unbounded(scenario, float(times[0, 0]))
        self.at += 1
        return dict(zip(self.columns, [*u.tolist(), *measured.tolist()], strict=True))


@eqx.filter_jit
def _flight_step(satellite: attitude.Satellite, state: Any, now: attitude.Now) -> tuple:
    return attitude.step(satellite, state, now)


class _Flight(Bench):
    """A wheel of a satellite under attitude control."""

    def __init__(self, scenario: Scenario) -> None:
        assert scenario.flight is not None
        simulate(scenario)  # refuses what makes no sense
        signals = scenario.plant.signals
        self.scenario, self.flight = scenario, scenario.flight
        self.noise = noise(scenario)
        self.columns = (*signals.input_names, *signals.output_names, *AXES)
        self.satellite = paper_satellite(with_faults(scenario.plant, every_channel(signals)))
        start = paper_start(self.satellite, self.flight.angles, self.flight.momenta)
        self.state, self.at = start, 0
        self.random = np.random.default_rng(0)
        self.sample(())  # compiles
        self.state, self.at = start, 0
        self.random = np.random.default_rng([scenario.seed, 1])  # as in a whole flight

    def sample(self, schedules: Sequence[Schedule]) -> Row:
        scenario, k = self.scenario, self.at
        signals = scenario.plant.signals
        every = [*schedules, *scenario.disturbances]
        own = happening(every, signals, grid(1, PERIOD, STEPS_PER_PERIOD, first=k)[0])
        self.state, flown = _flight_step(self.satellite, self.state, self._now(own))
        self.at += 1
        flown, axis = jax.device_get(flown), AXES.index(self.flight.axis)
        true = np.array([flown.torque[axis], flown.momentum[axis]])
        measured = true + np.where(np.isnan(own.stuck.y[0]), self.noise[k], 0.0)
        measured = np.where(own.dropped[0], np.nan, measured)
        if not np.isfinite([*true, *flown.estimated]).all():
            raise _unbounded(scenario, k * PERIOD)
        values = [flown.u[axis], *measured, *np.rad2deg(flown.estimated)]
        return dict(zip(self.columns, map(float, values), strict=True))

    def _now(self, own: Happening) -> attitude.Now:
        """What happens in all wheels, `own` in that of the flight's axis."""
        signals = self.scenario.plant.signals
        calm = happening((), signals, np.zeros(STEPS_PER_PERIOD))
        wheels = [own if axis == self.flight.axis else calm for axis in AXES]
        f, stuck = jax.tree.map(
            lambda *each: np.stack(each, axis=1), *((wheel.f, wheel.stuck) for wheel in wheels)
        )
        return attitude.Now(jnp.asarray(self.random.standard_normal(attitude.NOISES)), f, stuck)


def _unbounded(scenario: Scenario, t: float) -> InputError:
    return InputError(
        f"{scenario.source}: the simulation leaves all bounds at t = {t:g} s; inject less, or "
        "raise `substeps`."
    )
