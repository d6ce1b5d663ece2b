"""Where a model is trusted: known physics extrapolates, a network does not.

What reaches a network lies in what it was trained on (`coverage`), and what the plant file bounds
by `trusted` lies within. Both are asked of the states and of the inputs, as commanded or as applied
with the posterior means of the faults, clip((1 - f_gain) u + f_input, min, max). Either will do: a
command inside speaks for or against the healthy plant; and in a closed loop a fault moves the
command, while what is applied stays where it was.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.detection.bank.coverage import Region
from faultgauge.plants.model import Model
from faultgauge.plants.signals import Signals
from faultgauge.products import contract

__all__ = ["Applied", "Bound", "Envelope", "bounds_of"]


class Bound(NamedTuple):
    """What the plant file bounds: state or input `name`, its place among [states, inputs]."""

    name: str
    at: int
    low: float
    high: float
    unit: str


def bounds_of(signals: Signals) -> list[Bound]:
    """Whatever the plant file bounds."""
    every = enumerate((*signals.states, *signals.inputs))
    return [
        Bound(each.name, k, *each.trusted, each.unit)
        for k, each in every
        if each.trusted is not None
    ]


class Applied(eqx.Module):
    """What faults make of the inputs and of the states' derivatives, as `respond` has them: which
    fault is a `gain` of an input, adds to an `extra` input, or to a state it has `driven`."""

    gain: Float[np.ndarray, "inputs faults"]
    extra: Float[np.ndarray, "inputs faults"]
    driven: Float[np.ndarray, "states faults"]
    limits: Float[np.ndarray, "two inputs"]
    low: Float[np.ndarray, "faults"]
    high: Float[np.ndarray, "faults"]

    @staticmethod
    def of(signals: Signals) -> "Applied":
        def places(enters: str, names: tuple[str, ...]) -> np.ndarray:
            found = [[f.enters == enters and f.target == n for f in signals.faults] for n in names]
            return np.array(found, float).reshape(len(names), len(signals.faults))

        return Applied(
            places("gain", signals.input_names),
            places("input", signals.input_names),
            places("state", signals.state_names),
            np.array([[e.min for e in signals.inputs], [e.max for e in signals.inputs]], float),
            np.array([fault.min for fault in signals.faults]),
            np.array([fault.max for fault in signals.faults]),
        )

    def __call__(
        self,
        u: Float[Array, "inputs"],
        p: Float[Array, "sets"],
        f: Float[Array, "sets faults"],
    ) -> tuple[Float[Array, "inputs"], Float[Array, "states"]]:
        """(the inputs as they act, what is added to the states' derivatives) with the posterior
        means of the faults `f` in every set, of probability `p`."""
        size = jnp.clip(contract("s,sf->f", p, f), self.low, self.high)
        kept = jnp.prod(1 - self.gain * size, axis=1)
        acting = jnp.clip(
            kept * u + contract("ij,j->i", self.extra, size), self.limits[0], self.limits[1]
        )
        return acting, contract("ij,j->i", self.driven, size)


class Envelope(eqx.Module):
    """The networks' `regions` and, behind them, the `low` and `high` that the file gives for some
    of [states, inputs] (`at`)."""

    regions: tuple[Region, ...]
    applied: Applied
    low: Float[np.ndarray, "bounds"]
    high: Float[np.ndarray, "bounds"]
    at: tuple[int, ...] = eqx.field(static=True)

    @staticmethod
    def of(model: Model, regions: tuple[Region, ...]) -> "Envelope":
        signals = model.plant.signals
        bounds = bounds_of(signals)
        low, high = (np.array([getattr(b, end) for b in bounds], float) for end in ("low", "high"))
        return Envelope(regions, Applied.of(signals), low, high, tuple(b.at for b in bounds))

    def outside(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        p: Float[Array, "sets"],
        f: Float[Array, "sets faults"],
    ) -> Int[Array, ""]:
        """0 where the model is trusted, else 1 + the place of the first that was left."""
        if not self.regions and not self.at:
            return jnp.zeros((), int)
        acting, driven = self.applied(u, p, f)
        either = ((u, jnp.zeros_like(driven)), (acting, driven))
        covered = [each.holds(x, *either[0]) | each.holds(x, *either[1]) for each in self.regions]
        at, own = np.array(self.at, int), np.array(self.at, int) < len(x)

        def within(values: Array, some: np.ndarray) -> Array:
            return (values >= self.low[some]) & (values <= self.high[some])

        held = within(x[at[own]], own)
        inputs = [within(each[at[~own] - len(x)], ~own) for each in (u, acting)]
        trusted = jnp.array(covered, bool).reshape(-1), held, inputs[0] | inputs[1]
        trusted = jnp.concatenate(trusted)
        return jnp.where(jnp.all(trusted), 0, jnp.argmin(trusted) + 1)
