"""What a plant's signals are called, what they are measured in and what may go wrong in them."""

import math
from dataclasses import dataclass
from typing import Literal

__all__ = [
    "INNER",
    "LOSSES",
    "Detection",
    "Entry",
    "Fault",
    "Hold",
    "Input",
    "Monitor",
    "Observation",
    "Output",
    "Signals",
    "State",
    "spoken",
]

Hold = Literal["zero", "linear", "band-limited"]
Monitor = Literal["active", "passive", "disabled"]
Entry = Literal["state", "input", "output", "gain", "output_gain", "parameter", "network"]
LOSSES: tuple[Entry, ...] = ("gain", "output_gain")  # 1 - f multiplies
INNER: tuple[Entry, ...] = ("parameter", "network")  # which no log shows
PURE = ("1", "-")  # units of plain numbers


def spoken(unit: str) -> str:
    """`unit` as it is said behind a number: nothing of a plain one."""
    return "" if unit.strip() in PURE else unit.strip()


@dataclass(frozen=True)
class State:
    """A state; simulation keeps it inside [min, max].

    `exact`: its derivative is kinematics, in which the model makes no error. Values outside
    `trusted` (low, high) are not to be relied on; None: all are.
    """

    name: str
    unit: str = ""
    min: float = -math.inf
    max: float = math.inf
    initial: float = 0.0
    exact: bool = False
    trusted: tuple[float, float] | None = None


@dataclass(frozen=True)
class Input:
    """An input; the actuator clips it to [min, max]; `hold` is how it runs between samples.

    What is commanded at t acts at t + `delay` [s]. `instrument` is the column of a reference from
    outside the loop. `trusted` as for a `State`.
    """

    name: str
    unit: str = ""
    min: float = -math.inf
    max: float = math.inf
    hold: Hold = "zero"
    delay: float = 0.0
    instrument: str | None = None
    trusted: tuple[float, float] | None = None


@dataclass(frozen=True)
class Output:
    """An output; `sigma` is its measurement noise (standard deviation, its own unit).

    `measures` names the state whose value the output is exactly, if there is one. `trusted` as for
    a `State`.
    """

    name: str
    unit: str = ""
    sigma: float | None = None
    measures: str | None = None
    trusted: tuple[float, float] | None = None


@dataclass(frozen=True)
class Fault:
    """A hypothesis: what may go wrong, where it enters and by how much.

    f adds to a state's derivative, an input, an output, a parameter's or a network's value; to the
    latter two as a share of what they are where it is `relative`, that is times 1 + f. A gain loss
    multiplies an input ("gain") or an output ("output_gain") by 1 - f.

    The estimate is kept inside [min, max]. `rate` is its fastest growth (unit/s) and
    `prior_per_hour` how often it begins; None where the plant file leaves them to the bank.
    `monitor` as the action points of NASA's cFS Limit Checker: a disabled fault is not evaluated,
    a passive one is evaluated and reported but raises no alarm.
    """

    name: str
    enters: Entry
    target: str
    unit: str = ""
    min: float = -math.inf
    max: float = math.inf
    rate: float | None = None
    prior_per_hour: float | None = None
    monitor: Monitor = "active"
    relative: bool = False

    @property
    def acts(self) -> bool:
        """Whether it acts on the plant, and not on what a sensor shows alone."""
        return self.enters not in ("output", "output_gain")


@dataclass(frozen=True)
class Detection:
    """When the bank tells an alarm: after `persistence` [s] on end, until the probability of a
    fault falls below `release`, or for good (`latch`); not within `hold_off` [s] of a start or a
    gap (None: 10 samples)."""

    persistence: float = 0.0
    release: float = 0.5
    latch: bool = False
    hold_off: float | None = None


@dataclass(frozen=True)
class Observation:
    """What an observer may use: outputs (None: all that are measured), bandwidth in rad/s."""

    outputs: tuple[str, ...] | None = None
    bandwidth: float | None = None


@dataclass(frozen=True)
class Signals:
    """Everything that the rest of faultgauge needs to know about a plant but its equations.

    At most `max_simultaneous` faults are taken to be present together.
    """

    states: tuple[State, ...]
    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]
    faults: tuple[Fault, ...] = ()
    observation: Observation = Observation()
    max_simultaneous: int = 2
    detection: Detection = Detection()

    @property
    def units(self) -> dict[str, str]:
        """The units that are given, by the name of the column: also of d_h, the rate of state h."""
        rates = [(f"d_{each.name}", each.unit and f"({each.unit})/s") for each in self.states]
        named = [(each.name, each.unit) for each in (*self.states, *self.inputs, *self.outputs)]
        return {name: unit for name, unit in (*rates, *named) if unit.strip()}

    @property
    def state_names(self) -> tuple[str, ...]:
        """In the order of x."""
        return tuple(state.name for state in self.states)

    @property
    def input_names(self) -> tuple[str, ...]:
        """In the order of u."""
        return tuple(each.name for each in self.inputs)

    @property
    def instruments(self) -> tuple[str, ...]:
        """Columns of the references that the inputs name, each once."""
        return tuple(dict.fromkeys(each.instrument for each in self.inputs if each.instrument))

    @property
    def output_names(self) -> tuple[str, ...]:
        """In the order of y."""
        return tuple(output.name for output in self.outputs)

    @property
    def fault_names(self) -> tuple[str, ...]:
        """In the order of f."""
        return tuple(fault.name for fault in self.faults)
