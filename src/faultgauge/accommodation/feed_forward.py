"""The command that makes a faulty plant do what a healthy one would have done."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.plant import Plant, respond

__all__ = ["FeedForward", "Limits", "limited", "outcome"]

EDGE = 1e-6  # of an input's range: at its very limit a command has half a slope


class Limits(NamedTuple):
    """What a compensation may take: `authority` (input unit) either way, `slew` (input unit per
    second)."""

    authority: Float[Array, "inputs"]
    slew: Float[Array, "inputs"]


class FeedForward(eqx.Module):
    """c with which the plant under `u + c` and faults f does what `desired` does under `u`:

        g = F(x, u, f) - F_desired(x, u)
        c = -(G B)^+ G g,   B = dF/du under f

    with `outcome` G (see there), so that what counts is where the regulated states end up. On an
    integrator c = -B^+ g: the negative of the fault. A gain loss is divided out, u / (1 - f), and
    counted as `1 - floor` where it is more.
    """

    plant: Plant
    desired: Plant
    outcome: Float[Array, "regulated states"]
    floor: float

    def command(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        f: Float[Array, "faults"],
    ) -> Float[Array, "inputs"]:
        """c (input unit) at state `x` for the wanted `u`."""
        f, u = self._floored(f), self._inside(u)
        healthy = jnp.zeros(len(self.desired.signals.faults))
        g = respond(self.plant, x, u, f)[0] - respond(self.desired, x, u, healthy)[0]
        B = jax.jacfwd(lambda u: respond(self.plant, x, u, f)[0])(u)
        return -jnp.linalg.pinv(self.outcome @ B) @ (self.outcome @ g)

    def _floored(self, f: Float[Array, "faults"]) -> Float[Array, "faults"]:
        gain = jnp.array([each.enters == "gain" for each in self.plant.signals.faults])
        return jnp.where(gain, jnp.minimum(f, 1.0 - self.floor), f)

    def _inside(self, u: Float[Array, "inputs"]) -> Float[Array, "inputs"]:
        inputs = self.plant.signals.inputs
        lower = jnp.array([each.min for each in inputs])
        upper = jnp.array([each.max for each in inputs])
        edge = jnp.where(jnp.isfinite(upper - lower), EDGE * (upper - lower), 0.0)
        return jnp.clip(u, lower + edge, upper - edge)


def outcome(
    plant: Plant, points: OperatingPoints, regulated: tuple[int, ...], rate: float
) -> Float[Array, "regulated states"]:
    """G = C (s I - F_x)^-1 at the median operating point: what a lasting push on each derivative
    makes of the `regulated` states, C reading them and s being slow (`rate`, 1/s). Taken there and
    not along the way, because a learned plant has no slope beyond what it has learned from."""
    x, u = (jnp.asarray(np.median(each, axis=0)) for each in points)
    F_x = jax.jacfwd(lambda x: plant.derivative(x, u))(x)
    return jnp.linalg.inv(rate * jnp.eye(len(x)) - F_x)[jnp.array(regulated)]


def limited(
    c: Float[Array, "inputs"],
    last: Float[Array, "inputs"],
    limits: Limits,
    dt: Float[Array, ""],
) -> tuple[Float[Array, "inputs"], Bool[Array, "inputs"]]:
    """(the compensation after `last` inside its limits, where its authority falls short of `c`)."""
    short = jnp.abs(c) > limits.authority
    c = jnp.clip(c, -limits.authority, limits.authority)
    return last + jnp.clip(c - last, -limits.slew * dt, limits.slew * dt), short
