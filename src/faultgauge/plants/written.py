"""A `Plant` that is written in Python, as everything downstream takes one: which equation reads
what, and its constants as leaves.

Nothing else can be seen of code but what it makes of numbers. It is tried at a few points: an
equation reads what changes its value, alone or by being no number. A switch that no point throws
is not seen.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from faultgauge.errors import InputError
from faultgauge.plants.expression import Call, Expression, Name, Opaque
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant, ValueChange
from faultgauge.plants.plant_file import is_reserved
from faultgauge.plants.signals import INNER, Signals
from faultgauge.plants.spec import Parameter, PlantSpec

__all__ = ["WrittenPlant", "written"]

POINTS = 16  # at which a plant is tried
AROUND = 2.0  # in every direction from 0, or from a constant's value in units of it
SEED = 0  # of the points: the same plant is seen alike


class WrittenPlant(GrayBoxPlant):
    """The equations of `base`, with the constants in `parameters`."""

    base: Plant

    @property
    def _filled(self) -> Plant:
        return self.base.with_constants(self.parameters)

    def derivative(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "states"]:
        return self._filled.derivative(x, u)

    @property
    def chained(self) -> bool:
        return self._filled.chained

    def moved(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        beside: Float[Array | np.ndarray, "states"],
    ) -> Float[Array, "states"]:
        return self._filled.moved(x, u, beside)

    def output(
        self,
        dx: Float[Array, "states"],
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
    ) -> Float[Array, "outputs"]:
        own = self._filled.output(dx, x, u)
        more = range(len(own), len(self.spec.values))  # sensors that are thought of
        return jnp.concatenate(
            [own, *(jnp.atleast_1d(each) for each in self._said(x, u, dx, more))]
        )

    def _said(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        dx: Float[Array, "states"],
        outputs: Sequence[int],
    ) -> list[Array]:
        """Outputs that are no code."""
        return super().equations(x, u, dx, (), outputs)

    def besides(self, x: Float[Array, "states"]) -> Float[Array, "outputs"]:
        own = self._filled.besides(x)
        return jnp.concatenate([own, jnp.zeros(len(self.spec.values) - len(own))])

    def equations(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        dx: Float[Array, "states"] | None,
        states: Sequence[int],
        outputs: Sequence[int] = (),
    ) -> list[Array]:
        found = self.derivative(x, u)
        shown = [] if dx is None else self.output(dx, x, u)
        return [*(found[i] for i in states), *(shown[j] for j in outputs)]

    def altered(self, changes: Mapping[str, ValueChange]) -> "WrittenPlant":
        inner = {n: c for n, c in changes.items() if n in self.parameters}
        values = {n: c.of(self.parameters[n]) for n, c in inner.items()}
        rest = {n: c for n, c in changes.items() if n not in inner}
        base = self.base.altered(rest) if rest else self.base
        return replace(self, base=base, parameters={**self.parameters, **values})


def written(plant: Plant) -> WrittenPlant:
    """`plant`, for all that takes a plant file's.

    Raises `InputError` where its signals, constants or equations do not fit together.
    """
    name = type(plant).__name__
    constants = _constants(plant, name)
    signals = plant.signals
    _check_names(name, signals, constants)
    _check_sizes(name, plant)
    states, outputs = _seen(plant, constants)
    measures = [e.tree.name if isinstance(e.tree, Name) else None for e in outputs]
    signals = replace(
        signals,
        outputs=tuple(
            replace(each, measures=each.measures or found)
            for each, found in zip(signals.outputs, measures, strict=True)
        ),
    )
    spec = PlantSpec(name, "", signals, states, outputs, constants, (), tuple(range(len(states))))
    values = {each.name: jnp.asarray(each.value, float) for each in constants}
    return WrittenPlant(signals, spec, {}, values, plant)


def _constants(plant: Plant, name: str) -> tuple[Parameter, ...]:
    """What the plant declares, at the values of its fields."""
    lacking = [each.name for each in plant.constants if not hasattr(plant, each.name)]
    if lacking:
        raise InputError(
            f"{name}: its constants {', '.join(lacking)} are no fields of the class; add fields "
            "of these names, which its equations read."
        )
    return tuple(replace(p, value=float(getattr(plant, p.name))) for p in plant.constants)


def _check_names(name: str, signals: Signals, constants: Sequence[Parameter]) -> None:
    owned = [*signals.state_names, *signals.input_names, *(each.name for each in constants)]
    doubled = [each for k, each in enumerate(owned) if each in owned[:k] or is_reserved(each)]
    if doubled:
        raise InputError(
            f"{name}: the name {doubled[0]!r} stands for two things; give states, inputs and "
            "constants names of their own, other than d, t, run and the functions of plant files."
        )
    places = {"state": signals.state_names, "input": signals.input_names}
    places |= {"output": signals.output_names, "gain": signals.input_names}
    places |= {"output_gain": signals.output_names}
    for fault in signals.faults:
        if fault.enters not in INNER and fault.target not in places[fault.enters]:
            raise InputError(
                f"{name}: fault {fault.name!r} enters {fault.target!r}, which is none of "
                f"{', '.join(places[fault.enters])}."
            )


def _check_sizes(name: str, plant: Plant) -> None:
    """One derivative per state and one value per output, whatever the numbers."""
    signals = plant.signals
    x, u = jnp.zeros(len(signals.states)), jnp.zeros(len(signals.inputs))
    for what, found, wanted in (
        ("derivative", jax.eval_shape(plant.derivative, x, u), x.shape),
        ("output", jax.eval_shape(plant.output, x, x, u), (len(signals.outputs),)),
    ):
        if found.shape != wanted:
            raise InputError(
                f"{name}: `{what}` gives an array of shape {found.shape}, not {wanted}; give one "
                f"number for every {'state' if what == 'derivative' else 'output'} that "
                "`signals` names."
            )


def _seen(
    plant: Plant, constants: Sequence[Parameter]
) -> tuple[tuple[Expression, ...], tuple[Expression, ...]]:
    """What every derivative and every output reads."""
    signals = plant.signals
    names = [each.name for each in constants]
    inner = [f.target for f in signals.faults if f.enters in INNER and f.target not in names]
    count, width = len(signals.states), len(signals.states) + len(signals.inputs)
    places = [*map(Name, (*signals.state_names, *signals.input_names, *names))]
    rates = [Call("d", (Name(each),)) for each in signals.state_names]

    def filled(z: Array) -> Plant:
        return plant.with_constants(dict(zip(names, z[width : width + len(names)], strict=True)))

    def derivative(z: Array) -> Array:
        return filled(z).derivative(z[:count], z[count:width])

    def output(z: Array) -> Array:
        return filled(z).output(z[width + len(names) :], z[:count], z[count:width])

    points = _points(signals, constants)
    told = tuple(Name(each) for each in inner)  # where a fault enters, nobody can see
    return (
        _expressions(signals.state_names, derivative, points[:, : len(places)], places, told),
        _expressions(signals.output_names, output, points, [*places, *rates], told),
    )


def _points(
    signals: Signals, constants: Sequence[Parameter]
) -> Float[np.ndarray, "points channels"]:
    """Inside the limits that are declared, of states, inputs, constants and the states' rates."""
    rng = np.random.default_rng(SEED)
    columns = [
        rng.uniform(*_ends(*(each.trusted or (each.min, each.max))), POINTS)
        for each in (*signals.states, *signals.inputs)
    ]
    for each in constants:
        near = each.value + rng.uniform(-1, 1, POINTS) * (abs(each.value) or 1.0) / AROUND
        columns.append(np.clip(near, each.min, each.max))
    columns += [rng.uniform(-AROUND, AROUND, POINTS) for _ in signals.states]
    return np.stack(columns, axis=1)


def _ends(low: float, high: float) -> tuple[float, float]:
    """An interval inside [low, high]: all of it, next to its one end, or around 0."""
    if np.isfinite(high - low):
        return low, high
    if np.isfinite(low):
        return low, low + AROUND * max(1.0, abs(low))
    if np.isfinite(high):
        return high - AROUND * max(1.0, abs(high)), high
    return -AROUND, AROUND


def _expressions(
    owners: Sequence[str],
    function: Callable[[Array], Array],
    points: Float[np.ndarray, "points channels"],
    places: Sequence[Any],
    told: tuple[Name, ...],
) -> tuple[Expression, ...]:
    at = eqx.filter_jit(jax.vmap(function))
    values = np.asarray(at(jnp.asarray(points)))
    reads = np.stack([_differs(at, values, points, k) for k in range(points.shape[1])], axis=1)
    found = []
    for j, owner in enumerate(owners):
        own = [places[k] for k in np.flatnonzero(reads[j]).tolist()]
        tree = Opaque((*own, *told))
        if len(own) == 1 and np.array_equal(values[:, j], points[:, reads[j]][:, 0]) and not told:
            tree = own[0]  # the state itself: kinematics, or what measures it
        found.append(Expression(f"{owner}, in Python", tree))
    return tuple(found)


def _differs(
    at: Callable[[Array], Array],
    values: Float[np.ndarray, "points values"],
    points: Float[np.ndarray, "points channels"],
    k: int,
) -> Bool[np.ndarray, "values"]:
    """Which values read the k-th channel: those that are other numbers where it has the value of
    another point, or none where it is none."""
    found = np.zeros(values.shape[1], bool)
    for other in (np.roll(points[:, k], 1), np.full(len(points), np.nan)):
        moved = points.copy()
        moved[:, k] = other
        again = np.asarray(at(jnp.asarray(moved)))
        found |= np.any((again != values) & ~(np.isnan(again) & np.isnan(values)), axis=0)
    return found
