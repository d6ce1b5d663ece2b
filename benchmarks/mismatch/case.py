"""A case: a truth, the plant file of somebody who does not know all of it, and faults."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from faultgauge.telemetry.rates import align
from mismatch.truth import Acting, Truth, simulate

__all__ = ["Case", "Injected", "Sizes"]


@dataclass(frozen=True)
class Sizes:
    """Sizes of a fault to inject, in its unit: `low` to `high` are the engineering ones, about a
    tenth to a fifth of the range, and nothing beyond `most` makes sense. `signs` are drawn from."""

    low: float
    high: float
    most: float
    signs: tuple[float, ...] = (1.0, -1.0)


@dataclass(frozen=True)
class Injected:
    """A fault of a test log: its size, and the times [s] of the first sample from which it acts
    and of the first at which it acts no more."""

    size: float
    onset: float
    end: float = float("inf")


@dataclass(frozen=True)
class Case:
    """`truth` draws a record's plant, drive and noise; a log has the columns of the plant file.

    `slow` names outputs that are sampled every so many rows. `through` says which of the truth's
    disturbances a fault adds to, where it does not enter as the file's faults do: one that changes
    a parameter, or that the file does not declare. `told_as` says of a fault that the outputs show
    as another one by which name, and by how many times the size, it is rightly told; an undeclared
    one is told as "unknown", which has no size.
    """

    name: str
    file: str
    truth: Callable[[np.random.Generator], Truth]
    sizes: Mapping[str, Sizes]
    pairs: bool = False
    fits: int = 3
    slow: Mapping[str, int] = field(default_factory=dict)
    through: Mapping[str, int] = field(default_factory=dict)
    told_as: Mapping[str, tuple[str, float]] = field(default_factory=dict)

    @cached_property
    def plant(self) -> GrayBoxPlant:
        return GrayBoxPlant.untrained(parse_plant(self.file))

    def log(
        self, name: str, rng: np.random.Generator, faults: Iterable[tuple[str, Injected]] = ()
    ) -> Run:
        """One record with `faults`, by their names."""
        truth, signals = self.truth(rng), self.plant.signals
        acting = [self._acting(truth, n, each) for n, each in faults]
        u, y = simulate(truth, acting)
        columns = dict(zip(signals.input_names, u.T, strict=True))
        columns |= dict(zip(signals.output_names, y.T, strict=True))
        for output, rows in self.slow.items():
            columns[output] = np.where(np.arange(len(y)) % rows == 0, columns[output], np.nan)
        t = truth.step * np.arange(len(y))
        found = align(t, columns, signals.input_names)
        return Run(name, self.name, t[found.kept], found.columns, sampled=found.sampled)

    def _acting(self, truth: Truth, name: str, injected: Injected) -> Acting:
        size, onset, end = injected.size, injected.onset, injected.end
        if name in self.through:
            return Acting("disturbance", self.through[name], size, onset, end=end)
        signals = self.plant.signals
        fault = next(each for each in signals.faults if each.name == name)
        places = {
            "state": truth.states,
            "input": signals.input_names,
            "gain": signals.input_names,
            "output": signals.output_names,
            "output_gain": signals.output_names,
        }
        index = places[fault.enters].index(fault.target)
        return Acting(fault.enters, index, size, onset, end=end)
