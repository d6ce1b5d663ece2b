"""Equation error: each equation dx_i = F_i(x, u), y_j = h_j(dx, x, u) fitted on its own.

Equations that share a network or a free parameter form one group and are fitted together.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.errors import InputError
from faultgauge.identification.equation.instruments import refit
from faultgauge.identification.optimise.algorithms import ALGORITHMS, AlgorithmName
from faultgauge.identification.optimise.cores import side_by_side
from faultgauge.identification.optimise.gradient_descent import DescentOptions
from faultgauge.identification.optimise.levenberg_marquardt import FAILED, Options, Solution
from faultgauge.identification.optimise.starts import Box, scattered, spread_over
from faultgauge.identification.samples import Samples
from faultgauge.identification.unknowns import WEIGHTS
from faultgauge.plants.expression import Expression, Node, evaluate, names_used, networks_used
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.network import Network
from faultgauge.plants.spec import PlantSpec

__all__ = [
    "EquationResidual",
    "Group",
    "assemble",
    "bounds_of",
    "crowds",
    "equation_errors",
    "fit_group",
    "groups",
    "scale_networks",
    "target_scales",
    "units_of",
    "vector_of",
]

INNER = np.array([-1.0, 1.0])  # assumed of what one network gives to another: not known yet
ROUNDING = 1e-12  # of a range: less of it is none
# Quantiles between which nearly all samples lie, and the part of the range that this must be less
# than to be a crowd: it is 0.4 of the range of 10,000 Gaussian samples, 0.27 of Laplace's.
USUAL, CROWDED = (0.05, 0.95), 0.2


@dataclass(frozen=True)
class Group:
    """Equations fitted together and what is unknown in them.

    `states` and `outputs` index the equations; `networks` and `parameters` are the unknowns.
    """

    states: tuple[int, ...]
    outputs: tuple[int, ...]
    networks: tuple[str, ...]
    parameters: tuple[str, ...]

    @property
    def name(self) -> str:
        return ", ".join([*self.networks, *self.parameters])


def groups(spec: PlantSpec, outputs: Sequence[str]) -> list[Group]:
    """Groups of equations with unknowns; of the outputs, those with telemetry (`outputs`).

    Raises `InputError` for a network that no measured equation determines.
    """
    free = {p.name for p in spec.parameters if not p.fixed}
    open_equations: list[tuple[str, int, set[str]]] = []
    for kind, expressions in (("state", spec.derivatives), ("output", spec.values)):
        for index, expression in enumerate(expressions):
            if kind == "output" and spec.signals.outputs[index].name not in outputs:
                continue
            unknowns = set(names_used(expression) & free) | networks_used(expression).keys()
            if unknowns:
                open_equations.append((kind, index, unknowns))
    determined = set().union(*(unknowns for *_, unknowns in open_equations))
    for network in spec.networks:
        if network.name not in determined:
            raise InputError(
                f"network {network.name!r} of plant {spec.name!r} stands only in outputs without "
                "a telemetry column; add that column (--map OUTPUT=EXPRESSION)."
            )
    merged: list[tuple[list[tuple[str, int]], set[str]]] = []
    for kind, index, unknowns in open_equations:
        touching = [each for each in merged if each[1] & unknowns]
        rest = [each for each in merged if not each[1] & unknowns]
        members = [member for each in touching for member in each[0]]
        together = unknowns.union(*(each[1] for each in touching))
        merged = [*rest, ([*members, (kind, index)], together)]
    return [
        Group(
            states=tuple(sorted(i for kind, i in members if kind == "state")),
            outputs=tuple(sorted(i for kind, i in members if kind == "output")),
            networks=tuple(n.name for n in spec.networks if n.name in unknowns),
            parameters=tuple(p.name for p in spec.parameters if p.name in unknowns),
        )
        for members, unknowns in merged
    ]


def equation_errors(
    plant: GrayBoxPlant, group: Group, sample: Samples
) -> Float[Array, "equations"]:
    """F(x, u) - dx and h(dx, x, u) - y of the group's equations at one sample."""
    x, u, dx = (jnp.asarray(each) for each in (sample.x, sample.u, sample.dx))
    found = plant.equations(x, u, dx, group.states, group.outputs)
    seen = [*(sample.dx[i] for i in group.states), *(sample.y[j] for j in group.outputs)]
    return jnp.stack([value - target for value, target in zip(found, seen, strict=True)])


class EquationResidual(eqx.Module):
    """Residuals of one group at one sample, each divided by its target's spread."""

    plant: GrayBoxPlant
    scales: Float[Array, "equations"]
    units: Float[Array, "parameters"]
    group: Group = eqx.field(static=True)
    errors: Callable[[GrayBoxPlant, Group, Any], Array] = equation_errors

    def __call__(self, theta: Float[Array, "unknowns"], sample: Any) -> Float[Array, "equations"]:
        plant = assemble(self.plant, self.group, theta, self.units)
        return self.errors(plant, self.group, sample) / self.scales


def assemble(
    plant: GrayBoxPlant,
    group: Group,
    theta: Float[Array | np.ndarray, "unknowns"],
    units: Float[Array | np.ndarray, "parameters"],
) -> GrayBoxPlant:
    """`plant` with the group's unknowns from the vector `theta` (parameters in `units`)."""
    networks, parameters, start = dict(plant.networks), dict(plant.parameters), 0
    for name in group.networks:
        fields = {}
        for field in WEIGHTS:
            old = getattr(networks[name], field)
            fields[field] = theta[start : start + old.size].reshape(old.shape)
            start += old.size
        networks[name] = eqx.tree_at(
            lambda net: [getattr(net, field) for field in WEIGHTS],
            networks[name],
            list(fields.values()),
        )
    for k, name in enumerate(group.parameters):
        parameters[name] = theta[start + k] * units[k]
    return eqx.tree_at(lambda p: (p.networks, p.parameters), plant, (networks, parameters))


def units_of(plant: GrayBoxPlant, group: Group) -> Float[np.ndarray, "parameters"]:
    """What the group's parameters are counted in: the sizes that the file states."""
    values = {p.name: p.value for p in plant.spec.parameters}
    return np.array([abs(values[name]) or 1.0 for name in group.parameters])


def bounds_of(
    plant: GrayBoxPlant, group: Group
) -> tuple[Float[np.ndarray, "unknowns"], Float[np.ndarray, "unknowns"]]:
    """(lower, upper) of the group's unknowns by the parameters' min and max, in their units."""
    specs = {p.name: p for p in plant.spec.parameters}
    weights = sum(getattr(plant.networks[n], f).size for n in group.networks for f in WEIGHTS)
    free, units = np.full(weights, np.inf), units_of(plant, group)
    low, high = (
        np.array([getattr(specs[name], end) for name in group.parameters]) / units
        for end in ("min", "max")
    )
    return np.concatenate([-free, low]), np.concatenate([free, high])


def vector_of(plant: GrayBoxPlant, group: Group) -> Float[np.ndarray, "unknowns"]:
    """The group's unknowns in `plant`, as `assemble` takes them."""
    weights = [np.ravel(getattr(plant.networks[n], f)) for n in group.networks for f in WEIGHTS]
    values = np.array([float(plant.parameters[name]) for name in group.parameters])
    return np.concatenate([*weights, values / units_of(plant, group)])


def scale_networks(plant: GrayBoxPlant, group: Group, samples: Samples) -> GrayBoxPlant:
    """Set the scalings of the group's networks from the training samples (mapminmax).

    A network called in several places gets a range that holds all of them. Raises `InputError`
    naming a network argument or an input that the logs never move.
    """
    spec = plant.spec
    inputs = dict(zip(spec.signals.input_names, samples.u.T, strict=True))
    equations = [(spec.derivatives[i], samples.dx[:, i]) for i in group.states]
    equations += [(spec.values[j], samples.y[:, j]) for j in group.outputs]
    outputs = dict.fromkeys(group.networks, 0.0)
    for expression, target in equations:
        for name in sorted(names_used(expression) & inputs.keys()):
            if _flat(_range(inputs[name])):
                raise InputError(
                    f"input {name!r} never changes in the logs, so {group.name} cannot be "
                    "learned (no excitation); add a log in which it moves."
                )
        nested = set[str]().union(
            *(_networks_in(argument) for _, _, argument in _arguments(expression))
        )
        for name in networks_used(expression).keys() - nested:
            low, high = ends = _range(target)
            outputs[name] = max(outputs[name], 0.0 if _flat(ends) else (high - low) / 2)
    networks = dict(plant.networks)
    for name, points in _argument_points(plant, group, samples).items():
        ranges = [_range(each) for each in points]
        networks[name] = _scaled(name, networks[name], ranges, outputs[name] or 1.0)
    return eqx.tree_at(lambda p: p.networks, plant, networks)


def crowds(plant: GrayBoxPlant, group: Group, samples: Samples) -> dict[str, Box]:
    """Where nearly all samples lie, for networks with an argument that seldom leaves a small part
    of its range; for their other arguments the range.

    One sample far off would have all units of a start stand where next to nothing happens.
    """
    found = {}
    for name, points in _argument_points(plant, group, samples).items():
        network = plant.networks[name]
        center, scale = np.asarray(network.input_center), np.asarray(network.input_scale)
        middle, half = network.shape.scalings(*np.array([_usual(each) for each in points]).T)
        heavy = (half > ROUNDING * scale) & (half < CROWDED * scale)
        if np.any(heavy):
            found[name] = Box(np.where(heavy, middle, center), np.where(heavy, half, scale))
    return found


def _argument_points(
    plant: GrayBoxPlant, group: Group, samples: Samples
) -> dict[str, list[Float[np.ndarray, "points"]]]:
    """What every argument of the group's networks is over the samples, wherever it is called."""
    spec = plant.spec
    inputs = dict(zip(spec.signals.input_names, samples.u.T, strict=True))
    states = dict(zip(spec.signals.state_names, samples.x.T, strict=True))
    values = {name: float(v) for name, v in plant.parameters.items()} | states | inputs
    rates = dict(zip(spec.signals.state_names, samples.dx.T, strict=True))
    found: dict[str, dict[int, list[np.ndarray]]] = {name: {} for name in group.networks}
    expressions = [spec.derivatives[i] for i in group.states]
    for expression in [*expressions, *(spec.values[j] for j in group.outputs)]:
        for name, k, argument in _arguments(expression):
            points = INNER if _networks_in(argument) else _points(argument, values, rates)
            found[name].setdefault(k, []).append(points)
    return {name: [np.concatenate(each[k]) for k in sorted(each)] for name, each in found.items()}


def _networks_in(argument: Node) -> set[str]:
    return set(networks_used(Expression("", argument)))


def _arguments(expression: Expression) -> Iterator[tuple[str, int, Node]]:
    """(network, position, argument) of every network call."""
    for name, calls in networks_used(expression).items():
        for call in calls:
            for k, argument in enumerate(call):
                yield name, k, argument


def _points(
    argument: Node, values: Mapping[str, np.ndarray | float], rates: Mapping[str, np.ndarray]
) -> Float[np.ndarray, "points"]:
    with np.errstate(all="ignore"):
        return np.ravel(evaluate(argument, values, np, derivatives=rates))


def _range(points: Float[np.ndarray, "points"]) -> tuple[float, float]:
    """(lowest, highest) of the finite points."""
    points = points[np.isfinite(points)]
    if not points.size:  # the fit will say that its cost is not finite
        return -1.0, 1.0
    return float(np.min(points)), float(np.max(points))


def _usual(points: Float[np.ndarray, "points"]) -> tuple[float, float]:
    """The ends between which nearly all finite points lie."""
    finite = points[np.isfinite(points)]
    if not finite.size:
        return _range(points)
    low, high = np.quantile(finite, USUAL)
    return float(low), float(high)


def _flat(ends: tuple[float, float]) -> bool:
    """Whether a range is empty but for rounding errors."""
    low, high = ends
    return (high - low) / 2 <= ROUNDING * max(abs(low), abs(high))


def _scaled(
    name: str, network: Network, ranges: Sequence[tuple[float, float]], output: float
) -> Network:
    for k, ends in enumerate(ranges):
        if _flat(ends):
            raise InputError(
                f"argument {k + 1} of network {name!r} never changes in the logs (no "
                "excitation): add a log in which it moves, or leave the argument out."
            )
    center, scale = network.shape.scalings(*np.array(ranges).T)
    return eqx.tree_at(
        lambda n: (n.input_center, n.input_scale, n.output_center, n.output_scale),
        network,
        (jnp.asarray(center), jnp.asarray(scale), jnp.zeros(()), jnp.asarray(output)),
    )


def target_scales(group: Group, samples: Any) -> Float[np.ndarray, "equations"]:
    """The spread of every equation's target (`dx` and `y` of the samples)."""
    targets = [samples.dx[:, i] for i in group.states]
    targets += [samples.y[:, j] for j in group.outputs]
    return np.array([np.std(target) or 1.0 for target in targets])


def start_vector(
    plant: GrayBoxPlant,
    group: Group,
    units: np.ndarray,
    rng: np.random.Generator | None,
    crowded: Mapping[str, Box] = MappingProxyType({}),
) -> Float[np.ndarray, "unknowns"]:
    """One start. Without `rng` the parameters keep the values of the plant file."""
    parts = []
    parameters = {p.name: p for p in plant.spec.parameters}
    for name in group.networks:
        weights = spread_over(
            plant.networks[name], rng or np.random.default_rng(0), crowded.get(name)
        )
        parts += [weights[field].ravel() for field in WEIGHTS]
    for name, unit in zip(group.parameters, units, strict=True):
        p = parameters[name]
        value = scattered(p.value, p.min, p.max, rng) if rng else np.asarray(p.value)
        parts.append(np.atleast_1d(value / unit))
    return np.concatenate(parts)


def fit_group(
    plant: GrayBoxPlant,
    group: Group,
    training: Any,
    validation: Any,
    rngs: Sequence[np.random.Generator],
    options: Options | DescentOptions | None = None,
    *,
    algorithm: AlgorithmName = "lm",
    exogenous: Samples | None = None,
    crowded: Mapping[str, Box] = MappingProxyType({}),
    errors: Callable[[GrayBoxPlant, Group, Any], Array] = equation_errors,
) -> tuple[list[GrayBoxPlant], Solution]:
    """Fit one group from one start per generator; the first keeps the file's parameters. In every
    other one the networks' units stand where their arguments crowd (see `crowds`).

    `training` and `validation` are what `errors` takes: `Samples` in the filtered form. `options`
    are those of `algorithm` (None: its defaults). With `exogenous`, the part of the training
    samples that comes from outside the loop, every start goes on to two-stage least squares.
    Returns a plant per start (the same other groups in each), with `exogenous` those of two-stage
    least squares before the others, and the algorithm's own account of least squares.
    """
    minimise, defaults = ALGORITHMS[algorithm]
    units, (lower, upper) = units_of(plant, group), bounds_of(plant, group)
    weights = len(lower) - len(units)
    scales = target_scales(group, training)
    starts = []
    for k, rng in enumerate(rngs):
        start = start_vector(plant, group, units, rng, crowded if k % 2 else {})
        if k == 0 and group.parameters:
            start[weights:] = start_vector(plant, group, units, None)[weights:]
        starts.append(start)
    residual = EquationResidual(plant, jnp.asarray(scales), jnp.asarray(units), group, errors)
    given = (
        jax.tree.map(jnp.asarray, training),
        # a handful of constants does not overfit: they are taken at the minimum
        jax.tree.map(jnp.asarray, validation) if group.networks else None,
        jnp.asarray(lower),
        jnp.asarray(upper),
        options or defaults,
    )

    def fit(start: Float[np.ndarray, "unknowns"]) -> Solution:
        return jax.device_get(minimise(residual, jnp.asarray(start[None]), *given))

    solution = jax.tree.map(lambda *each: np.concatenate(each), *side_by_side(fit, starts))
    thetas = list(solution.theta)
    if exogenous is not None:
        refitted = [
            theta
            if status == FAILED
            else refit(residual, theta, training, exogenous, (lower, upper))
            for theta, status in zip(thetas, solution.status, strict=True)
        ]
        thetas = [*refitted, *thetas]
    fitted = [assemble(plant, group, theta, units) for theta in thetas]
    return [jax.tree.map(jnp.asarray, each) for each in fitted], solution
