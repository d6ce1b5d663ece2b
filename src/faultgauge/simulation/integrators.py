"""Fixed-step Runge-Kutta under the input's hold."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.plants.plant import Plant, Stuck, clip_state, respond

__all__ = ["step"]


def step(
    plant: Plant,
    x: Float[Array, "states"],
    u: Float[Array, "inputs"],
    u_next: Float[Array, "inputs"],
    f: Float[Array, "faults"],
    dt: Float[Array, ""],
    substeps: int,
    stuck: Stuck | None = None,
) -> Float[Array, "states"]:
    """State after `dt` seconds by `substeps` classical RK4 steps with faults `f` and `stuck`.

    Between the samples an input stays at `u` (hold "zero") or runs straight to `u_next`
    (hold "linear"): never the next sample's value under a zero-order hold.
    """
    linear = jnp.array([each.hold == "linear" for each in plant.signals.inputs], bool)
    slope = jnp.where(linear, u_next - u, 0.0)
    h = dt / substeps

    def rate(x: Float[Array, "states"], s: Float[Array, ""]) -> Float[Array, "states"]:
        return respond(plant, x, u + s * slope, f, stuck)[0]

    def substep(x: Float[Array, "states"], k: Array) -> tuple[Float[Array, "states"], None]:
        s0, s1, s2 = (k + 0.0) / substeps, (k + 0.5) / substeps, (k + 1.0) / substeps
        k1 = rate(x, s0)
        k2 = rate(x + h / 2 * k1, s1)
        k3 = rate(x + h / 2 * k2, s1)
        k4 = rate(x + h * k3, s2)
        return clip_state(plant, x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)), None

    if substeps == 1:
        return substep(x, jnp.zeros(()))[0]
    return jax.lax.scan(substep, x, jnp.arange(substeps, dtype=float))[0]
