"""A plant that is not its model: F is followed by a discrepancy, and constants are uncertain.

    x' = F(x, u; theta + offset + W xi) + E (d + e),    d' = -d / tau + w,    xi' = 0,

    e' = -e / settling,    and by N(0, (share (F(x, u) - F(x, u before)))^2) where u changes

    y = h(x', x, u) + b,    b' = -b / wandering + w

d is a Gauss-Markov process beside every state that is not exact kinematics (Kennedy and O'Hagan, J.
R. Statist. Soc. B 63 (2001), "Bayesian calibration of computer models": what the model lacks is a
process of its own); with infinite tau it is a random walk. e is what an input's change does
besides: a random share of its effect, so that a lag or a delay that the model does not have is
borne for as long as `settling`, and no loop that answers d by u makes d look like an effect of u. b
is what an output's own equation lacks, where healthy logs show that it lacks something: noise of a
sensor that remembers, a gust in what an accelerometer feels. xi are the directions in which the
constants are uncertain, of unit variance.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.plants.expression import is_state, names_used
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Change, Plant, respond
from faultgauge.plants.signals import Fault, Signals, State

__all__ = ["Disturbed", "Error", "dynamic_states", "following_states"]


class Error(NamedTuple):
    """Time constant `tau` [s] of every driven state's d; of every e its time constant `settling`
    [s] and its `share` of what an input's change does (a standard deviation); time constant
    `wandering` [s] of every b."""

    tau: Float[Array, "driven"]
    settling: Float[Array, "following"]
    share: Float[Array, "following"]
    wandering: Float[Array | np.ndarray, "outputs"] = np.zeros(0)


class Disturbed(Plant):
    """`base` with the states [x, d, e, b, xi]; `driven` are the states that d acts on, `following`
    those that e acts on, `wandering` the outputs that b acts on, `names` the parameters, of which
    `directions` (W) is a row each."""

    signals: Signals = eqx.field(static=True)
    base: Plant
    error: Error
    offset: Float[Array, "parameters"]
    directions: Float[Array, "parameters directions"]
    driven: tuple[int, ...] = eqx.field(static=True)
    following: tuple[int, ...] = eqx.field(static=True)
    wandering: tuple[int, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    @staticmethod
    def of(
        base: Plant,
        driven: tuple[int, ...],
        following: tuple[int, ...],
        error: Error,
        names: tuple[str, ...],
        offset: Float[Array, "parameters"],
        directions: Float[Array, "parameters directions"],
        undeclared: tuple[Fault, ...] = (),
        wandering: tuple[int, ...] = (),
    ) -> "Disturbed":
        """`undeclared` faults stand behind those that `base` declares."""
        signals = base.signals
        more = [State(f"d({signals.state_names[i]})") for i in driven]
        more += [State(f"e({signals.state_names[i]})") for i in following]
        more += [State(f"b({signals.output_names[j]})") for j in wandering]
        more += [State(f"xi({k})") for k in range(directions.shape[1])]
        own = replace(
            signals,
            states=(*signals.states, *more),
            faults=(*signals.faults, *undeclared),
        )
        return Disturbed(own, base, error, offset, directions, driven, following, wandering, names)

    @property
    def count(self) -> int:
        """How many states `base` has."""
        return len(self.base.signals.states)

    @property
    def parts(self) -> tuple[slice, slice, slice, slice, slice]:
        """Where x, d, e, b and xi stand among the states."""
        counts = (self.count, len(self.driven), len(self.following), len(self.wandering))
        edges = [0, *np.cumsum([*counts, self.directions.shape[1]]).tolist()]
        x, d, e, b, xi = (slice(*each) for each in pairwise(edges))
        return x, d, e, b, xi

    def derivative(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "states"]:
        own, *others = self.parts
        d, e, b, xi = (x[part] for part in others)
        dx = self.plant_at(x).derivative(x[own], u)
        dx = dx + _acts(self.count, self.driven) @ d + _acts(self.count, self.following) @ e
        slow, quick = -d / self.error.tau, -e / self.error.settling
        return jnp.concatenate([dx, slow, quick, -b / self.error.wandering, 0 * xi])

    def output(
        self,
        dx: Float[Array, "states"],
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
    ) -> Float[Array, "outputs"]:
        own, _, _, b, _ = self.parts
        y = self.plant_at(x).output(dx[own], x[own], u)
        return y + _acts(len(y), self.wandering) @ x[b] if self.wandering else y

    def jumps(
        self,
        x: Float[Array, "states"],
        u_before: Float[Array, "inputs"],
        u: Float[Array, "inputs"],
        f_before: Float[Array, "faults"],
        f: Float[Array, "faults"],
    ) -> Float[Array, "states"]:
        """By how much the states may jump where input or faults change (standard deviations)."""
        if not self.following:
            return jnp.zeros(len(x))
        us, fs = jnp.stack([u, u_before]), jnp.stack([f, f_before])
        both = jax.vmap(lambda u, f: respond(self, x, u, f)[0])(us, fs)
        own, _, e, _, _ = self.parts
        change = _acts(self.count, self.following).T @ (both[0] - both[1])[own]
        return jnp.zeros(len(x)).at[e].set(jnp.abs(self.error.share * change))

    def altered(self, changes: Mapping[str, Change]) -> "Disturbed":
        """`base` altered: what xi adds to a constant is not."""
        return replace(self, base=self.base.altered(changes))

    def plant_at(self, x: Float[Array, "states"]) -> Plant:
        """`base` with the constants that xi makes of them."""
        plant = self.base
        if not self.names or not isinstance(plant, GrayBoxPlant):
            return plant
        shift = self.offset + self.directions @ x[self.parts[-1]]
        changed = {name: plant.parameters[name] + shift[k] for k, name in enumerate(self.names)}
        return GrayBoxPlant(
            plant.signals, plant.spec, plant.networks, {**plant.parameters, **changed}
        )


def _acts(count: int, on: tuple[int, ...]) -> Float[np.ndarray, "count some"]:
    """What a unit of each of some does to one each of `count`."""
    acts = np.zeros((count, len(on)))
    acts[list(on), range(len(on))] = 1.0
    return acts


def dynamic_states(plant: Plant) -> tuple[int, ...]:
    """The states whose equation may be wrong: those that are not exact kinematics, which the file
    says, or whose derivative is another state and nothing else."""
    states = plant.signals.states
    exact = [each.exact for each in states]
    if isinstance(plant, GrayBoxPlant):
        names = plant.signals.state_names
        trees = [each.tree for each in plant.spec.derivatives]
        exact = [e or is_state(tree, names) for e, tree in zip(exact, trees, strict=True)]
    return tuple(k for k, known in enumerate(exact) if not known)


def following_states(plant: Plant) -> tuple[int, ...]:
    """Those of the dynamic states whose derivative reads an input."""
    dynamic = dynamic_states(plant)
    if not isinstance(plant, GrayBoxPlant):
        return dynamic
    inputs = set(plant.signals.input_names)
    return tuple(k for k in dynamic if inputs & set(names_used(plant.spec.derivatives[k])))
