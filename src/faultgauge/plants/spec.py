"""What is known of a plant without running it: signals, equations, constants, networks."""

import math
from dataclasses import dataclass, field
from typing import Literal

from faultgauge.plants.expression import Expression
from faultgauge.plants.shape import Monotone, Shape
from faultgauge.plants.signals import Signals

__all__ = ["NetworkSpec", "Parameter", "PlantSpec"]


@dataclass(frozen=True)
class Parameter:
    """A physical constant; free unless `fixed`, kept inside [min, max].

    `vary` = "run": one value per run; "slow": one per run that also drifts slowly within it.
    `spread`, which no file says, is what a fleet tells of its units: one standard deviation about
    `value`, of the logarithm where that is positive and `min` is no less than 0.
    """

    name: str
    value: float
    unit: str = ""
    min: float = -math.inf
    max: float = math.inf
    fixed: bool = False
    vary: Literal["run", "slow"] | None = None
    spread: float | None = None

    @property
    def positive(self) -> bool:
        """Whether it differs by factors rather than by amounts."""
        return self.min >= 0 and self.value > 0


@dataclass(frozen=True)
class NetworkSpec:
    """An unknown function of `arity` arguments with `hidden` tanh units; `known` where a fleet has
    learned it already, which no file says."""

    name: str
    hidden: int
    arity: int
    odd: bool = False
    zero_at_zero: bool = False
    positive: bool = False
    monotone: Monotone | None = None
    known: bool = False

    @property
    def shape(self) -> Shape:
        return Shape(self.odd, self.zero_at_zero, self.positive, self.monotone)


@dataclass(frozen=True)
class PlantSpec:
    """A checked plant file. Hashable: it is the static part of every compiled function.

    `open_holds`, `open_delays` and `open_sizes` name the inputs whose hold and whose dead time and
    the networks whose size the file leaves to the fit; until then they stand at their defaults.
    """

    name: str
    text: str
    signals: Signals
    derivatives: tuple[Expression, ...]
    values: tuple[Expression, ...]
    parameters: tuple[Parameter, ...]
    networks: tuple[NetworkSpec, ...]
    order: tuple[int, ...]
    open_holds: tuple[str, ...] = ()
    open_delays: tuple[str, ...] = ()
    open_sizes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = field(compare=False, default=())
