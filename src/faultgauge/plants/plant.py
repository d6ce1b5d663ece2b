"""The one protocol: dx = F(x, u), y = h(dx, x, u)."""

import abc
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.plants.signals import INNER, Signals
from faultgauge.plants.spec import Parameter
from faultgauge.programs import program

__all__ = ["Plant", "Stuck", "ValueChange", "applied", "clip_state", "respond", "responses"]

# Every JAX module of faultgauge imports this one. float32 surprises: identification needs 1e-8.
jax.config.update("jax_enable_x64", True)
# A program runs in the thread that calls it; else two of them wait for each other's threads.
jax.config.update("jax_cpu_enable_async_dispatch", False)


class ValueChange(NamedTuple):
    """What faults make of the value v of a parameter or a network: factor v + shift."""

    factor: Float[Array, ""] | float = 1.0
    shift: Float[Array, ""] | float = 0.0

    def of(self, value: Float[Array, "*any"]) -> Float[Array, "*any"]:
        """What becomes of `value`."""
        return self.factor * value + self.shift


class Plant(eqx.Module):
    """A plant of the form (paper, eq 1)

        dx = F(x, u),    y = h(dx, x)        (h may also read u)

    Bodies are physics written by hand, a plant file, or the same file after fitting. Everything
    downstream takes a `Plant` and cannot tell which it got.
    """

    signals: eqx.AbstractVar[Signals]

    @property
    def constants(self) -> tuple[Parameter, ...]:
        """What a fit may find, or a fault change: fields of the class by their names, none of them
        unless it says so. A field's value counts in place of the one given here."""
        return ()

    @abc.abstractmethod
    def derivative(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "states"]:
        """F(x, u): each state's unit per second; `u` is what the actuator applies."""

    @property
    def chained(self) -> bool:
        """Whether one state's rate reads another one's."""
        return False

    def moved(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        beside: Float[Array | np.ndarray, "states"],
    ) -> Float[Array, "states"]:
        """F(x, u) with `beside` added to the rates. A plant that is `chained`, as a trolley's
        acceleration moves its load, says what that does to the rates that read these."""
        return self.derivative(x, u) + beside

    @abc.abstractmethod
    def output(
        self,
        dx: Float[Array, "states"],
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
    ) -> Float[Array, "outputs"]:
        """h(dx, x, u): each output in its own unit."""

    def besides(self, x: Float[Array, "states"]) -> Float[Array, "outputs"]:
        """What the outputs show besides h, and no loss of their gain makes less: nothing."""
        return jnp.zeros(len(self.signals.outputs))

    def altered(self, changes: Mapping[str, ValueChange]) -> "Plant":
        """The plant with its parameters and networks, by name, as `changes` make them.

        Only a plant that declares faults which enter something else than its `constants` needs one.
        """
        known = {each.name for each in self.constants}
        if changes.keys() - known:
            raise NotImplementedError(
                f"{type(self).__name__} declares faults of {', '.join(changes)} and has no "
                "`altered`, nor `constants` of these names"
            )
        values = self.values()
        return self.with_constants({n: c.of(values[n]) for n, c in changes.items()})

    def values(self) -> dict[str, Any]:
        """The values of the `constants`, by name."""
        return {p.name: jnp.asarray(getattr(self, p.name), float) for p in self.constants}

    @property
    def gains(self) -> tuple[Parameter, ...]:
        """By what its networks may be larger or smaller in another run, as constants of their
        names, 1 in a fit: of a plant that has none, nothing."""
        return ()

    def with_constants(self, values: Mapping[str, Any]) -> "Plant":
        """The plant with some of its `constants` and `gains` at other `values`, by name."""
        if not values:
            return self
        return eqx.tree_at(lambda p: [getattr(p, n) for n in values], self, [*values.values()])


class Stuck(NamedTuple):
    """Channels that hold a value whatever happens: what each is stuck at, NaN where it is free."""

    dx: Float[Array | np.ndarray, "*grid states"]
    u: Float[Array | np.ndarray, "*grid inputs"]
    y: Float[Array | np.ndarray, "*grid outputs"]


def respond(
    plant: Plant,
    x: Float[Array, "states"],
    u: Float[Array, "inputs"],
    f: Float[Array, "faults"] | None = None,
    stuck: Stuck | None = None,
) -> tuple[Float[Array, "states"], Float[Array, "outputs"]]:
    """(dx, y) of the plant under command `u` with fault sizes `f` (None: healthy).

    p   <-  (1 + f_relative) p + f_parameter      (a network's value likewise, wherever called)
    u   <-  clip((1 - f_gain) u + f_input, min, max)
    dx  =  F(x, u) + f_state                      (what reads d(state) reads all of it)
    y   =  (1 - f_output_gain) h(dx, x, u) + f_output

    each overwritten where it is `stuck`. Several factors of one place multiply.
    """
    signals = plant.signals
    added: dict[str, list[tuple[int, Array]]] = {"state": [], "output": [], "input": []}
    lost: dict[str, list[tuple[int, Array]]] = {"gain": [], "output_gain": []}
    changes: dict[str, ValueChange] = {}
    names = {"state": signals.state_names, "input": signals.input_names}
    names |= {"output": signals.output_names, "gain": signals.input_names}
    names |= {"output_gain": signals.output_names}
    for size, fault in () if f is None else zip(f, signals.faults, strict=True):
        if fault.enters in INNER:
            known = changes.get(fault.target, ValueChange())
            changes[fault.target] = _changed(known, size, fault.relative)
        else:
            into = added if fault.enters in added else lost
            into[fault.enters].append((names[fault.enters].index(fault.target), size))
    if changes:
        plant = plant.altered(changes)
    u = _limited(signals, _scaled(u, lost["gain"]) + _placed(added["input"], len(u)))
    if stuck is not None:
        u = _overwritten(u, stuck.u)
    dx = plant.moved(x, u, _placed(added["state"], len(x)))
    if stuck is not None:
        dx = _overwritten(dx, stuck.dx)
    y = _scaled(plant.output(dx, x, u), lost["output_gain"])
    y = y + _placed(added["output"], len(signals.outputs)) + plant.besides(x)
    return dx, y if stuck is None else _overwritten(y, stuck.y)


@program
def responses(
    plant: Plant, x: Float[Array, "points states"], u: Float[Array, "points inputs"]
) -> tuple[Float[Array, "points states"], Float[Array, "points outputs"]]:
    """(dx, y) of the healthy plant at some points."""
    return jax.vmap(lambda x, u: respond(plant, x, u))(x, u)


def applied(
    signals: Signals, u: Float[Array, "inputs"], f: Float[Array, "faults"]
) -> Float[Array, "inputs"]:
    """What reaches the plant of a command `u` with fault sizes `f`, as in `respond`."""
    names, none = signals.input_names, jnp.zeros(len(u))
    for size, fault in zip(f, signals.faults, strict=True):
        if fault.enters == "gain":
            u = _scaled(u, [(names.index(fault.target), size)])
        elif fault.enters == "input":
            none = none + _placed([(names.index(fault.target), size)], len(u))
    return _limited(signals, u + none)


def _limited(signals: Signals, u: Float[Array, "inputs"]) -> Float[Array, "inputs"]:
    lower = jnp.array([each.min for each in signals.inputs])
    upper = jnp.array([each.max for each in signals.inputs])
    return jnp.clip(u, lower, upper)


def _placed(sizes: list[tuple[int, Array]], count: int) -> Float[Array, "count"]:
    """The sum of `sizes`, each at its place."""
    total = jnp.zeros(count)
    for place, size in sizes:
        total = total + size * np.eye(count)[place]
    return total


def _scaled(values: Float[Array, "n"], losses: list[tuple[int, Array]]) -> Float[Array, "n"]:
    """`values` less the share of each that is lost."""
    for place, size in losses:
        values = values * (1.0 - size * np.eye(len(values))[place])
    return values


def _changed(known: ValueChange, size: Float[Array, ""], relative: bool) -> ValueChange:
    if relative:
        return known._replace(factor=known.factor * (1.0 + size))
    return known._replace(shift=known.shift + size)


def _overwritten(
    value: Float[Array, "n"], stuck: Float[Array | np.ndarray, "n"]
) -> Float[Array, "n"]:
    return jnp.where(jnp.isnan(stuck), value, stuck)


def clip_state(plant: Plant, x: Float[Array, "states"]) -> Float[Array, "states"]:
    """`x` inside the limits that the plant declares for its states."""
    lower = jnp.array([state.min for state in plant.signals.states])
    upper = jnp.array([state.max for state in plant.signals.states])
    return jnp.clip(x, lower, upper)
