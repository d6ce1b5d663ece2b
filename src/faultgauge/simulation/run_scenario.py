"""Carrying out a scenario: a closed-loop run, and the log that telemetry would hold of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.plants.signals import INNER
from faultgauge.simulation.closed_loop import Conditions, LoopRecord, governed_loop, with_faults
from faultgauge.simulation.free_run import RATE_STEP, fastest_rate
from faultgauge.simulation.policy import Policy
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.satellite.observatory import AXES, PERIOD
from faultgauge.simulation.satellite.observatory import run as fly
from faultgauge.simulation.scenario import MOST_STEPS, TRUTH, Drive, Scenario, read_scenario
from faultgauge.simulation.schedules import Schedule, grid, inject, truth
from faultgauge.simulation.sources import SampleClock
from faultgauge.telemetry import Run

__all__ = [
    "INPUTS",
    "REFERENCES",
    "driven",
    "fault_free_points",
    "noise",
    "rehearse",
    "run_under",
    "simulate",
    "truths",
]

SUBSTEPS = 20  # of a sample, at least: a fault that begins between samples is seen in time
POINTS = 500  # that stand for what a run leads through
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
    return run_under(scenario, None)[0]


def run_under(scenario: Scenario, policy: Policy | None) -> tuple[Run, Any]:
    """`simulate` with a `policy` between the controller and the inputs; (run, its info by row).

    In the flight of a satellite it is that of all wheels.
    """
    t = grid(scenario.samples, scenario.step)[:, 0]
    kept = slice(None, None, scenario.log_every)
    work = _flown if scenario.flight else _looped
    columns, info = work(scenario, t, policy)
    columns = {name: column[kept] for name, column in columns.items()}
    columns |= truths(scenario, t[kept])
    for name in scenario.plant.signals.output_names:
        if np.isnan(columns[name]).all():
            raise InputError(
                f"{scenario.source}: output {name!r} gives no sample in the whole run; shorten "
                "its dropout."
            )
    run = Run(scenario.name, scenario.source, t[kept], columns)
    return run, jax.tree.map(lambda each: np.asarray(each)[kept], info)


def fault_free_points(
    scenario: Scenario,
) -> tuple[Float[np.ndarray, "points states"], Float[np.ndarray, "points inputs"]]:
    """States and inputs that the scenario leads through without its faults and without a policy."""
    healthy = replace(scenario, faults=())
    t = grid(scenario.samples, scenario.step)[:, 0]
    points = np.linspace(0, scenario.samples - 1, min(POINTS, scenario.samples)).astype(int)
    if scenario.flight:
        flown, axis = _flight(healthy, t, None), AXES.index(scenario.flight.axis)
        x, u = flown.momentum[:, [axis]], flown.u[:, [axis]]
    else:
        record = rehearse(healthy, t)[0]
        x, u = record.x, record.u
    return np.asarray(x)[points], np.asarray(u)[points]


def _looped(
    scenario: Scenario, t: Float[np.ndarray, "samples"], policy: Policy | None
) -> tuple[dict[str, Float[np.ndarray, "samples"]], Any]:
    """Inputs and outputs of the plant under its own controller, and the policy's info."""
    record, info, _ = rehearse(scenario, t, policy)
    signals = scenario.plant.signals
    columns = dict(zip(signals.input_names, np.asarray(record.u).T, strict=True))
    columns |= dict(zip(signals.output_names, np.asarray(record.measured).T, strict=True))
    return columns, info


def rehearse(
    scenario: Scenario, t: Float[np.ndarray, "samples"], policy: Policy | None = None
) -> tuple[LoopRecord, Any, int]:
    """The loop run through, the policy's info, and the integration steps per sample that it took.

    Raises `InputError` where it makes no sense or leaves all bounds.
    """
    _check_delays(scenario, t[-1])
    substeps = scenario.substeps or SUBSTEPS
    record, info = _record(scenario, t, substeps, policy)
    needed = substeps if scenario.substeps else _needed(scenario, record)
    if needed > substeps:
        substeps = needed
        record, info = _record(scenario, t, substeps, policy)
    _check_finite(scenario, t, record)
    return record, info, substeps


def _check_delays(scenario: Scenario, duration: float) -> None:
    for each in scenario.plant.signals.inputs:
        if each.delay >= duration:
            raise InputError(
                f"{scenario.source}: the delay of input {each.name!r}, {each.delay:g} s, leaves "
                f"nothing of a run of {duration:g} s; lengthen the run."
            )


def _flown(
    scenario: Scenario, t: Float[np.ndarray, "samples"], policy: Policy | None
) -> tuple[dict[str, Float[np.ndarray, "samples"]], Any]:
    """Command and telemetry of one wheel of a satellite, the attitude [deg] as known on board, and
    the info of that wheel's policy.

    Faults and disturbances are in this wheel alone.
    """
    flight, signals = scenario.flight, scenario.plant.signals
    assert flight is not None
    happens = inject([*scenario.faults, *scenario.disturbances], signals, t)
    flown = _flight(scenario, t, policy)
    axis = AXES.index(flight.axis)
    true = np.stack([flown.torque[:, axis], flown.momentum[:, axis]], axis=1)
    measured = true + np.where(np.isnan(happens.stuck.y), noise(scenario), 0.0)
    if policy is not None:
        measured[:, 1] = flown.read[:, axis, 1]
    measured = np.where(happens.dropped, np.nan, measured)
    columns = {signals.input_names[0]: np.asarray(flown.u)[:, axis]}
    columns |= dict(zip(signals.output_names, measured.T, strict=True))
    attitude = np.rad2deg(np.asarray(flown.estimated)).T
    columns |= dict(zip(AXES, attitude, strict=True))
    return columns, jax.tree.map(lambda each: each[:, axis], flown.info)


def _flight(
    scenario: Scenario, t: Float[np.ndarray, "samples"], policy: Policy | None
) -> Telemetry:
    flight = scenario.flight
    assert flight is not None
    for each in scenario.plant.signals.inputs:
        if each.delay:
            raise InputError(
                f"{scenario.source}: the wheel's input {each.name!r} has a delay, which the flight "
                "of a satellite does not have; remove `delay` from the plant file or the flight "
                "from the scenario."
            )
    every = [*scenario.faults, *scenario.disturbances]
    return fly(
        scenario.plant,
        scenario.samples * PERIOD,
        scenario.seed,
        faults={flight.axis: [s for s in every if not _drops_samples(s)]},
        angles=flight.angles,
        momenta=flight.momenta,
        policy=policy,
        tachometer=float(scenario.sigma[1]),
    )


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


def _record(
    scenario: Scenario, t: Float[np.ndarray, "samples"], substeps: int, policy: Policy | None
) -> tuple[LoopRecord, Any]:
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
    run = governed_loop(plant, scenario.controller, policy, x0, conditions, scenario.step)
    return jax.device_get(run)


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
        clock = SampleClock(t, scenario.step, linear[j], scenario.folder)
        rng = np.random.default_rng([scenario.seed, stream, j])
        columns[:, j] = _signal(drive, clock, rng, f"{scenario.source}: [{table}.{name}]")
    return columns


def _signal(
    drive: Drive, clock: SampleClock, rng: np.random.Generator, where: str
) -> Float[np.ndarray, "samples"]:
    if drive.source is None:
        return np.full(len(clock.t), drive.offset)
    try:
        return drive.offset + drive.source.signal(clock, rng)
    except InputError as wrong:
        raise InputError(f"{where} {wrong}") from None


def _needed(scenario: Scenario, record: LoopRecord) -> int:
    """Integration steps per sample that the plant asks for where the run has led it."""
    points = np.linspace(0, scenario.samples - 1, POINTS).astype(int)
    x, u = np.asarray(record.x)[points], np.asarray(record.u)[points]
    rate = fastest_rate(scenario.plant, x, u)
    every = [*scenario.faults, *scenario.disturbances]
    if any(s.enters in INNER for s in every):  # they may make it faster
        happens = inject(every, scenario.plant.signals, grid(scenario.samples, scenario.step)[:, 0])
        faulty = with_faults(scenario.plant, happens.faults)
        rate = max(rate, fastest_rate(faulty, x, u, happens.f[points]))
    return int(min(np.ceil(scenario.step * rate / RATE_STEP), MOST_STEPS))


def _check_finite(scenario: Scenario, t: Float[np.ndarray, "samples"], record: LoopRecord) -> None:
    whole = np.concatenate([record.u, record.x, record.y], axis=1)
    wrong = np.flatnonzero(~np.isfinite(whole).all(axis=1))
    if wrong.size:
        raise InputError(
            f"{scenario.source}: the simulation leaves all bounds at t = {t[wrong[0]]:g} s; check "
            "gains, initial values and sizes, or raise `substeps`."
        )
