"""A plant with other faults than it declares, under other inputs than are commanded, or held at
rest."""

from collections.abc import Mapping
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.plants.plant import Plant, ValueChange
from faultgauge.plants.signals import Signals
from faultgauge.products import contract

__all__ = ["Bent", "Held", "Reached", "Strayed"]


class Reached(Plant):
    """`base` with the faults of `signals`."""

    signals: Signals = eqx.field(static=True)
    base: Plant

    def reaching(self, u: Float[Array, "inputs"]) -> Float[Array, "inputs"]:
        """What reaches `base` of the inputs: all."""
        return u

    @property
    def chained(self) -> bool:
        return self.base.chained

    def derivative(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "states"]:
        return self.base.derivative(x, self.reaching(u))

    def moved(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        beside: Float[Array | np.ndarray, "states"],
    ) -> Float[Array, "states"]:
        return self.base.moved(x, self.reaching(u), beside)

    def output(
        self,
        dx: Float[Array, "states"],
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
    ) -> Float[Array, "outputs"]:
        return self.base.output(dx, x, self.reaching(u))

    def altered(self, changes: Mapping[str, ValueChange]) -> "Reached":
        """`base` altered."""
        return replace(self, base=self.base.altered(changes))


class Strayed(Reached):
    """`base` under inputs that are by `stray` off."""

    stray: Float[Array | np.ndarray, "inputs"]

    def reaching(self, u: Float[Array, "inputs"]) -> Float[Array, "inputs"]:
        return u + self.stray


class Held(Reached):
    """`base` whose states `sticking` are held by `force` [unit of the state per s] at zero, and by
    half of it where they are `slip`."""

    force: Float[Array, "sticking"]
    slip: Float[Array | np.ndarray, "sticking"]
    sticking: tuple[int, ...] = eqx.field(static=True)

    def derivative(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "states"]:
        return self.moved(x, u, np.zeros(len(x)))

    def moved(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        beside: Float[Array | np.ndarray, "states"],
    ) -> Float[Array, "states"]:
        """F + q / (1 + (x / slip)^2), and `beside`."""
        acts = np.eye(len(x))[:, list(self.sticking)]
        moving = contract("ij,i->j", acts, x) / self.slip
        held = contract("ij,j->i", acts, self.force / (1.0 + moving * moving))
        return self.base.moved(x, u, held + beside)


class Bent(Reached):
    """`base` whose inputs `bending` act along a curve, by the share `bend` of their range from
    `low` to `high` off a straight line in the middle."""

    bend: Float[Array | np.ndarray, "bending"]
    low: Float[Array | np.ndarray, "bending"]
    high: Float[Array | np.ndarray, "bending"]
    bending: tuple[int, ...] = eqx.field(static=True)

    def reaching(self, u: Float[Array, "inputs"]) -> Float[Array, "inputs"]:
        """u + 4 bend (high - low) s (1 - s), from the ends on along a straight line."""
        at, width = np.array(self.bending), self.high - self.low
        s = (u[at] - self.low) / width
        within = jnp.clip(s, 0.0, 1.0)
        more = within * (1 - within) + (s - within) * (1 - 2 * within)
        return u.at[at].add(4 * self.bend * width * more)
