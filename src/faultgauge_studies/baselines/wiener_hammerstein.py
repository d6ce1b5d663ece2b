"""Wiener-Hammerstein: linear, static network, linear, started from the best linear approximation.

    z_i = G1_i(q) u_i,   w = l'z + V tanh(W z + b) + c,   y = G2(q) w

J. Schoukens et al., "Wiener-Hammerstein benchmark", SYSID 2009; starts by splitting the poles and
zeros of the best linear approximation: L. Lauwers et al., SYSID 2009.
"""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.signal import lfilter

from faultgauge_studies.baselines.baseline import Baseline, Record, Scaling, Weights
from faultgauge_studies.baselines.static_network import layers

__all__ = ["WienerHammerstein", "best_linear_approximation", "wiener_hammerstein"]

REFINEMENTS = 20
SMALL = 0.05  # the static network starts as a line that this bends
INSIDE = 0.999  # poles of a start: those of an integrator are drawn in, or its run would drift


class Filters(NamedTuple):
    """States of the linear blocks."""

    first: Float[Array, "inputs order"]
    last: Float[Array, "order"]


def _filter(
    b: Float[Array, "taps"], a: Float[Array, "order"], state: Float[Array, "order"], x: Array
) -> tuple[Float[Array, "order"], Array]:
    """Direct form II transposed: y = b_0 x + s_1, s_i = s_(i+1) + b_i x - a_i y."""
    y = b[0] * x + state[0]
    return jnp.append(state[1:], 0.0) + b[1:] * x - a * y, y


def _rest(
    b: Float[Array, "taps"], a: Float[Array, "order"], x: Array
) -> tuple[Float[Array, "order"], Array]:
    """State and output after x has always stood: y = b(1)/a(1) x, s_i = sum_j>=i b_j x - a_j y."""
    y = jnp.sum(b) / (1 + jnp.sum(a)) * x
    return jnp.cumsum((b[1:] * x - a * y)[::-1])[::-1], y


class WienerHammerstein(Baseline):
    """One linear block per input, one static network of all, one linear block.

    A run starts from rest: an input that is a `level` (a measured state) has stood at its first
    value, a command at 0.
    """

    weights: Weights
    scaling: Scaling
    level: tuple[bool, ...] = eqx.field(static=True)

    def begin(self, u: Float[Array, "inputs"], y: Float[Array, "1"]) -> Filters:
        w, s = self.weights, self.scaling
        stood = jnp.where(jnp.array(self.level), u, -s.u_center / s.u_scale)
        first, z = jax.vmap(_rest)(w["b_first"], w["a_first"], stood)
        return Filters(first, _rest(w["b"], w["a"], self._static(z))[0])

    def step(
        self, carry: Filters, u: Float[Array, "inputs"], y: Float[Array, "1"]
    ) -> tuple[Filters, Float[Array, "1"]]:
        w = self.weights
        first, z = jax.vmap(_filter)(w["b_first"], w["a_first"], carry.first, u)
        last, found = _filter(w["b"], w["a"], carry.last, self._static(z))
        return Filters(first, last), found[None]

    def _static(self, z: Float[Array, "inputs"]) -> Float[Array, ""]:
        w = self.weights
        hidden = jnp.tanh(w["weights_in"] @ z + w["bias"])
        return w["line"] @ z + w["weights_out"] @ hidden + w["bias_out"]


def best_linear_approximation(
    u: Float[np.ndarray, "samples inputs"], y: Float[np.ndarray, "samples"], order: int
) -> tuple[Float[np.ndarray, "inputs taps"], Float[np.ndarray, "order"]]:
    """(b, a) of A(q) y = sum_i B_i(q) u_i with one denominator, a without its leading 1.

    K. Steiglitz and L. E. McBride, "A technique for the identification of linear systems", IEEE
    Trans. Automatic Control 10, 1965.
    """
    a, found = np.zeros(order), (np.zeros((u.shape[1], order + 1)), np.zeros(order))
    lowest = np.inf
    for _ in range(REFINEMENTS):
        whitened = np.concatenate([[1.0], a])
        fu, fy = _filtered([1.0], whitened, u), _filtered([1.0], whitened, y)
        columns = [-_delayed(fy, k) for k in range(1, order + 1)]
        columns += [_delayed(x, k) for x in fu.T for k in range(order + 1)]
        theta = np.linalg.lstsq(np.stack(columns, axis=1), fy, rcond=None)[0]
        a, b = _stable(theta[:order]), theta[order:].reshape(u.shape[1], order + 1)
        denominator = np.concatenate([[1.0], a])
        parts = [_filtered(bi, denominator, x) for bi, x in zip(b, u.T, strict=True)]
        cost = float(np.mean((y - np.sum(parts, axis=0)) ** 2))
        if cost < lowest:
            lowest, found = cost, (b, a)
    return found


def _filtered(
    b: Sequence[float] | np.ndarray, a: np.ndarray, x: Float[np.ndarray, "samples *signals"]
) -> Float[np.ndarray, "samples *signals"]:
    return np.asarray(lfilter(b, a, x, axis=0))


def _delayed(x: Float[np.ndarray, "samples"], k: int) -> Float[np.ndarray, "samples"]:
    return np.concatenate([np.zeros(k), x[: len(x) - k]])


def _stable(a: Float[np.ndarray, "order"]) -> Float[np.ndarray, "order"]:
    """The denominator with poles outside drawn in to 0.999."""
    poles = np.roots(np.concatenate([[1.0], a])).astype(complex)
    size = np.abs(poles)
    poles = np.where(size > INSIDE, poles / np.maximum(size, 1e-12) * INSIDE, poles)
    return np.real(np.poly(poles))[1:]


def wiener_hammerstein(
    scaling: Scaling,
    record: Record,
    hidden: int,
    order: int,
    level: Sequence[bool],
    rngs: Sequence[np.random.Generator],
) -> list[WienerHammerstein]:
    """One start per generator: the splits of the linear approximation's poles and zeros in turn.

    `record` is one run (samples, signals).
    """
    u = np.asarray(scaling.u(jnp.asarray(record.u)))
    level = tuple(level)
    y = np.asarray(scaling.y(jnp.asarray(record.y)))[:, 0]
    # without their means, or an offset would bend the poles; training finds the constant
    b, a = best_linear_approximation(u - u.mean(axis=0), y - y.mean(), order)
    splits = list(product((True, False), repeat=order))
    return [
        _start(scaling, b, a, np.array(splits[k % len(splits)]), u, hidden, level, rng)
        for k, rng in enumerate(rngs)
    ]


def _start(
    scaling: Scaling,
    b: Float[np.ndarray, "inputs taps"],
    a: Float[np.ndarray, "order"],
    first: np.ndarray,
    u: Float[np.ndarray, "samples inputs"],
    hidden: int,
    level: tuple[bool, ...],
    rng: np.random.Generator,
) -> WienerHammerstein:
    """The k-th pole goes to the first blocks where `first[k]`; so does the k-th zero of one input.

    With several inputs the numerators differ, and all of them stand in the first blocks.
    """
    order, inputs = len(a), len(b)
    poles = np.sort_complex(np.roots(np.concatenate([[1.0], a])))
    if np.any(np.abs(np.imag(poles)) > 1e-9):  # a conjugate pair is not torn apart
        first = np.full(order, bool(first[0]))
    a_first, a_last = (_padded(np.poly(poles[chosen]), order) for chosen in (first, ~first))
    zeros = np.sort_complex(np.roots(b[0]))
    if inputs == 1 and len(zeros) == order and np.all(np.abs(np.imag(zeros)) < 1e-9):
        b_first = b[0, 0] * _padded(np.poly(zeros[first]), order)[None]
        b_last = _padded(np.poly(zeros[~first]), order)
    else:
        b_first, b_last = b, np.eye(order + 1)[0]
    z = np.stack([_filtered(bi, a_first, x) for bi, x in zip(b_first, u.T, strict=True)])
    spread = np.maximum(2 * z.std(axis=1), 1e-9)  # the network's arguments about [-1, 1]
    net = layers(hidden, inputs, rng)
    net["weights_out"] = SMALL * net["weights_out"]
    weights = net | {
        "line": jnp.asarray(spread),
        "b_first": jnp.asarray(b_first / spread[:, None]),
        "a_first": jnp.asarray(np.tile(a_first[1:], (inputs, 1))),
        "b": jnp.asarray(b_last),
        "a": jnp.asarray(a_last[1:]),
    }
    return WienerHammerstein(weights, scaling, level)


def _padded(polynomial: np.ndarray | float, order: int) -> Float[np.ndarray, "taps"]:
    real = np.real(np.atleast_1d(polynomial))
    return np.concatenate([real, np.zeros(order + 1 - len(real))])
