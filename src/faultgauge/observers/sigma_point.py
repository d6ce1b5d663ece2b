"""A square-root cubature filter for one hypothesis: which faults act, how large they are.

The state is z = [x, drifting parameters, fault slots]. Between samples

    x  <-  Phi(x, f, u, dt) + w_x,      theta <- theta + w_theta,      g <- g + w_g,

with f = select g, and y = h(x, f, u) + v. The 2N points m +- sqrt(N) S_i run through the plant's
own step, so an input fault in front of a saturation comes out right. Covariances are kept as
lower-triangular roots, so they stay positive: Arasaratnam and Haykin, IEEE TAC 54 (2009), "Cubature
Kalman Filters", square-root form; van der Merwe and Wan, ICASSP 2001, for the idea.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant, respond
from faultgauge.simulation.integrators import step as integrate

__all__ = ["Belief", "Gain", "Hypothesis", "SigmaPointFilter", "triangular"]

TINY = 1e-150  # below any standard deviation in any unit
HUGE = 1e100  # and above any number in any unit: its square must not overflow
LOST = -1e6  # log-likelihood of a sample that made a filter overflow


class Hypothesis(NamedTuple):
    """What one filter believes about faults and noise.

    `select` puts the fault slots into the plant's fault vector; `process` and `walk` are standard
    deviations per sqrt(s) of the states and of [drifting parameters, slots]; `sigma` of a sample.
    """

    select: Float[Array, "*modes faults slots"]
    process: Float[Array, "*modes states"]
    walk: Float[Array, "*modes extras"]
    sigma: Float[Array, "*modes outputs"]


class Belief(NamedTuple):
    """Mean and lower-triangular root of the covariance of z."""

    mean: Float[Array, "*modes n"]
    root: Float[Array, "*modes n n"]


class Gain(NamedTuple):
    """The update of one sample: innovation, its root covariance, and the cross term to z.

    z <- z + cross @ solve(root, innovation); both are 0 in channels without a sample.
    """

    innovation: Float[Array, "*modes outputs"]
    root: Float[Array, "*modes outputs outputs"]
    cross: Float[Array, "*modes n outputs"]


def triangular(A: Float[Array, "rows columns"]) -> Float[Array, "rows rows"]:
    """Lower-triangular L with L L^T = A A^T, by modified Gram-Schmidt on the rows.

    Unrolled: a batch of small ones is a few loops over the batch, where LAPACK is a call each.
    The triangular factor is backward stable (Higham, "Accuracy and Stability", 19.8).
    """
    columns = []
    rows = A.shape[0]
    for i in range(rows):
        norm = jnp.sqrt(jnp.sum(A[0] ** 2))
        unit = A[0] / jnp.maximum(norm, TINY)
        along = A[1:] @ unit
        columns.append(jnp.concatenate([jnp.zeros(i), norm[None], along]))
        A = A[1:] - along[:, None] * unit
    return jnp.stack(columns, axis=1)


def solve_lower(L: Float[Array, "n n"], b: Float[Array, "n"]) -> Float[Array, "n"]:
    """L^-1 b, unrolled."""
    found: list[Array] = []
    for i in range(L.shape[0]):
        left = b[i]
        for j, value in enumerate(found):
            left = left - L[i, j] * value
        found.append(left / jnp.maximum(L[i, i], TINY))
    return jnp.stack(found)


class SigmaPointFilter(eqx.Module):
    """One filter over any plant; pure `step`. `drifting` names the parameters in z."""

    plant: Plant
    hypothesis: Hypothesis
    drifting: tuple[str, ...] = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def step(
        self,
        belief: Belief,
        u_before: Float[Array, "inputs"],
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[Belief, Float[Array, ""], Gain]:
        """(belief, log-likelihood of y, gain) after the sample `y` (NaN: not sampled), which
        comes `dt` s after the last one."""
        predicted = self.predict(belief, u_before, u, dt)
        updated, likelihood, gain = self.update(predicted, u, y)
        finite = jnp.isfinite(likelihood)
        for part in updated:
            finite &= jnp.all(jnp.abs(part) < HUGE)
        belief = jax.tree.map(lambda new, old: jnp.where(finite, new, old), updated, belief)
        return belief, jnp.where(finite, likelihood, LOST), gain

    def predict(
        self,
        belief: Belief,
        u_before: Float[Array, "inputs"],
        u: Float[Array, "inputs"],
        dt: Float[Array, ""],
    ) -> Belief:
        """The belief `dt` s later."""
        states, h = len(self.plant.signals.states), self.hypothesis

        def flow(z: Float[Array, "n"]) -> Float[Array, "n"]:
            plant, x, f = self.parts(z)
            later = integrate(plant, x, u_before, u, f, dt, self.substeps)
            return jnp.concatenate([later, z[states:]])

        points = jax.vmap(flow)(self.points(belief))
        mean = jnp.mean(points, axis=0)
        spread = (points - mean).T / jnp.sqrt(float(len(points)))
        noise = jnp.diag(jnp.sqrt(dt) * jnp.concatenate([h.process, h.walk]))
        return Belief(mean, triangular(jnp.concatenate([spread, noise], axis=1)))

    def update(
        self, belief: Belief, u: Float[Array, "inputs"], y: Float[Array, "outputs"]
    ) -> tuple[Belief, Float[Array, ""], Gain]:
        """The belief after `y`, the log-likelihood of y, and the gain."""
        n, outputs = len(belief.mean), len(self.plant.signals.outputs)

        def look(z: Float[Array, "n"]) -> Float[Array, "outputs"]:
            plant, x, f = self.parts(z)
            return respond(plant, x, u, f)[1]

        seen = jnp.isfinite(y)
        images = jax.vmap(look)(self.points(belief))
        expected = jnp.mean(images, axis=0)
        spread = jnp.where(seen[:, None], (images - expected).T, 0.0) / jnp.sqrt(2.0 * n)
        sigma = jnp.diag(jnp.where(seen, self.hypothesis.sigma, 1.0))
        half = belief.root / jnp.sqrt(2.0)
        above = jnp.concatenate([spread, sigma], axis=1)
        below = jnp.concatenate([half, -half, jnp.zeros((n, outputs))], axis=1)
        L = triangular(jnp.concatenate([above, below]))
        root, cross = L[:outputs, :outputs], L[outputs:, :outputs]
        innovation = jnp.where(seen, y - expected, 0.0)
        white = solve_lower(root, innovation)
        scale = jnp.where(seen, jnp.log(jnp.diagonal(root)) + 0.5 * jnp.log(2 * jnp.pi), 0.0)
        likelihood = -0.5 * jnp.sum(white**2) - jnp.sum(scale)
        updated = Belief(belief.mean + cross @ white, L[outputs:, outputs:])
        return updated, likelihood, Gain(innovation, root, cross)

    def points(self, belief: Belief) -> Float[Array, "points n"]:
        """The 2N cubature points."""
        far = jnp.sqrt(float(len(belief.mean))) * belief.root.T
        return jnp.concatenate([belief.mean + far, belief.mean - far])

    def parts(
        self, z: Float[Array, "n"]
    ) -> tuple[Plant, Float[Array, "states"], Float[Array, "faults"]]:
        """(the plant with z's parameters, its state, its faults)."""
        states, drifting = len(self.plant.signals.states), len(self.drifting)
        f = self.hypothesis.select @ z[states + drifting :]
        return with_parameters(self.plant, self.drifting, z[states:]), z[:states], f


def with_parameters(plant: Plant, names: tuple[str, ...], values: Any) -> Plant:
    """`plant` with the first of `values` in place of the parameters `names`."""
    if not names or not isinstance(plant, GrayBoxPlant):
        return plant
    changed = {name: values[k] for k, name in enumerate(names)}
    return eqx.tree_at(lambda p: p.parameters, plant, {**plant.parameters, **changed})
