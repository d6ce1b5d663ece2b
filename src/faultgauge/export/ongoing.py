"""Events row by row, as a stream tells them while they go on: what begins, lasts and is over.

`detection.stream` keeps the rows of what may be an event, which takes memory that grows; what it
tells before one is over needs only who was told already, and for how long nothing spoke of a fault.
"""

from enum import IntEnum
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.posterior.events import pause
from faultgauge.detection.posterior.verdicts import FAULT, HEALTHY, STATUS, Reason
from faultgauge.detection.watch import Row

__all__ = ["EventPhase", "Ongoing", "OngoingState"]


class EventPhase(IntEnum):
    """Of an event of a cause, at a row. `OVER` is told once, as is `BEGINS`."""

    NONE = 0
    BEGINS = 1
    LASTS = 2
    OVER = 3


class OngoingState(NamedTuple):
    """`calm`: sampled rows in a row that speak of no fault; `told`: the declared faults, an
    undeclared one and, last, an alarm that had no name."""

    calm: Int[Array, ""]
    told: Bool[Array, "causes"]


class Ongoing(eqx.Module):
    """What `Stream` says of rows before it looks back: `passive` are causes that raise no alarm,
    `most` the p of no fault up to which the alarm's level is reached, `release` and `pause` those
    of the plant file [1, samples]."""

    release: float
    most: float
    pause: int
    passive: Bool[np.ndarray, "causes"]

    @classmethod
    def of(cls, bank: FaultBank) -> "Ongoing":
        passive = np.append(bank.with_monitor("passive"), False)
        release = bank.model.plant.signals.detection.release
        return cls(float(release), 1 / (1 + np.exp(float(bank.level))), pause(bank), passive)

    def init(self) -> OngoingState:
        return OngoingState(jnp.asarray(0), jnp.zeros(len(self.passive) + 1, bool))

    def step(self, state: OngoingState, row: Row) -> tuple[OngoingState, Int[Array, "causes"]]:
        """(the state after, an `EventPhase` of each cause and of an alarm without a name)."""
        found, verdict = row.posterior, row.verdict
        alarm = verdict.status == STATUS.index(FAULT)
        quiet = verdict.status == STATUS.index(HEALTHY)
        passive = verdict.reason % len(Reason) == Reason.PASSIVE
        named = verdict.named & (alarm | ((alarm | quiet | passive) & self.passive))
        nameless = alarm & ~jnp.any(named) & ~jnp.any(state.told)
        begins = jnp.append(named & ~state.told[:-1], nameless)
        told = state.told | begins
        sampled = jnp.isfinite(found.healthy)
        calm = jnp.where(self._speaks(row), 0, jnp.minimum(state.calm + sampled, self.pause + 1))
        over = calm > self.pause
        lasts = jnp.where(
            over, EventPhase.OVER, jnp.where(begins, EventPhase.BEGINS, EventPhase.LASTS)
        )
        said = jnp.where(told, lasts, EventPhase.NONE)
        return OngoingState(calm, told & ~over), said.astype(jnp.int32)

    def _speaks(self, row: Row) -> Bool[Array, ""]:
        """Whether a row speaks of a fault."""
        found, verdict = row.posterior, row.verdict
        likely = jnp.append(found.p, found.unknown) >= self.release
        alarm = jnp.stack([verdict.alarm, found.healthy <= self.most])
        return jnp.any(jnp.concatenate([likely, verdict.named, alarm]))
