"""Carrying out a scenario: a closed-loop run, and the log that telemetry would hold of it."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.simulation.closed_loop import Conditions, Record, closed_loop, with_faults
from faultgauge.simulation.free_run import RATE_STEP, fastest_rate
from faultgauge.simulation.satellite.observatory import AXES, PERIOD
from faultgauge.simulation.satellite.observatory import run as fly
from faultgauge.simulation.scenario import MOST_STEPS, TRUTH, Drive, Scenario, read_scenario
from faultgauge.simulation.schedules import Schedule, grid, inject, truth
from faultgauge.simulation.sources import Clock
from faultgauge.telemetry import Run

__all__ = ["INPUTS", "REFERENCES", "driven", "noise", "rehearse", "simulate", "truths"]

SUBSTEPS = 20  # of a sample, at least: a fault that begins between samples is seen in time
POINTS = 500
INPUTS, REFERENCES, NOISE = range(3)  # streams of random numbers: what one draws moves no other


def simulate(scenario: Scenario | str | Path) -> Run:
    """Run a scenario (or the file of one) in closed loop.

    The run holds the inputs as commanded inside their limits, the outputs as measured (NaN where
    no sample came) and `true_<fault>` for every fault: its size, NaN while it is not stuck, 1
    while it is dropped out. The same scenario gives the same run.

    Raises `InputError` for a scenario that makes no sense, or whose plant leaves all bounds.
    """
    if not isinstance(scenario, Scenario):
        scenario = read_scenario(scenario)
    t = grid(scenario.samples, scenario.step)[:, 0]
    kept = slice(None, None, scenario.log_every)
    columns = _flown(scenario, t) if scenario.flight else _looped(scenario, t)
    columns = {name: column[kept] for name, column in columns.items()}
    columns |= truths(scenario, t[kept])
    for name in scenario.plant.signals.output_names:
        if np.isnan(columns[name]).all():
            raise InputError(
                f"{scenario.source}: output {name!r} gives no sample in the whole run; shorten "
                "its dropout."
            )
    return Run(scenario.name, scenario.source, t[kept], columns)


def _looped(
    scenario: Scenario, t: Float[np.ndarray, "samples"]
) -> dict[str, Float[np.ndarray, "samples"]]:
    """Inputs and outputs of the plant under its own controller."""
    record, _ = rehearse(scenario, t)
    signals = scenario.plant.signals
    columns = dict(zip(signals.input_names, np.asarray(record.u).T, strict=True))
    return columns | dict(zip(signals.output_names, np.asarray(record.measured).T, strict=True))


def rehearse(scenario: Scenario, t: Float[np.ndarray, "samples"]) -> tuple[Record, int]:
    """The loop run through, and the integration steps per sample that it took.

    Raises `InputError` where it makes no sense or leaves all bounds.
    """
    _check_delays(scenario, t[-1])
    substeps = scenario.substeps or SUBSTEPS
    record = _record(scenario, t, substeps)
    needed = substeps if scenario.substeps else _needed(scenario, record)
    if needed > substeps:
        substeps = needed
        record = _record(scenario, t, substeps)
    _check_finite(scenario, t, record)
    return record, substeps


def _check_delays(scenario: Scenario, duration: float) -> None:
    for each in scenario.plant.signals.inputs:
        if each.delay >= duration:
            raise InputError(
                f"{scenario.source}: the delay of input {each.name!r}, {each.delay:g} s, leaves "
                f"nothing of a run of {duration:g} s; lengthen the run."
            )


def _flown(
    scenario: Scenario, t: Float[np.ndarray, "samples"]
) -> dict[str, Float[np.ndarray, "samples"]]:
    """Command and telemetry of one wheel of a satellite, and the attitude [deg] as known on board.

    Faults and disturbances are in this wheel alone.
    """
    flight, signals = scenario.flight, scenario.plant.signals
    assert flight is not None
    for each in signals.inputs:
        if each.delay:
            raise InputError(
                f"{scenario.source}: the wheel's input {each.name!r} has a delay, which the flight "
                "of a satellite does not have; remove `delay` from the plant file or the flight "
                "from the scenario."
            )
    every = [*scenario.faults, *scenario.disturbances]
    happens = inject(every, signals, t)
    flown = fly(
        scenario.plant,
        scenario.samples * PERIOD,
        scenario.seed,
        faults={flight.axis: [s for s in every if not _drops_samples(s)]},
        angles=flight.angles,
        momenta=flight.momenta,
    )
    axis = AXES.index(flight.axis)
    true = np.stack([flown.torque[:, axis], flown.momentum[:, axis]], axis=1)
    added = np.where(np.isnan(happens.stuck.y), noise(scenario), 0.0)
    measured = np.where(happens.dropped, np.nan, true + added)
    columns = {signals.input_names[0]: np.asarray(flown.u)[:, axis]}
    columns |= dict(zip(signals.output_names, measured.T, strict=True))
    attitude = np.rad2deg(np.asarray(flown.estimated)).T
    return columns | dict(zip(AXES, attitude, strict=True))


def _drops_samples(schedule: Schedule) -> bool:
    return schedule.effect == "dropout" and schedule.enters == "output"


def noise(scenario: Scenario) -> Float[np.ndarray, "samples outputs"]:
    """Of the sensors, in the outputs' units."""
    return np.stack(
        [
            sigma
            * np.random.default_rng([scenario.seed, NOISE, j]).standard_normal(scenario.samples)
            for j, sigma in enumerate(scenario.sigma)
        ],
        axis=1,
    )


def truths(
    scenario: Scenario, t: Float[np.ndarray, "rows"]
) -> dict[str, Float[np.ndarray, "rows"]]:
    """`true_<fault>` of every fault; one that acts in no row is refused."""
    for fault in scenario.faults:
        if not fault.profile.active(t).any():
            raise InputError(
                f"{scenario.source}: [faults.{fault.name}] acts in no row of the log, which "
                f"ends at {t[-1]:g} s; change its times or remove it."
            )
    return {TRUTH + fault.name: truth(fault, t) for fault in scenario.faults}


def _record(scenario: Scenario, t: Float[np.ndarray, "samples"], substeps: int) -> Record:
    if scenario.samples * substeps > MOST_STEPS:
        raise InputError(
            f"{scenario.source}: {substeps} integration steps for each of {scenario.samples} "
            f"samples are more than {MOST_STEPS}; shorten the run, or set `substeps` to less."
        )
    signals = scenario.plant.signals
    happens = inject(
        [*scenario.faults, *scenario.disturbances],
        signals,
        grid(scenario.samples, scenario.step, substeps),
    )
    holds = [each.hold != "zero" for each in signals.inputs]
    conditions = Conditions(
        feedforward=jnp.asarray(driven(scenario, t, INPUTS, holds)),
        reference=jnp.asarray(driven(scenario, t, REFERENCES, [False] * len(signals.outputs))),
        noise=jnp.asarray(noise(scenario)),
        f=jnp.asarray(happens.f),
        stuck=jax.tree.map(jnp.asarray, happens.stuck),
        dropped=jnp.asarray(happens.dropped[:, 0]),
    )
    plant = with_faults(scenario.plant, happens.faults)
    x0 = jnp.asarray(scenario.x0)
    return jax.device_get(closed_loop(plant, scenario.controller, x0, conditions, scenario.step))


def driven(
    scenario: Scenario, t: Float[np.ndarray, "samples"], stream: int, linear: list[bool]
) -> Float[np.ndarray, "samples channels"]:
    """All inputs or all references, one column each."""
    signals = scenario.plant.signals
    if stream == INPUTS:
        drives, table, names = scenario.inputs, "inputs", signals.input_names
    else:
        drives, table, names = scenario.references, "references", signals.output_names
    columns = np.zeros((len(t), len(drives)))
    for j, (drive, name) in enumerate(zip(drives, names, strict=True)):
        clock = Clock(t, scenario.step, linear[j], scenario.folder)
        rng = np.random.default_rng([scenario.seed, stream, j])
        columns[:, j] = _signal(drive, clock, rng, f"{scenario.source}: [{table}.{name}]")
    return columns


def _signal(
    drive: Drive, clock: Clock, rng: np.random.Generator, where: str
) -> Float[np.ndarray, "samples"]:
    if drive.source is None:
        return np.full(len(clock.t), drive.offset)
    try:
        return drive.offset + drive.source.signal(clock, rng)
    except InputError as wrong:
        raise InputError(f"{where} {wrong}") from None


def _needed(scenario: Scenario, record: Record) -> int:
    """Integration steps per sample that the plant asks for where the run has led it."""
    points = np.linspace(0, scenario.samples - 1, POINTS).astype(int)
    rate = fastest_rate(scenario.plant, np.asarray(record.x)[points], np.asarray(record.u)[points])
    return int(min(np.ceil(scenario.step * rate / RATE_STEP), MOST_STEPS))


def _check_finite(scenario: Scenario, t: Float[np.ndarray, "samples"], record: Record) -> None:
    whole = np.concatenate([record.u, record.x, record.y], axis=1)
    wrong = np.flatnonzero(~np.isfinite(whole).all(axis=1))
    if wrong.size:
        raise InputError(
            f"{scenario.source}: the simulation leaves all bounds at t = {t[wrong[0]]:g} s; check "
            "gains, initial values and sizes, or raise `substeps`."
        )
