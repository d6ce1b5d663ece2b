"""One sensor more, of a state or its derivative: what it would tell along the same log.

What it would have read is taken from the healthy filter. Its noise, against what it measures, is
that of the plant's own sensors in the median.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.detection.answer.smallest import around
from faultgauge.detection.bank.bank import FaultBank, build_fault_bank
from faultgauge.detection.posterior.unit_faults import Effects, Information, effects_of, information
from faultgauge.detection.rows.judged import operating_points
from faultgauge.detection.rows.prepared import as_it_acts
from faultgauge.foresight.problems import Problem, size_told
from faultgauge.foresight.structure import Structure, rate_of, value_of
from faultgauge.plants.expression import Expression
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import respond
from faultgauge.plants.signals import Output
from faultgauge.telemetry import Run

__all__ = ["Sensor", "sensors_for"]

TRIED = 3  # sensors, each a filter of its own


class Sensor(NamedTuple):
    """What a sensor of `value` with noise `sigma` [`unit`] would do: the sizes from which on each
    problem's fault would be told, and whether the equations alone tell it then."""

    value: str
    unit: str
    sigma: float
    sizes: tuple[float, ...]
    structural: tuple[bool, ...]


def sensors_for(
    bank: FaultBank,
    run: Run,
    effects: Effects,
    structure: Structure,
    problems: list[Problem],
) -> list[Sensor]:
    """Those that tell a problem's fault, the one that tells most first."""
    found = list[Sensor]()
    for value, state, rate in _candidates(bank, structure, problems):
        unit = bank.model.plant.signals.states[state].unit
        unit = f"({unit})/s" if rate and unit else unit
        added, sigma = _with_sensor(bank, run, effects, value, state, rate)
        seconds = float(effects.t[-1] - effects.t[0])
        sizes = [size_told(bank, added, p.fault, p.rival, seconds) for p in problems]
        after = structure.measuring(value)
        told = tuple(_tells(bank, after, each) for each in problems)
        found.append(Sensor(value.text, unit, sigma, tuple(sizes), told))
    sized = [problem.size for problem in problems]

    def solved(each: Sensor) -> int:
        return sum(size <= want for size, want in zip(each.sizes, sized, strict=True))

    return [each for each in sorted(found, key=lambda one: -solved(one)) if solved(each)]


def _tells(bank: FaultBank, structure: Structure, problem: Problem) -> bool:
    names = bank.model.plant.signals.fault_names
    if problem.rival is None:
        return structure.detectable(names[problem.fault])
    return structure.isolable(names[problem.fault], names[problem.rival])


def _candidates(
    bank: FaultBank, structure: Structure, problems: list[Problem]
) -> Iterator[tuple[Expression, int, bool]]:
    """(what is measured, of which state, whether its rate): what leaves the equations something
    to tell a problem's fault by, most of them first."""
    signals = bank.model.plant.signals
    measured = {o.measures for o in signals.outputs if o.name in bank.outputs}
    every = [
        *((value_of(n), k, False) for k, n in enumerate(signals.state_names) if n not in measured),
        *((rate_of(n), k, True) for k, n in enumerate(signals.state_names)),
    ]

    def tells(each: tuple[Expression, int, bool]) -> int:
        after = structure.measuring(each[0])
        return sum(_tells(bank, after, problem) for problem in problems)

    yield from sorted(filter(tells, every), key=lambda each: -tells(each))[:TRIED]


def _with_sensor(
    bank: FaultBank, run: Run, effects: Effects, value: Expression, state: int, rate: bool
) -> tuple[Information, float]:
    """(what a unit of each fault would leave with it, its noise)."""
    model, signals = bank.model, bank.model.plant.signals
    points, count = operating_points(model), len(signals.states)
    rates, outputs = _responses(model.plant, points.x, points.u)
    own = bank.noise.sigma[[signals.output_names.index(name) for name in bank.outputs]]
    spans = np.ptp(outputs, axis=0)[[signals.output_names.index(name) for name in bank.outputs]]
    span = np.ptp((rates if rate else points.x)[:, state])
    sigma = float(np.median(own / np.maximum(spans, 1e-300)) * max(span, 1e-300))
    u = [np.interp(effects.t, run.t, run.columns[n]) for n in signals.input_names]
    u = np.stack(u, axis=1) if u else np.zeros((len(effects.t), 0))
    x = effects.x[:, :count]
    read = (_responses(model.plant, x, np.nan_to_num(u))[0] if rate else x)[:, state]
    name = "new sensor"  # no name of a plant file has a space
    output = Output(name, measures=None if rate else signals.state_names[state])
    seen = signals.observation
    more = replace(
        signals,
        outputs=(*signals.outputs, output),
        observation=replace(seen, outputs=seen.outputs and (*seen.outputs, name)),
    )
    spec = replace(model.plant.spec, signals=more, values=(*model.plant.spec.values, value))
    plant = replace(model.plant, signals=more, spec=spec)
    columns = {**run.columns, name: np.interp(run.t, effects.t, read)}
    log = replace(run, columns=columns)
    noise = bank.noise._replace(
        sigma=np.append(bank.noise.sigma, sigma), jitter=np.append(bank.noise.jitter, 0.0)
    )
    between = model.record.between
    if between is not None:  # a free run would be as far off in it, against its range
        others = np.array([between.off[each] for each in bank.outputs])
        off = float(np.median(others / np.maximum(spans, 1e-300)) * max(span, 1e-300))
        between = between.model_copy(update={"off": {**between.off, name: off}})
    record = model.record.but(between=between)
    wider = build_fault_bank(replace(model, plant=plant, record=record), [log], noise)
    found = effects_of(wider, as_it_acts(more, log))
    rows = len(found.t)
    return information(found, rows // 2, around(rows // 2, rows), [rows - 1]), sigma


def _responses(
    plant: GrayBoxPlant,
    x: Float[np.ndarray, "points states"],
    u: Float[np.ndarray, "points inputs"],
) -> tuple[Float[np.ndarray, "points states"], Float[np.ndarray, "points outputs"]]:
    found = jax.vmap(lambda x, u: respond(plant, x, u))(jnp.asarray(x), jnp.asarray(u))
    rates, outputs = (np.nan_to_num(np.asarray(each)) for each in found)
    return rates, outputs
