"""A plant file as a `Plant`: its integrators and physics as written, its networks as leaves."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.plants.expression import Call, derivatives_used, evaluate, networks_used
from faultgauge.plants.network import Network
from faultgauge.plants.plant import Plant, ValueChange
from faultgauge.plants.plant_file import parse_plant, read_plant_text
from faultgauge.plants.signals import Signals
from faultgauge.plants.spec import Parameter, PlantSpec

__all__ = ["GrayBoxPlant", "load_plant"]


class GrayBoxPlant(Plant):
    """The gray-box model of the paper (eqs 1 to 4), for any plant file.

    Networks and parameters are leaves; the expressions are static. Fitting changes leaves only.
    """

    signals: Signals = eqx.field(static=True)
    spec: PlantSpec = eqx.field(static=True)
    networks: dict[str, Network]
    parameters: dict[str, Float[Array, ""]]

    @staticmethod
    def untrained(spec: PlantSpec) -> "GrayBoxPlant":
        """The plant as its file states it: parameters at their values, networks zero."""
        return GrayBoxPlant(
            signals=spec.signals,
            spec=spec,
            networks={n.name: Network.zeros(n.hidden, n.arity, n.shape) for n in spec.networks},
            parameters={p.name: jax.device_put(np.float64(p.value)) for p in spec.parameters},
        )

    @property
    def constants(self) -> tuple[Parameter, ...]:
        return self.spec.parameters

    @property
    def gains(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(each.name, 1.0, min=0.0) for each in self.spec.networks)

    def values(self) -> dict[str, Any]:
        return self.parameters | {each.name: each.value for each in self.gains}

    def with_constants(self, values: Mapping[str, Any]) -> "GrayBoxPlant":
        own = {name: value for name, value in values.items() if name in self.parameters}
        networks = {
            name: each.altered(ValueChange(values[name])) if name in values else each
            for name, each in self.networks.items()
        }
        return dataclasses.replace(self, parameters={**self.parameters, **own}, networks=networks)

    def derivative(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "states"]:
        return self.moved(x, u, np.zeros(len(self.signals.states)))

    @property
    def chained(self) -> bool:
        return any(derivatives_used(each) for each in self.spec.derivatives)

    def moved(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        beside: Float[Array | np.ndarray, "states"],
    ) -> Float[Array, "states"]:
        values = self.point(x, u)
        names = self.signals.state_names
        rates: dict[str, Any] = {}
        for index in self.spec.order:
            tree = self.spec.derivatives[index].tree
            rates[names[index]] = beside[index] + evaluate(
                tree, values, jnp, derivatives=rates, networks=self.networks
            )
        return jnp.stack([jnp.asarray(rates[name], float) for name in names])

    def output(
        self,
        dx: Float[Array, "states"],
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
    ) -> Float[Array, "outputs"]:
        outputs = self.equations(x, u, dx, (), range(len(self.spec.values)))
        return jnp.stack([jnp.asarray(output, float) for output in outputs])

    def equations(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        dx: Float[Array, "states"] | None,
        states: Sequence[int],
        outputs: Sequence[int] = (),
    ) -> list[Array]:
        """F of those `states`, then h of those `outputs`, each by itself: a d(state) in it is what
        `dx` says; without `dx` none may be read."""
        values = self.point(x, u)
        rates = None if dx is None else dict(zip(self.signals.state_names, dx, strict=True))
        trees = [self.spec.derivatives[i].tree for i in states]
        trees += [self.spec.values[j].tree for j in outputs]
        return [
            evaluate(tree, values, jnp, derivatives=rates, networks=self.networks) for tree in trees
        ]

    def altered(self, changes: Mapping[str, ValueChange]) -> "GrayBoxPlant":
        """The plant with its parameters and networks changed, by their names."""
        parameters, networks = dict(self.parameters), dict(self.networks)
        for name, change in changes.items():
            if name in parameters:
                parameters[name] = change.of(parameters[name])
            else:
                networks[name] = networks[name].altered(change)
        return dataclasses.replace(self, parameters=parameters, networks=networks)

    def network_values(
        self, name: str, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "calls"]:
        """What network `name` gives at each place where the file calls it."""
        values = self.point(x, u)
        rates = dict(zip(self.signals.state_names, self.derivative(x, u), strict=True))
        found = [
            evaluate(Call(name, call), values, jnp, derivatives=rates, networks=self.networks)
            for expression in (*self.spec.derivatives, *self.spec.values)
            for call in networks_used(expression).get(name, ())
        ]
        return jnp.stack(found)

    def point(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Mapping[str, Float[Array, ""]]:
        """Every name that an expression may read, at one point."""
        return {
            **self.parameters,
            **dict(zip(self.signals.state_names, x, strict=True)),
            **dict(zip(self.signals.input_names, u, strict=True)),
        }


def load_plant(source: str | Path) -> GrayBoxPlant:
    """Read the plant file `source` (or a preset by its name) as an untrained plant.

    Raises `InputError` naming the key and column of the first mistake.
    """
    return GrayBoxPlant.untrained(parse_plant(read_plant_text(source), str(source)))
