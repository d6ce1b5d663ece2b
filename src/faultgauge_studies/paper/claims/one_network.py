"""The alternative to separate networks: one hidden layer of which dh and T are two outputs."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.optimise.levenberg_marquardt import (
    FAILED,
    Solution,
    levenberg_marquardt,
)
from faultgauge.identification.optimise.starts import nguyen_widrow
from faultgauge.plants.plant import Plant
from faultgauge.plants.signals import Signals
from faultgauge.telemetry import Run
from faultgauge_studies.paper.claims.learned import replay
from faultgauge_studies.paper.excited import Records

__all__ = ["OneNetwork", "teach_one"]


class Points(NamedTuple):
    """Samples of a record: (h, u), and what is to come out there, (dh, T)."""

    p: Float[Array | np.ndarray, "*samples 2"]
    targets: Float[Array | np.ndarray, "*samples 2"]


class OneNetwork(Plant):
    """[dh, T] = scale (W1 tanh(W2 p_s + theta) + theta_out), p_s = (h, u) on [-1, 1]; hm = h.

    The scalings and the edges are those of `plants.network.Network`.
    """

    signals: Signals = eqx.field(static=True)
    center: Float[Array, "2"]
    half: Float[Array, "2"]
    scale: Float[Array, "2"]
    theta: Float[Array, "weights"]

    def both(self, p: Float[Array, "2"]) -> Float[Array, "2"]:
        """(dh, T) at p = (h, u)."""
        hidden = (self.theta.size - 2) // 5
        inward, bias, outward = jnp.split(self.theta[:-2], [2 * hidden, 3 * hidden])
        scaled = jnp.clip((p - self.center) / self.half, -1.0, 1.0)
        layer = jnp.tanh(inward.reshape(hidden, 2) @ scaled + bias)
        return self.scale * (outward.reshape(2, hidden) @ layer + self.theta[-2:])

    def derivative(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "states"]:
        return self.both(jnp.concatenate([x, u]))[:1]

    def output(
        self, dx: Float[Array, "states"], x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "outputs"]:
        return jnp.concatenate([self.both(jnp.concatenate([x, u]))[1:], x])


class Residual(eqx.Module):
    """Both errors at one sample, each over its target's spread, as `fit` weighs them."""

    plant: OneNetwork
    spread: Float[Array, "2"]

    def __call__(self, theta: Float[Array, "weights"], sample: Points) -> Float[Array, "2"]:
        return (_with(self.plant, theta).both(jnp.asarray(sample.p)) - sample.targets) / self.spread


def teach_one(
    signals: Signals, hidden: int, given: Records, seed: int, restarts: int
) -> tuple[OneNetwork, Solution]:
    """Levenberg-Marquardt with `fit`'s stop; of the starts, the best free run on validation."""
    training, validation = _points(given.training), _points(given.validation)
    low, high = training.p.min(axis=0), training.p.max(axis=0)
    spread = jnp.asarray(training.targets.std(axis=0))
    plant = OneNetwork(
        signals,
        jnp.asarray((low + high) / 2),
        jnp.asarray((high - low) / 2),
        jnp.asarray(np.ptp(training.targets, axis=0) / 2),
        jnp.zeros(5 * hidden + 2),
    )
    starts = np.stack([_start(hidden, np.random.default_rng([seed, k])) for k in range(restarts)])
    free = jnp.full(starts.shape[1], jnp.inf)
    solution = jax.device_get(
        levenberg_marquardt(
            Residual(plant, spread),
            jnp.asarray(starts),
            jax.tree.map(jnp.asarray, training),
            jax.tree.map(jnp.asarray, validation),
            -free,
            free,
        )
    )
    candidates = [_with(plant, jnp.asarray(theta)) for theta in solution.theta]
    errors = [_free_run_error(each, given.validation) for each in candidates]
    errors = np.where(solution.status == FAILED, np.inf, np.nan_to_num(errors, nan=np.inf))
    return candidates[int(np.argmin(errors))], solution


def _with(plant: OneNetwork, theta: Float[Array, "weights"]) -> OneNetwork:
    return eqx.tree_at(lambda p: p.theta, plant, theta)


def _points(log: Run) -> Points:
    c = log.columns
    return Points(np.stack([c["hm"], c["u"]], axis=1), np.stack([c["d_h"], c["T"]], axis=1))


def _start(hidden: int, rng: np.random.Generator) -> Float[np.ndarray, "weights"]:
    weights = nguyen_widrow(hidden, 2, rng)
    outward = 0.5 * rng.uniform(-1, 1, 2 * hidden)
    return np.concatenate([weights["weights_in"].ravel(), weights["bias"], outward, np.zeros(2)])


def _free_run_error(plant: Plant, log: Run) -> float:
    """Torque and momentum, each over its spread, as `fit` selects."""
    free = replay(plant, log)
    measured: Sequence[np.ndarray] = (log.columns["T"], log.columns["hm"])
    parts = [np.mean((free.y[:, k] - y) ** 2) / np.var(y) for k, y in enumerate(measured)]
    return float(np.sqrt(np.mean(parts)))
