"""What the networks learned, with the data behind it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.identification.fit import FitReport
from faultgauge.identification.samples import Samples
from faultgauge.plants.expression import Call, Expression, Name, evaluate, networks_used
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.reporting.model_figures import learned_curve
from faultgauge.reporting.svg import Figure

__all__ = ["behind", "curve", "network_figures"]

GRID = 200  # points of a curve


def network_figures(model: Model, account: FitReport) -> tuple[Figure, ...]:
    """One figure per argument of each network: the others stay at their median."""
    plant, samples = model.plant, account.training
    figures = []
    for expression, target, unit in _equations(plant, samples):
        for name, calls in networks_used(expression).items():
            points = _arguments(plant, samples, calls[0])
            data = behind(plant, samples, expression, target, name)
            for k, argument in enumerate(calls[0]):
                label, label_unit = _label(plant, argument, k)
                x = points[:, k]
                grid = np.linspace(x.min(), x.max(), GRID)
                middle = np.tile(np.median(points, axis=0), (GRID, 1))
                middle[:, k] = grid
                several = len(calls[0]) > 1
                bare = several or account.refinement is not None  # then dx is the model's own
                figures.append(
                    learned_curve(
                        grid,
                        curve(plant, name, middle),
                        x[:0] if bare else x,
                        x[:0] if bare else data,
                        x_name=label,
                        x_unit=label_unit,
                        y_name=f"{name}({label}{', others at their median' if several else ''})",
                        y_unit=unit,
                    )
                )
    return tuple(figures)


def curve(
    plant: GrayBoxPlant, network: str, points: Float[np.ndarray, "points arguments"]
) -> Float[np.ndarray, "points"]:
    """The network's value at each row of `points`."""
    return np.asarray(jax.vmap(lambda p: plant.networks[network](*p))(jnp.asarray(points)))


def behind(
    plant: GrayBoxPlant,
    samples: Samples,
    expression: Expression,
    target: Float[np.ndarray, "samples"],
    network: str,
) -> Float[np.ndarray, "samples"]:
    """What the data say the network's value is, where it enters its equation linearly.

    target = rest + gain * NN,   NN = (target - rest) / gain
    """

    def with_value(value: float) -> np.ndarray:
        others = {
            name: (lambda *p, name=name: curve(plant, name, np.stack(np.broadcast_arrays(*p), 1)))
            for name in plant.networks
        }
        constant = {**others, network: lambda *p: np.full(len(samples.x), value)}
        return np.asarray(
            evaluate(
                expression.tree,
                _values(plant, samples),
                np,
                derivatives=_rates(plant, samples),
                networks=constant,
            )
        )

    rest = with_value(0.0)
    gain = with_value(1.0) - rest
    return (target - rest) / np.where(gain == 0, np.nan, gain)


def _values(plant: GrayBoxPlant, samples: Samples) -> dict[str, np.ndarray]:
    signals = plant.signals
    values = {name: np.full(len(samples.x), float(v)) for name, v in plant.parameters.items()}
    values |= dict(zip(signals.state_names, samples.x.T, strict=True))
    return values | dict(zip(signals.input_names, samples.u.T, strict=True))


def _rates(plant: GrayBoxPlant, samples: Samples) -> dict[str, np.ndarray]:
    return dict(zip(plant.signals.state_names, samples.dx.T, strict=True))


def _arguments(
    plant: GrayBoxPlant, samples: Samples, arguments: tuple
) -> Float[np.ndarray, "samples arguments"]:
    networks = {
        name: (lambda *p, name=name: curve(plant, name, np.stack(np.broadcast_arrays(*p), 1)))
        for name in plant.networks
    }
    columns = [
        evaluate(
            argument,
            _values(plant, samples),
            np,
            derivatives=_rates(plant, samples),
            networks=networks,
        )
        for argument in arguments
    ]
    return np.stack(columns, axis=1)


def _equations(
    plant: GrayBoxPlant, samples: Samples
) -> list[tuple[Expression, Float[np.ndarray, "samples"], str]]:
    spec, signals = plant.spec, plant.signals
    found = [
        (expression, samples.dx[:, i], f"({state.unit})/s" if state.unit else "")
        for i, (expression, state) in enumerate(zip(spec.derivatives, signals.states, strict=True))
    ]
    found += [
        (expression, samples.y[:, j], output.unit)
        for j, (expression, output) in enumerate(zip(spec.values, signals.outputs, strict=True))
        if np.isfinite(samples.y[:, j]).all()
    ]
    return found


def _label(plant: GrayBoxPlant, argument: object, k: int) -> tuple[str, str]:
    units = {s.name: s.unit for s in (*plant.signals.states, *plant.signals.inputs)}
    if isinstance(argument, Name):
        return argument.name, units.get(argument.name, "")
    if isinstance(argument, Call) and isinstance(argument.arguments[0], Name):
        inner = argument.arguments[0].name
        return f"{argument.function}({inner})", f"({units.get(inner, '')})/s"
    return f"argument {k + 1}", ""
