"""The interface of a black-box model: a sampled system that is fed its own output or the plant's.

yhat(k) = step(carry, u(k), y(k-1)),   y(k-1) its own (free run) or measured (one step ahead)
"""

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

__all__ = ["Baseline", "Record", "Scaling", "Weights", "free_run", "one_step", "simulate"]

Weights = dict[str, Float[Array, "..."]]


class Record(NamedTuple):
    """One run at one rate, or several of one length (`runs` leading): inputs and outputs."""

    u: Float[Array | np.ndarray, "*runs samples inputs"]
    y: Float[Array | np.ndarray, "*runs samples outputs"]


class Scaling(eqx.Module):
    """Signals to [-1, 1] over the training record (mapminmax), and back."""

    u_center: Float[Array, "inputs"]
    u_scale: Float[Array, "inputs"]
    y_center: Float[Array, "outputs"]
    y_scale: Float[Array, "outputs"]

    @staticmethod
    def of(record: Record) -> "Scaling":
        found = []
        for x in record:
            x = jnp.asarray(x).reshape(-1, x.shape[-1])
            low, high = jnp.min(x, axis=0), jnp.max(x, axis=0)
            found += [(low + high) / 2, jnp.where(high > low, (high - low) / 2, 1.0)]
        return Scaling(*found)

    def u(self, u: Float[Array, "*any inputs"]) -> Float[Array, "*any inputs"]:
        return (u - self.u_center) / self.u_scale

    def y(self, y: Float[Array, "*any outputs"]) -> Float[Array, "*any outputs"]:
        return (y - self.y_center) / self.y_scale

    def back(self, y: Float[Array, "*any outputs"]) -> Float[Array, "*any outputs"]:
        return self.y_center + self.y_scale * y


class Baseline(eqx.Module):
    """`weights` is what training changes; signals inside are scaled by `scaling`."""

    weights: eqx.AbstractVar[Weights]
    scaling: eqx.AbstractVar[Scaling]

    @abstractmethod
    def begin(self, u: Float[Array, "inputs"], y: Float[Array, "outputs"]) -> Any:
        """The carry before a run whose first sample, scaled, is (u, y)."""

    @abstractmethod
    def step(
        self, carry: Any, u: Float[Array, "inputs"], y: Float[Array, "outputs"]
    ) -> tuple[Any, Float[Array, "outputs"]]:
        """(carry, yhat) from this sample's input and the output of the sample before, scaled."""


def simulate(model: Baseline, record: Record, *, measured: bool) -> Float[Array, "samples outputs"]:
    """yhat over one run in the record's units; of `record.y` a free run reads the first row."""
    u, y = model.scaling.u(jnp.asarray(record.u)), model.scaling.y(jnp.asarray(record.y))
    before = jnp.concatenate([y[:1], y[:-1]])

    def body(state: tuple[Any, Array], sample: tuple[Array, Array]) -> tuple[Any, Array]:
        carry, own = state
        now, measured_before = sample
        carry, yhat = model.step(carry, now, measured_before if measured else own)
        return (carry, yhat), yhat

    found = jax.lax.scan(body, (model.begin(u[0], y[0]), y[0]), (u, before))[1]
    return model.scaling.back(found)


@eqx.filter_jit
def free_run(model: Baseline, record: Record) -> Float[Array, "samples outputs"]:
    """The model beside the plant on its own: no output is fed to it after the first."""
    return simulate(model, record, measured=False)


@eqx.filter_jit
def one_step(model: Baseline, record: Record) -> Float[Array, "samples outputs"]:
    """The model one step ahead of measured outputs; on a faulty plant these are faulty too."""
    return simulate(model, record, measured=True)
