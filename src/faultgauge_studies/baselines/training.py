"""Training of black-box models by Levenberg-Marquardt, recurrent ones through time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from faultgauge.identification.optimise.levenberg_marquardt import Options, levenberg_marquardt
from faultgauge_studies.baselines.baseline import Baseline, Record, simulate

__all__ = ["Mode", "RunResidual", "Trained", "train", "with_weights"]

Model = TypeVar("Model", bound=Baseline)
Mode = Literal["parallel", "series_parallel"]  # fed its own output, or the plant's


@dataclass(frozen=True)
class Trained(Generic[Model]):
    """The `model` selected of all `models`, one per start, and the LM trials of all starts."""

    model: Model
    models: list[Model]
    trials: int

    @property
    def starts(self) -> int:
        return len(self.models)


class RunResidual(eqx.Module):
    """(yhat - y)/scale over one run, every sample and output an equation."""

    model: Baseline
    measured: bool = eqx.field(static=True)

    def __call__(
        self, theta: Float[Array, "parameters"], record: Record
    ) -> Float[Array, "equations"]:
        yhat = simulate(with_weights(self.model, theta), record, measured=self.measured)
        return ((yhat - record.y) / self.model.scaling.y_scale).reshape(-1)


def with_weights(model: Model, theta: Float[Array, "parameters"]) -> Model:
    _, unravel = ravel_pytree(model.weights)
    return eqx.tree_at(lambda m: m.weights, model, unravel(theta))


def train(
    models: Sequence[Model],
    training: Record,
    validation: Record,
    mode: Mode,
    options: Options,
    *,
    selection: Record | None = None,
) -> Trained[Model]:
    """From every one of `models`, which differ in their weights alone.

    Records have a leading axis of runs. `validation` stops each fit; the model of the lowest
    error on `selection` (by default `validation`) is chosen.
    """
    residual = RunResidual(models[0], mode == "series_parallel")
    starts = jnp.stack([ravel_pytree(model.weights)[0] for model in models])
    free = jnp.full(starts.shape[1], jnp.inf)
    training, validation = jax.tree.map(jnp.asarray, (training, validation))
    solution = levenberg_marquardt(residual, starts, training, validation, -free, free, options)
    costs = solution.validation_cost
    if selection is not None:
        costs = _costs(residual, solution.theta, jax.tree.map(jnp.asarray, selection))
    best = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
    found = [with_weights(models[0], theta) for theta in solution.theta]
    return Trained(found[best], found, int(solution.trials.sum()))


@eqx.filter_jit
def _costs(
    residual: RunResidual, theta: Float[Array, "starts parameters"], selection: Record
) -> Float[Array, "starts"]:
    over_runs = jax.vmap(residual, (None, 0))
    return jax.vmap(lambda each: jnp.sum(over_runs(each, selection) ** 2))(theta)
