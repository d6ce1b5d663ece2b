"""The bank of a calibrated model: its branches, its noise, and what calibration says of both."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank.coverage import Region, regions_of
from faultgauge.detection.bank.extended import (
    disturbed,
    jitter_of,
    process_of,
    rates_of,
    scale_of,
    spread_of_start,
)
from faultgauge.detection.bank.knowledge import Knowledge, knowledge_of
from faultgauge.detection.bank.large_faults import LargeFaults, large_faults
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.bank.priors import (
    onsets_of,
    prior_of_faults,
    sizes_of,
    undeclared_faults,
)
from faultgauge.detection.bank.sets import Set, fault_sets
from faultgauge.detection.rows.judged import measured_outputs, rows_between
from faultgauge.errors import InputError
from faultgauge.observers import divided_difference as dd
from faultgauge.observers.branching import Branching
from faultgauge.observers.divided_difference import DividedDifferenceFilter
from faultgauge.plants.disturbed import Disturbed
from faultgauge.plants.model import Model
from faultgauge.plants.signals import Signals
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.free_run import substeps_for
from faultgauge.telemetry import Run

__all__ = [
    "AGES",
    "CERTAIN",
    "MIMICS",
    "FaultBank",
    "build_fault_bank",
    "evaluated_faults",
    "unknown_shock",
]

CERTAIN = float(np.log(0.95 / 0.05))  # log-odds below which nothing is ever told or named
HOLD_OFF = 10  # samples
BRANCHES = 6  # sets of faults that are followed at once at least
AGES = (1.0, 4.0, 16.0)  # times the memory: of unknown filters, one of each
WINDOWS = AGES[1:]  # in which it is told how well branches fit: a fault takes a memory to be known
MIMICS = (0.25, *AGES)  # times the memory: ages between which what looks like a fault differs
ONSETS = 12  # of every fault beside every branch
FAR = 10.0  # times the learned discrepancy: an unknown one
LOUD = 4.0  # times the noise of a sensor: that of an unknown one; from 1.7 times on it is likelier
NOTABLE = 0.1  # of a state's rate: and at least that
TRIED = 0.3  # of a fault's widest size: by which it is linearised
LONG = 200  # samples that an onset is remembered by default


@dataclass(frozen=True)
class FaultBank:
    """The branches of a model's faults.

    `sets` of faults, healthy first and the unknown not among them; `rows` between the samples of
    each of `outputs` (1 but for slow sensors); `size` the widest prior of each
    fault and `onset` its rate [1/s]; `knowledge` how well a fault is known by when; `level` are the
    log-odds of a fault from which on there is an alarm; `hold_off` in s;
    `regions` are what its networks were trained on; `shape` and `gain` are by which shares the
    model's answer to what acts on the plant is off, in all and in size; `changes` by how much each
    input changes from row to row of healthy logs at most; `nis` how badly an explanation may fit in
    each window, and `mimicked` the size of what in healthy logs, `healthy` [s] in all, looks like
    each fault, before each of the ages `until` [s] and behind the last; `alike` are two faults that
    no data tell apart, and how many units of the second do what one of the first does.
    """

    model: Model
    modes: Branching
    sets: tuple[Set, ...]
    size: Float[np.ndarray, "faults"]
    onset: Float[np.ndarray, "faults"]
    noise: Noise
    outputs: tuple[str, ...]
    rows: tuple[int, ...]
    step: float
    knowledge: Knowledge
    level: float
    hold_off: float
    regions: tuple[Region, ...]
    shape: float
    gain: float
    changes: Float[np.ndarray, "inputs"]
    nis: Float[np.ndarray, "windows"]
    healthy: float
    mimicked: Float[np.ndarray, "faults ages"]
    alike: tuple[tuple[int, int, float], ...] = ()

    @property
    def plant(self) -> Disturbed:
        plant = self.modes.filter.plant
        assert isinstance(plant, Disturbed)
        return plant

    @property
    def waits(self) -> Float[np.ndarray, "causes"]:
        """How long [s] a name must be likely to be told, by declared fault and, last, for something
        undeclared: a quarter of the time in which a large one shows."""
        shows = np.append(self.knowledge.when, self.knowledge.memory)
        return np.maximum(shows / 4, self.step)

    @property
    def outlasts(self) -> float:
        """How long [s] something undeclared has to hold, as nothing but its size tells it from the
        model's own error, and of how large that may be, what it is for as long as it lasts is one
        sample alone; no longer than the longest memory of an unknown filter."""
        memory, lasting = self.knowledge.memory, np.max(self.noise.lasting, initial=0.0)
        return float(max(np.clip(lasting, memory / 4, AGES[-1] * memory), self.step))

    @property
    def settled(self) -> Float[np.ndarray, "inputs"]:
        """How long [s] after each input's change what it does besides is more than the share by
        which sizes are off anyway."""
        noise, found = self.noise, np.zeros(len(self.changes))
        following, leans = list(self.plant.following), list(noise.leans)
        late = np.abs(noise.lean[leans]), noise.leaning[leans]
        for which, share, settling in ((following, noise.share, noise.settling), (leans, *late)):
            more = (self.gain > 0) & (share > self.gain)
            long = settling * np.log(np.where(more, share / (self.gain or 1.0), 1.0))
            np.maximum.at(found, which, long)
        return found

    @property
    def until(self) -> Float[np.ndarray, "ends"]:
        """Ages of faults [s] between which what healthy logs mimic is told apart."""
        return self.knowledge.memory * np.array(MIMICS)

    @property
    def pause(self) -> float:
        """How long [s] a pause may be that ends no event."""
        return max(self.knowledge.memory / 4, self.step)

    def like(self, fault: int) -> set[int]:
        """The declared faults that no data tell apart from `fault`."""
        found, known = {fault}, {fault}
        while found:
            pairs = [{*each[:2]} for each in self.alike]
            found = {k for pair in pairs if pair & known for k in pair} - known
            known |= found
        return known - {fault}

    def with_monitor(self, which: str) -> Bool[np.ndarray, "faults"]:
        """The declared faults that are `which`: active, passive or disabled."""
        return np.array([f.monitor == which for f in self.model.plant.signals.faults])


def evaluated_faults(signals: Signals) -> list[int]:
    """The declared faults that are not disabled. Raises `InputError` where there is none."""
    faults = signals.faults
    evaluated = [k for k, fault in enumerate(faults) if fault.monitor != "disabled"]
    if not evaluated:
        what = "disables all its [faults]" if faults else "declares no [faults]"
        raise InputError(
            f"the plant file {what}, so the bank has nothing to tell apart; declare "
            "what may go wrong, or use `faultgauge estimate --observer eso`."
        )
    return evaluated


def build_fault_bank(
    model: Model, runs: Sequence[Run], noise: Noise, healthy: float | None = None
) -> FaultBank:
    """The bank for `runs`, with the alarm level where `model` is calibrated for it.

    `healthy` [s] is how long the healthy logs are, by default as calibration found them. Raises
    `InputError` where the plant file declares no fault that is not disabled.
    """
    signals = model.plant.signals
    evaluated = evaluated_faults(signals)
    step = float(np.median([run.step for run in runs]))
    outputs = measured_outputs(model, runs)
    rows = tuple(rows_between(runs, name) for name in outputs)
    found = model.calibration and model.calibration.bank
    if healthy is None:
        healthy = float(found.healthy_s if found else sum(run.t[-1] - run.t[0] for run in runs))
    onset = onsets_of(model, healthy)
    undeclared = undeclared_faults(model, outputs)
    plant = disturbed(model, noise, undeclared)
    faulty = with_faults(model.plant, plant.signals.faults)
    size = sizes_of(model, faulty)
    growing = tuple(k for k in evaluated if signals.faults[k].rate is not None)
    sets = fault_sets(evaluated, signals.max_simultaneous)
    knowledge = knowledge_of(model, plant, noise, size, step, outputs, rows, healthy)
    size[: len(signals.faults)] = knowledge.size
    large = large_faults(model, faulty, size, TRIED * size, evaluated)
    loud = [signals.output_names.index(name) for name in outputs]
    more, less = _changes(sets, signals, len(undeclared), (*growing, *large.faults))
    modes = Branching(
        filter=_filter(model, plant, noise, TRIED * size, growing, large, step),
        noise=_levels(model, noise, len(size), knowledge, _followed(evaluated), loud),
        prior=prior_of_faults(model, size, onset, growing, large, found.gain if found else 0.0),
        alien=jax.device_put(_alien(model, noise, len(size) + len(growing), knowledge, len(loud))),
        ages=np.array([*AGES, *[1.0] * len(loud)]),
        own=jax.device_put(_own(model, noise)),
        usual=jax.device_put(_usual(model, noise, len(size) + len(growing))),
        memory=jax.device_put(knowledge.memory),
        windows=np.array(WINDOWS),
        recall=jax.device_put(knowledge.when),
        shape=jax.device_put(found.shape if found else 0.0),
        more=more,
        less=less,
        declared=len(signals.faults),
        branches=_followed(evaluated),
        onsets=ONSETS,
    )
    changes = found.changes if found else {}
    wait, level = signals.detection.hold_off, found.level if found else CERTAIN
    return FaultBank(
        model, modes, sets, size[: len(signals.faults)], onset, noise, outputs, rows, step,
        knowledge, float(level), HOLD_OFF * step if wait is None else wait,
        regions_of(model, outputs), found.shape if found else 0.0, found.gain if found else 0.0,
        np.array([float(changes.get(name, np.inf)) for name in signals.input_names]),
        np.array(found.nis if found and found.nis else np.full(len(WINDOWS), np.inf)),
        healthy,
        _mimicked(found.mimicked if found else {}, signals.fault_names),
        _alike(found.alike, signals.fault_names, evaluated) if found else (),
    )  # fmt: skip


def _filter(
    model: Model,
    plant: Disturbed,
    noise: Noise,
    probe: Float[np.ndarray, "faults"],
    growing: tuple[int, ...],
    large: LargeFaults,
    step: float,
) -> DividedDifferenceFilter:
    return DividedDifferenceFilter(
        plant,
        jax.device_put(scale_of(model, noise)),
        jax.device_put(probe),
        growing,
        substeps_for(step, model.max_step),
        np.asarray(step),
        large.faults,
        jax.device_put(large.size),
    )


def _followed(evaluated: Sequence[int]) -> int:
    """How many sets have room: none, every fault alone, and one more. What loses its branch takes
    with it what that told of all others."""
    return max(BRANCHES, len(evaluated) + 2)


def _alike(
    told: Sequence[tuple[str, str, float]], names: Sequence[str], evaluated: Sequence[int]
) -> tuple[tuple[int, int, float], ...]:
    places = ((names.index(one), names.index(other), float(by)) for one, other, by in told)
    return tuple(each for each in places if each[0] in evaluated and each[1] in evaluated)


def _mimicked(
    told: Mapping[str, Sequence[float]], names: Sequence[str]
) -> Float[np.ndarray, "faults ages"]:
    none = [0.0] * (len(MIMICS) + 1)
    return np.array([told.get(name, none) for name in names])


def _changes(
    sets: tuple[Set, ...], signals: Signals, undeclared: int, again: tuple[int, ...]
) -> tuple[tuple[tuple[int, ...], ...], tuple[tuple[int, ...], ...]]:
    """Where a change of each kind, and the end of each fault, leads from every set; -1: nowhere.
    `again` are the faults of the kinds that follow one step of each: growths and large steps."""
    declared = len(signals.faults)
    kinds = [*range(declared), *[None] * undeclared, *again]
    more, less = [], []
    for each in sets:
        row = []
        for kind in kinds:
            if kind is None:
                row.append(len(sets) if not each else -1)
            else:
                new = tuple(sorted({*each, kind}))
                row.append(sets.index(new) if new in sets else -1)
        more.append(tuple(row))
        rest = [tuple(k for k in each if k != fault) for fault in range(declared)]
        gone = [sets.index(r) if r != each else -1 for r in rest]
        less.append((*gone, *[-1] * undeclared))
    nowhere = (-1,) * len(kinds)
    # an undeclared bias may go again
    back = (*[-1] * declared, *[0] * undeclared)
    return (*more, nowhere), (*less, back)


def _levels(
    model: Model,
    noise: Noise,
    faults: int,
    knowledge: Knowledge,
    branches: int,
    loud: Sequence[int],
) -> dd.FilterNoise:
    """Of the branches, and of the unknown filters behind them: those whose discrepancy changes all
    the time, or it would be a constant fault by another name, and those of which each has one
    sensor that is `loud`."""
    drifted = spread_of_start(model, noise.sigma, ())[1]
    usual = process_of(noise, drifted)
    quick = np.minimum(noise.lasting, knowledge.memory)
    far = process_of(noise._replace(size=_far(model, noise, knowledge), lasting=quick), drifted)
    process = [*[usual] * branches, *[far] * len(AGES), *[usual] * len(loud)]
    sigma = np.tile(noise.sigma, (len(process), 1))
    sigma[branches + len(AGES) + np.arange(len(loud)), loud] *= LOUD
    return dd.FilterNoise(
        jax.device_put(np.stack(process)),
        jax.device_put(np.zeros((len(process), faults))),
        jax.device_put(sigma),
        jitter_of([noise] * len(process)),
    )


def _far(model: Model, noise: Noise, knowledge: Knowledge) -> Float[np.ndarray, "driven"]:
    """A discrepancy far beyond the learned one, and at least one that shows."""
    usual = rates_of(model)[list(disturbed(model, noise).driven)]
    shows = np.where(np.isfinite(knowledge.drive), knowledge.drive, 0.0)
    return np.max([FAR * noise.size, NOTABLE * usual, shows], axis=0)


def _parts(model: Model, noise: Noise) -> tuple[int, int, int]:
    """How many states, driven ones and, behind their discrepancies, other ones there are."""
    states, driven = len(model.plant.signals.states), len(noise.size)
    return states, driven, len(scale_of(model, noise)) - states - driven


def unknown_shock(bank: FaultBank) -> Float[np.ndarray, "extended"]:
    """Standard deviations of what an unknown fault does to [states, discrepancy, others]."""
    states, _, others = _parts(bank.model, bank.noise)
    far = _far(bank.model, bank.noise, bank.knowledge)
    return np.concatenate([np.zeros(states), far, np.zeros(others)])


def _alien(
    model: Model, noise: Noise, slots: int, knowledge: Knowledge, loud: int
) -> Float[np.ndarray, "unknown n n"]:
    states, _, others = _parts(model, noise)
    far = _far(model, noise, knowledge) ** 2
    one = np.diag(np.concatenate([np.zeros(states), far, np.zeros(others + slots)]))
    return np.stack([*[one] * len(AGES), *[np.zeros_like(one)] * loud])


def _own(model: Model, noise: Noise) -> Float[np.ndarray, "extended"]:
    states, driven, others = _parts(model, noise)
    return np.concatenate([np.ones(states), np.zeros(driven), np.ones(others)])


def _usual(model: Model, noise: Noise, slots: int) -> Float[np.ndarray, "n"]:
    states, _, others = _parts(model, noise)
    return np.concatenate([np.zeros(states), noise.size**2, np.zeros(others + slots)])
