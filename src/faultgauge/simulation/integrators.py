"""Fixed-step Runge-Kutta under the input's hold."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.plants.plant import Plant, Stuck, clip_state, respond
from faultgauge.simulation.intersample import line

__all__ = ["sensitive_step", "step", "step_through"]

Stage = tuple[Array, Array]  # the inputs, and what is added to the rates


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
    (other holds): never the next sample's value under a zero-order hold.
    """
    stages = line(plant.signals, u, u_next, substeps)
    return step_through(plant, x, stages, f, dt, substeps, stuck)


def step_through(
    plant: Plant,
    x: Float[Array, "states"],
    stages: Float[Array, "stages inputs"],
    f: Float[Array, "faults"],
    dt: Float[Array, ""],
    substeps: int,
    stuck: Stuck | None = None,
    forces: Float[Array, "stages states"] | None = None,
) -> Float[Array, "states"]:
    """`step` with the inputs at every half substep given (see `intersample`), and what is added to
    the states' rates there."""
    h = dt / substeps
    added = jnp.zeros((len(stages), len(x))) if forces is None else forces

    def rate(x: Float[Array, "states"], at: Stage) -> Float[Array, "states"]:
        u, force = at
        return respond(plant, x, u, f, stuck)[0] + force

    def substep(
        x: Float[Array, "states"], at: tuple[Stage, Stage, Stage]
    ) -> tuple[Float[Array, "states"], None]:
        first, middle, last = at
        k1 = rate(x, first)
        k2 = rate(x + h / 2 * k1, middle)
        k3 = rate(x + h / 2 * k2, middle)
        k4 = rate(x + h * k3, last)
        return clip_state(plant, x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)), None

    def every(part: slice | int) -> Stage:
        return stages[part], added[part]

    if substeps == 1:
        return substep(x, (every(0), every(1), every(2)))[0]
    parts = every(slice(None, -1, 2)), every(slice(1, None, 2)), every(slice(2, None, 2))
    return jax.lax.scan(substep, x, parts)[0]


Sensitive = tuple[Float[Array, "states"], Float[Array, "states unknowns"]]


def sensitive_step(
    plant: Plant,
    flow: Callable[[Array, Array, Array], Sensitive],
    start: Sensitive,
    stages: Float[Array, "stages inputs"],
    dt: Float[Array, ""],
    substeps: int,
) -> Sensitive:
    """`step_through` for a state and its sensitivities S; `flow(x, S, u)` gives both their rates.

    Runge-Kutta on (x, S) is the derivative of Runge-Kutta on x; a state at its limit has none.
    """
    h = dt / substeps

    def substep(at: Sensitive, u: tuple[Array, Array, Array]) -> tuple[Sensitive, None]:
        def moved(share: float | Array, rates: Sensitive) -> Sensitive:
            return at[0] + share * rates[0], at[1] + share * rates[1]

        u0, u1, u2 = u
        k1 = flow(*at, u0)
        k2 = flow(*moved(h / 2, k1), u1)
        k3 = flow(*moved(h / 2, k2), u1)
        k4 = flow(*moved(h, k3), u2)
        dx, dS = (a + 2 * b + 2 * c + d for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
        x, S = moved(h / 6, (dx, dS))
        x, kept = jax.jvp(lambda x: clip_state(plant, x), (x,), (jnp.ones_like(x),))
        return (x, kept[:, None] * S), None

    if substeps == 1:
        return substep(start, (stages[0], stages[1], stages[2]))[0]
    return jax.lax.scan(substep, start, (stages[:-1:2], stages[1::2], stages[2::2]))[0]
