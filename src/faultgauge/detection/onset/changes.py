"""The changes of a window's faults: one, or those that the bank told, revised together.

Each change is looked for anew over all onsets and causes, the others being known, until none moves.
How sure their sizes are is told jointly, from their effects S on the whitened innovations,

    cov f = (S^T S + 1/size^2)^-1,

and the whole is weighed by  ln p(y | all) - ln p(y | none)  and what each change's prior and
unknown onset cost it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.onset.change_points import causes_of, total
from faultgauge.detection.onset.window import Causes, Window, shocks_of
from faultgauge.detection.posterior.verdicts import NAMED

__all__ = ["Change", "ChangeHistory", "Sized", "changes_of"]

MOST = 6  # changes in one window
ROUNDS = 4  # of revising them
CLEAR = float(np.log(NAMED / (1 - NAMED)))


class Change(NamedTuple):
    """Fault `fault` grows by `size` at sample `at`."""

    fault: int
    at: int
    size: float


@dataclass(frozen=True)
class Sized:
    """A change, the posterior beside the others, the fault's level after it less the change, and
    by how much the level is less sure than the change beside known others."""

    change: Change
    causes: Causes
    before: float
    wider: float
    fit: Float[np.ndarray, "samples outputs"]


@dataclass(frozen=True)
class ChangeHistory:
    """The changes in the order of time, `weight` of all of them (ln, healthy: 0); the posterior
    of one change where none is known (`alone`), and of one more (`more`)."""

    found: tuple[Sized, ...]
    weight: float
    alone: Causes
    more: Causes


def changes_of(bank: FaultBank, decision: Decision, window: Window) -> ChangeHistory:
    """What changes in a window: the likeliest single change, where that is likelier than none, or
    what the bank's events become."""
    alone = causes_of(bank, window)
    change = _likeliest(bank, alone, [], least=0.0)
    found = _weighed(bank, window, alone, [] if change is None else [change])
    told = _as_told(bank, decision, window)
    if len(told) > 1:
        other = _weighed(bank, window, alone, _revised(bank, window, told))
        found = max(found, other, key=lambda each: each.weight)
    return found


def _as_told(bank: FaultBank, decision: Decision, window: Window) -> list[Change]:
    """The bank's events in a window: each fault comes, and goes where its event ends early, or
    becomes another size where it jumps."""
    names = bank.model.plant.signals.fault_names
    changes = list[Change]()
    for event in decision.events:
        if event.size is None or not window.t[0] <= event.start <= window.t[-1]:
            continue
        k, at = names.index(event.fault), int(np.searchsorted(window.t, event.onset))
        before = 0.0
        if changes and (changes[-1].fault, changes[-1].at) == (k, at):
            before = changes.pop().size
        changes.append(Change(k, at, event.size + before))
        end = int(np.searchsorted(window.t, event.end, "right"))
        if end < len(window.t):
            changes.append(Change(k, end, -event.size))
    return sorted(changes, key=lambda change: change.at)[:MOST]


def _weighed(bank: FaultBank, window: Window, alone: Causes, told: list[Change]) -> ChangeHistory:
    if not told:
        return ChangeHistory((), -np.inf, alone, alone)
    more = causes_of(bank, _knowing(window, told))
    told = sorted(told, key=lambda change: change.at)
    posteriors = [alone]
    if len(told) > 1:
        posteriors = [causes_of(bank, _knowing(window, _others(told, j))) for j in range(len(told))]
    every = float(more.seen[-1].base)
    weight = every - float(alone.seen[-1].base)
    for change, causes in zip(told, posteriors, strict=True):
        weight += total(causes.weight[:, change.fault]) - (every - float(causes.seen[-1].base))
    return ChangeHistory(_sized(bank, window, told, posteriors), weight, alone, more)


def _likeliest(
    bank: FaultBank, causes: Causes, others: list[Change], least: float = CLEAR
) -> Change | None:
    """The best declared change; None where its weight is below the `least`, by default that from
    which on it is clear that there is one."""
    faults = bank.model.plant.signals.faults
    present = {change.fault for change in others}
    full = len(present) >= bank.model.plant.signals.max_simultaneous
    legal = sorted(present) if full else list(range(len(faults)))
    best = max(legal, key=lambda k: total(causes.weight[:, k]))
    if total(causes.weight[:, best]) < least:
        return None
    at = int(np.argmax(causes.weight[:, best]))
    return Change(best, at, float(causes.mean[at, best]))


def _revised(bank: FaultBank, window: Window, told: list[Change]) -> list[Change]:
    """Every change looked for anew beside the others; one that is not needed goes."""
    for _ in range(ROUNDS):
        before = [(change.fault, change.at) for change in told]
        for j in reversed(range(len(told))):
            others = _others(told, j)
            again = _likeliest(bank, causes_of(bank, _knowing(window, others)), others)
            told = [*others[:j], *([] if again is None else [again]), *others[j:]]
        if [(change.fault, change.at) for change in told] == before:
            break
    return told


def _others(told: list[Change], j: int) -> list[Change]:
    return told[:j] + told[j + 1 :]


def _knowing(window: Window, told: list[Change]) -> Window:
    return window._replace(record=window.record._replace(known=_steps(window, told)))


def _steps(window: Window, told: list[Change]) -> jax.Array:
    f = np.zeros(window.record.f.shape)
    for change in told:
        f[change.at :, change.fault] += change.size
    return jax.numpy.asarray(f)


def _sized(
    bank: FaultBank, window: Window, told: list[Change], posteriors: list[Causes]
) -> tuple[Sized, ...]:
    """Joint sizes, and how sure the levels are."""
    effects = []
    for j, change in enumerate(told):
        seen = shocks_of(bank, _knowing(window, _others(told, j)), _steps(window, [change]))
        effects.append(np.asarray(seen.fit)[: len(window.t)])
    S = np.stack([e.ravel() / c.size for e, c in zip(effects, told, strict=True)], axis=1)
    prior = np.array([bank.size[change.fault] for change in told])
    G = S.T @ S + np.diag(prior**-2.0)
    spread = np.linalg.inv(G)
    found = []
    for j, change in enumerate(told):
        mine = np.array([c.fault == change.fault and i <= j for i, c in enumerate(told)], float)
        before = sum(c.size for i, c in enumerate(told) if mine[i] and i < j)
        wider = float(np.sqrt(mine @ spread @ mine * G[j, j]))
        found.append(Sized(change, posteriors[j], float(before), wider, effects[j]))
    return tuple(found)
