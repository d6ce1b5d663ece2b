"""Where the unseen data lie against what training covered, per argument of every network."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.identification.samples import Samples
from faultgauge.identification.validation.evaluation import Prediction
from faultgauge.plants.expression import Call, Name, Negative, Node, evaluate, networks_used
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.units import text

__all__ = ["Range", "argument_ranges"]

Ends = tuple[float, float]


@dataclass(frozen=True)
class Range:
    """Range of one quantity in training and in the unseen free runs.

    Attributes:
        where: the network it is an argument of, or "state" or "input".
        name: its expression, as the plant file has it.
        unit: its unit as declared; empty where none follows.
        training: smallest and largest value in training; None where nothing is known.
        unseen: the same in the free runs; None where none is finite.
        share_outside: of the unseen samples; samples without a finite value are outside.
        beyond: the furthest of them, in widths of the training range.
    """

    where: str
    name: str
    unit: str
    training: Ends | None
    unseen: Ends | None
    share_outside: float | None
    beyond: float | None


def argument_ranges(
    plant: GrayBoxPlant, training: Samples, predictions: Sequence[Prediction]
) -> tuple[Range, ...]:
    """Ranges of every network argument, then of every state and input.

    Unseen values are those of the free runs: x as simulated, d(x) as the model has it. A network
    called in several places has one range per argument, as its scaling has.
    """
    x = np.concatenate([p.x[p.warmup :] for p in predictions])
    u = np.concatenate([p.u[p.warmup :] for p in predictions])
    dx = np.asarray(jax.jit(jax.vmap(plant.derivative))(jnp.asarray(x), jnp.asarray(u)))
    found = []
    for network, nodes in _arguments(plant):
        seen, unseen = (
            np.concatenate([_values(plant, node, *points) for node in nodes])
            for points in ((training.x, training.u, training.dx), (x, u, dx))
        )
        name = " and ".join(text(node) for node in nodes)
        found.append(_range(network, name, _unit(plant, nodes[0]), seen, unseen))
    for where, signals, seen, unseen in (
        ("state", plant.signals.states, training.x, x),
        ("input", plant.signals.inputs, training.u, u),
    ):
        for k, signal in enumerate(signals):
            found.append(_range(where, signal.name, signal.unit, seen[:, k], unseen[:, k]))
    return tuple(found)


def _arguments(plant: GrayBoxPlant) -> list[tuple[str, list[Node]]]:
    """(network, the expressions that stand in one of its places) for every place."""
    places: dict[tuple[str, int], list[Node]] = {}
    for expression in (*plant.spec.derivatives, *plant.spec.values):
        for network, calls in networks_used(expression).items():
            for call in calls:
                for k, node in enumerate(call):
                    nodes = places.setdefault((network, k), [])
                    if node not in nodes:
                        nodes.append(node)
    return [(network, nodes) for (network, _), nodes in places.items()]


def _values(
    plant: GrayBoxPlant,
    node: Node,
    x: Float[np.ndarray, "samples states"],
    u: Float[np.ndarray, "samples inputs"],
    dx: Float[np.ndarray, "samples states"],
) -> Float[np.ndarray, "samples"]:
    signals = plant.signals
    values: dict[str, np.ndarray | float] = {
        name: float(value) for name, value in plant.parameters.items()
    }
    values |= dict(zip(signals.state_names, x.T, strict=True))
    values |= dict(zip(signals.input_names, u.T, strict=True))

    def inner(network: str, *arguments: np.ndarray | float) -> np.ndarray:
        whole = [jnp.broadcast_to(jnp.asarray(each, float), len(x)) for each in arguments]
        return np.asarray(jax.vmap(plant.networks[network])(*whole))

    networks = {name: (lambda *a, name=name: inner(name, *a)) for name in plant.networks}
    rates = dict(zip(signals.state_names, dx.T, strict=True))
    with np.errstate(all="ignore"):
        found = evaluate(node, values, np, derivatives=rates, networks=networks)
    return np.broadcast_to(np.asarray(found, float), len(x))


def _range(
    where: str,
    name: str,
    unit: str,
    seen: Float[np.ndarray, "training"],
    unseen: Float[np.ndarray, "unseen"],
) -> Range:
    training, other = _ends(seen), _ends(unseen)
    if training is None or not len(unseen):
        return Range(where, name, unit, training, other, None, None)
    low, high = training
    share = float(np.mean(~((unseen >= low) & (unseen <= high))))
    beyond = None
    if other is not None and high > low:
        beyond = max(low - other[0], other[1] - high, 0.0) / (high - low)
    return Range(where, name, unit, training, other, share, beyond)


def _ends(values: Float[np.ndarray, "_"]) -> Ends | None:
    values = values[np.isfinite(values)]
    return (float(np.min(values)), float(np.max(values))) if values.size else None


def _unit(plant: GrayBoxPlant, node: Node) -> str:
    """The unit of a name, its rate, its negative or its size; of others none is claimed."""
    signals, parameters = plant.signals, plant.spec.parameters
    units = {each.name: each.unit for each in (*signals.states, *signals.inputs, *parameters)}
    match node:
        case Name():
            return units[node.name]
        case Negative():
            return _unit(plant, node.operand)
        case Call(function="abs"):
            return _unit(plant, node.arguments[0])
        case Call(function="d"):
            unit = _unit(plant, node.arguments[0])
            return f"({unit})/s" if unit else ""
        case _:
            return ""
