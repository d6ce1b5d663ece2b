"""Faults of known size and onset in a healthy log."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.plants.signals import Input, Signals
from faultgauge.rehearsal.ways import Way
from faultgauge.telemetry import Run

__all__ = ["Injected", "NotInjectable", "inject", "profile"]

INEXACT = 0.05  # of the samples under the fault may tell a command beyond the actuator's limits


class NotInjectable(Exception):  # noqa: N818  (no error: this log does not allow this fault)
    """Why a log does not allow a fault, in a few words."""


class Injected(NamedTuple):
    """A fault of `size` [its unit] from `onset` [s] on, which grows by `rate` [unit/s] until it has
    that size (None: at once)."""

    way: Way
    size: float
    onset: float
    rate: float | None = None


def profile(injected: Injected, t: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "samples"]:
    """The size at times `t` [s]: 0 before the onset, then min(rate (t - onset), |size|), signed."""
    since = t - injected.onset
    if injected.rate is None:
        return np.where(since >= 0, injected.size, 0.0)
    grown = np.clip(injected.rate * since, 0.0, abs(injected.size))
    return np.copysign(grown, injected.size)


def inject(run: Run, signals: Signals, injected: Sequence[Injected]) -> Run:
    """`run` with all of `injected` in it. What is commanded acts a dead time later, so a command
    changes as much earlier.

    Raises `NotInjectable` where a column is missing, a ramp does not end within the run, or more
    than 5 % of the commands under the faults would leave [min, max]; the few that would are at the
    limit instead.
    """
    columns = dict(run.columns)
    inputs = {each.name: each for each in signals.inputs}
    for each in injected:
        if each.way.column not in columns:
            raise NotInjectable(f"the log has no column {each.way.column!r}")
        if each.rate is not None and each.onset + abs(each.size) / each.rate > run.t[-1]:
            raise NotInjectable("it would still be growing at the end of the log")
        if each.way.is_loss and each.size * each.way.scale >= 1:
            raise NotInjectable("a loss of 1 or more leaves nothing of the signal")
    for name in dict.fromkeys(each.way.column for each in injected):
        mine = [each for each in injected if each.way.column == name]
        if mine[0].way.is_input:
            columns[name] = _told(run, inputs[name], mine)
        else:
            added, kept = _effects(mine, run.t)
            columns[name] = kept * run.columns[name] + added
    return replace(run, columns=columns)


def _told(run: Run, each: Input, injected: Sequence[Injected]) -> Float[np.ndarray, "samples"]:
    """The command with which `kept` u + `added` is what acted."""
    acts = run.t + each.delay
    added, kept = _effects(injected, acts)
    acted = np.clip(run.columns[each.name], each.min, each.max)
    told = (acted - added) / kept
    under = acts >= min(one.onset for one in injected)
    beyond = (told < each.min) | (told > each.max)
    if np.mean(beyond[under]) > INEXACT:
        raise NotInjectable(f"the command of {each.name} would leave its limits")
    changed = np.clip(told, each.min, each.max)
    return np.where(under, changed, run.columns[each.name])


def _effects(
    injected: Sequence[Injected], t: Float[np.ndarray, "samples"]
) -> tuple[Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]]:
    """(what all together add, the share that they leave) at times `t` [s]."""
    added, kept = np.zeros(len(t)), np.ones(len(t))
    for each in injected:
        effect = each.way.scale * profile(each, t)
        if each.way.is_loss:
            kept *= 1 - effect
        else:
            added += effect
    return added, kept
