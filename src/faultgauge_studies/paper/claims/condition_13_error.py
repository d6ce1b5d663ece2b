"""The error of a sampled observer over an integrator, which condition (13) speaks of.

With the innovation eps = hhat - h [N*m*s] before a sample is used and phi = fhat - d [N*m], every
sampled form of (14) is

    eps <- eps + T phi - l eps - m g(eps),   phi <- phi - k g(eps),   g = delta^(1-kappa) fal,

in which beta_1 = 2 zeta omega_o and beta_2 = omega_o^2 delta^(1-kappa), so (13) is zeta > 1.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from faultgauge.observers.eso import fal
from faultgauge.observers.gains import ackermann, bandwidth_poles
from faultgauge.simulation.satellite.observatory import PERIOD
from faultgauge_studies.paper.estimating import BAND

__all__ = ["FORMS", "Response", "condition_13", "injection", "responses"]

FORMS = {
    "euler": "forward Euler",
    "held": "innovation held",
    "placed": "poles placed in discrete time",
}
# The slowest cell of the study's grid leaves less than 1e-8 of a jump after 1500 s; 1e-3 in the
# last 50 s is then no slow decay but an oscillation or growth.
SAMPLES, TAIL, LEFT = 6000, 200, 1e-3
FAR = 1e6  # where a diverging error is stopped


class Response(NamedTuple):
    """After a jump: settling to 5 % [s] (inf: does not converge), overshoot and what is left, as
    shares of the jump."""

    settling: Float[np.ndarray, "*cells"]
    overshoot: Float[np.ndarray, "*cells"]
    left: Float[np.ndarray, "*cells"]

    @property
    def converges(self) -> Bool[np.ndarray, "*cells"]:
        return self.left <= LEFT


def condition_13(
    omega: Float[np.ndarray, "*cells"],
    zeta: Float[np.ndarray, "*cells"],
    kappa: float,
    delta: Float[np.ndarray, "*cells"],
) -> Bool[np.ndarray, "*cells"]:
    """Eq (13) of the gains that the paper's form has at bandwidth `omega` [rad/s]."""
    beta_1, beta_2 = 2 * zeta * omega, omega**2 * delta ** (1 - kappa)
    return beta_1**2 > 4 * beta_2 * delta ** (kappa - 1)


def injection(form: str, omega: float, zeta: float) -> tuple[float, float, float]:
    """(l, m, k) [1, 1, 1/s] of a form at bandwidth `omega` [rad/s].

    "euler" moves both states by T times their rates; "held" integrates (14) between samples with
    the innovation that the last one left; "placed" is the product's own.
    """
    if form == "placed":
        A, C = np.array([[1.0, PERIOD], [0.0, 1.0]]), np.array([1.0, 0.0])
        L = ackermann(A, C @ A, bandwidth_poles(2, omega, zeta, PERIOD))
        return float(L[0]), float(PERIOD * L[1]), float(L[1])
    within = 0.5 * (omega * PERIOD) ** 2 if form == "held" else 0.0
    return 2 * zeta * omega * PERIOD, within, omega**2 * PERIOD


def responses(
    form: str,
    omega: Float[np.ndarray, "*cells"],
    zeta: Float[np.ndarray, "*cells"],
    kappa: float,
    delta: Float[np.ndarray, "*cells"],
    jump: Float[np.ndarray, "*cells"],
) -> Response:
    """The error after a `jump` [N*m] at a sample, from none, in every cell."""
    gains = [
        injection(form, float(w), float(z)) for w, z in zip(omega.flat, zeta.flat, strict=True)
    ]
    cells = (*np.array(gains).T, delta.ravel(), jump.ravel())
    last, over, left = (np.asarray(x) for x in _run(*map(jnp.asarray, cells), kappa=kappa))
    # a current observer has used the sample that it answers to; the others answer one later
    settling = PERIOD * (last + (0.0 if form == "placed" else 1.0))
    settling = np.where(left <= LEFT, settling, np.inf)
    return Response(*(x.reshape(omega.shape) for x in (settling, over, left)))


@partial(jax.jit, static_argnames="kappa")
def _run(
    l: Float[Array, "cells"],  # noqa: E741
    m: Float[Array, "cells"],
    k: Float[Array, "cells"],
    delta: Float[Array, "cells"],
    jump: Float[Array, "cells"],
    kappa: float,
) -> tuple[Float[Array, "cells"], ...]:
    """(samples up to the last outside 5 %, overshoot, the most of the last 50 s)."""

    def one(l: Array, m: Array, k: Array, delta: Array, jump: Array) -> tuple[Array, ...]:  # noqa: E741
        def body(state: tuple[Array, ...], n: Array) -> tuple[tuple[Array, ...], None]:
            eps, phi, last, over, left = state
            g = delta ** (1 - kappa) * fal(eps, kappa, delta)
            eps = jnp.clip(eps + PERIOD * phi - l * eps - m * g, -FAR, FAR)
            phi = jnp.clip(phi - k * g, -FAR, FAR)
            off = phi / jump
            last = jnp.where(jnp.abs(off) > BAND, n + 1, last)
            left = jnp.where(n >= SAMPLES - TAIL, jnp.maximum(left, jnp.abs(off)), left)
            return (eps, phi, last, jnp.maximum(over, off), left), None

        zero = jnp.zeros(())
        steps = jnp.arange(SAMPLES, dtype=float)
        return jax.lax.scan(body, (zero, -jump, zero, zero, zero), steps)[0][2:]

    return jax.vmap(one)(l, m, k, delta, jump)
