"""What goes wrong when: sizes over time, and how they enter a plant."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.plants.plant import Stuck
from faultgauge.plants.signals import LOSSES, Entry, Fault, Signals

__all__ = [
    "Constant",
    "Injection",
    "Intermittent",
    "Profile",
    "Ramp",
    "Schedule",
    "Sine",
    "Steps",
    "grid",
    "inject",
    "truth",
]


@dataclass(frozen=True)
class Constant:
    """`size` from `start` to `end` [s]: a sustained fault."""

    size: float
    start: float = 0.0
    end: float = np.inf

    def active(self, t: Float[np.ndarray, "*n"]) -> Bool[np.ndarray, "*n"]:
        return (t >= self.start) & (t < self.end)

    def sizes(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        return np.where(self.active(t), self.size, 0.0)


@dataclass(frozen=True)
class Steps:
    """`values[k]` from `times[k]` [s] on, nothing before the first: eqs (17) and (19)."""

    times: tuple[float, ...]
    values: tuple[float, ...]

    def active(self, t: Float[np.ndarray, "*n"]) -> Bool[np.ndarray, "*n"]:
        return t >= self.times[0]

    def sizes(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        return np.array([0.0, *self.values])[np.searchsorted(self.times, t, side="right")]


@dataclass(frozen=True)
class Ramp:
    """From `begin` at `start` straight to `size` at `end` [s], and held there."""

    size: float
    start: float
    end: float
    begin: float = 0.0

    def active(self, t: Float[np.ndarray, "*n"]) -> Bool[np.ndarray, "*n"]:
        return t >= self.start

    def sizes(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        share = np.clip((t - self.start) / (self.end - self.start), 0.0, 1.0)
        return self.begin + (self.size - self.begin) * share


@dataclass(frozen=True)
class Intermittent:
    """`size` for the first `duty` of every `period` [s] between `start` and `end` [s]."""

    size: float
    start: float
    period: float
    duty: float = 0.5
    end: float = np.inf

    def active(self, t: Float[np.ndarray, "*n"]) -> Bool[np.ndarray, "*n"]:
        phase = np.mod((t - self.start) / self.period, 1.0)
        phase = np.mod(np.round(phase, 9), 1.0)  # 0.3/0.1 is the fourth period, not the third
        return (t >= self.start) & (t < self.end) & (phase < self.duty)

    def sizes(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        return np.where(self.active(t), self.size, 0.0)


@dataclass(frozen=True)
class Sine:
    """`size` sin(omega t + phase): a disturbance, omega in rad/s."""

    size: float
    omega: float
    phase: float = 0.0

    def active(self, t: Float[np.ndarray, "*n"]) -> Bool[np.ndarray, "*n"]:
        return np.ones(t.shape, bool)

    def sizes(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        return self.size * np.sin(self.omega * t + self.phase)


Profile = Constant | Steps | Ramp | Intermittent | Sine


@dataclass(frozen=True)
class Schedule:
    """One fault or disturbance: where it enters, what it does there, and its size over time.

    "add" is what an estimator looks for: the additive or relative fault or the loss of gain that
    `enters` says. "stuck" overwrites the channel (of a state: its derivative) with the size while
    the profile is active. "dropout" cuts the channel: an output gives no sample, an input is 0, a
    state stands still, a gain is lost whole. Of two that overwrite one channel at a time, the later
    in the list does. A parameter and a network know "add" alone.
    """

    name: str
    enters: Entry
    target: str
    profile: Profile
    effect: Literal["add", "stuck", "dropout"] = "add"
    unit: str = ""
    relative: bool = False


class Injection(NamedTuple):
    """Schedules on a time grid: additive sizes, stuck channels, outputs that give no sample."""

    faults: tuple[Fault, ...]
    f: Float[np.ndarray, "*grid faults"]
    stuck: Stuck
    dropped: Bool[np.ndarray, "*grid outputs"]


def grid(
    samples: int, dt: float, substeps: int = 1, first: int = 0
) -> Float[np.ndarray, "samples substeps"]:
    """Times [s] at which the integration steps of every sample begin, from sample `first` on.

    Free of the dust of rounding: what is to happen at 2.1 s happens at the third step of 0.7 s.
    """
    step = dt / substeps
    decimals = 9 - math.floor(math.log10(step))
    steps = np.arange(first * substeps, (first + samples) * substeps)
    return np.round(step * steps, decimals).reshape(samples, substeps)


def inject(
    schedules: Sequence[Schedule], signals: Signals, t: Float[np.ndarray, "*grid"]
) -> Injection:
    """What `schedules` do to a plant with these `signals` at the times `t` [s]."""
    added = [s for s in schedules if s.effect == "add" or s.enters in LOSSES]
    f = np.zeros((*t.shape, len(added)))
    for k, schedule in enumerate(added):
        lost = schedule.effect == "dropout"
        active, sizes = schedule.profile.active(t), schedule.profile.sizes(t)
        f[..., k] = np.where(active, 1.0, 0.0) if lost else sizes
    channels = {
        "state": (signals.state_names, np.full((*t.shape, len(signals.states)), np.nan)),
        "input": (signals.input_names, np.full((*t.shape, len(signals.inputs)), np.nan)),
        "output": (signals.output_names, np.full((*t.shape, len(signals.outputs)), np.nan)),
    }
    dropped = np.zeros((*t.shape, len(signals.outputs)), bool)
    for schedule in schedules:
        if schedule.effect == "add" or schedule.enters in LOSSES:
            continue
        names, held = channels[schedule.enters]
        channel, active = names.index(schedule.target), schedule.profile.active(t)
        if schedule.effect == "dropout" and schedule.enters == "output":
            dropped[..., channel] |= active
        else:
            value = schedule.profile.sizes(t) if schedule.effect == "stuck" else 0.0
            held[..., channel] = np.where(active, value, held[..., channel])
    stuck = Stuck(channels["state"][1], channels["input"][1], channels["output"][1])
    faults = tuple(Fault(s.name, s.enters, s.target, s.unit, relative=s.relative) for s in added)
    return Injection(faults, f, stuck, dropped)


def truth(schedule: Schedule, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """What was injected: the size, the value it is stuck at (NaN: free), 1 while dropped out."""
    active = schedule.profile.active(t)
    if schedule.effect == "dropout":
        return active.astype(float)
    sizes = schedule.profile.sizes(t)
    return np.where(active, sizes, np.nan) if schedule.effect == "stuck" else sizes
