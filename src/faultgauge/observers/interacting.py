"""Interacting modes: a bank of sigma-point filters that share one posterior.

Between samples a mode turns into its neighbours at the rates of `Links`; every filter then starts
from the mixture of what may have led to it (Blom and Bar-Shalom, IEEE TAC 33 (1988), "The
interacting multiple model algorithm"), and the posterior follows by Bayes' rule:

    c_j = sum_i T_ij p_i,    p_j ~ c_j L_j(y),    T_ij = 1 - exp(-rate_ij dt).

A filter of a fault that was absent starts with the prior of its size, so the onset is where the
data put it.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.observers.modes import Links
from faultgauge.observers.sigma_point import (
    Belief,
    Gain,
    Hypothesis,
    SigmaPointFilter,
    solve_lower,
    with_parameters,
)
from faultgauge.plants.plant import Plant, respond
from faultgauge.simulation.integrators import step as integrate

__all__ = ["BankInfo", "BankState", "InteractingModes", "cholesky"]

NEGLIGIBLE = 1e-3  # share of a mixture that would only blur a mode
ESTABLISHED = 0.5  # that is more probable than this; others stay open for a fault that begins
FLOOR = 1e-12  # of a probability, so that a mode can come back
OUTLIER = 1e-4  # share of samples that say nothing: one sample weighs at most ln(1/OUTLIER)
FULL = 4.0  # what a direction has been seen is kept below this many times `enough`


class BankState(NamedTuple):
    """A checkpoint: posterior, beliefs, last input; `shift` and `seen` of `probe`."""

    p: Float[Array, "modes"]
    belief: Belief
    u: Float[Array, "inputs"]
    shift: Float[Array, "faults two kept"]
    seen: Float[Array, "faults two"]


class BankInfo(NamedTuple):
    """What one sample leaves: the posterior, means and standard deviations of the fault slots in
    every mode, the posterior mean of [states, drifting parameters], and which directions of each
    fault (down, up) the data of the last `memory` seconds could show (at least 1: they could)."""

    p: Float[Array, "modes"]
    f: Float[Array, "modes slots"]
    sd: Float[Array, "modes slots"]
    x: Float[Array, "kept"]
    seen: Float[Array, "faults two"]


def cholesky(A: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Root of a covariance, unrolled; a pivot lost to rounding is held at 1e-15 of its diagonal."""
    n = A.shape[0]
    least = 1e-15 * jnp.diagonal(A) + 1e-300
    columns = []
    for i in range(n):
        column = A[:, 0] / jnp.sqrt(jnp.maximum(A[0, 0], least[i]))
        columns.append(jnp.concatenate([jnp.zeros(i), column]))
        A = A[1:, 1:] - column[1:, None] * column[None, 1:]
    return jnp.stack(columns, axis=1)


class InteractingModes(eqx.Module):
    """The bank over any plant; pure `init` and `step`.

    `probes` are the sizes by which each fault is tried downwards and upwards; `memory` [s] and
    `enough` (log-likelihood) say for how long and how clearly it must have been visible.
    """

    plant: Plant
    hypothesis: Hypothesis
    links: Links
    probes: Float[Array, "faults two"]
    memory: Float[Array, ""]
    enough: Float[Array, ""]
    drifting: tuple[str, ...] = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def init(
        self,
        x: Float[Array, "states"],
        sd: Float[Array, "states"],
        drifted: Float[Array, "drifting"],
        u: Float[Array, "inputs"],
        p: Float[Array, "modes"],
    ) -> BankState:
        """Start at state `x` +- `sd`, drifting parameters +- `drifted`, with prior `p`."""
        modes, slots = len(p), self.hypothesis.select.shape[-1]
        values = [getattr(self.plant, "parameters", {})[name] for name in self.drifting]
        mean = jnp.concatenate([x, jnp.array(values), jnp.zeros(slots)])
        spread = jnp.concatenate([sd, drifted, jnp.zeros(slots)])
        fresh = self.links.entering.at[:, : len(x) + len(values)].set(0.0) + spread
        root = jax.vmap(jnp.diag)(fresh)
        faults, kept = len(self.probes), len(x) + len(values)
        belief = Belief(jnp.tile(mean, (modes, 1)), root)
        p = jnp.maximum(p, FLOOR)
        zero = jnp.zeros((faults, 2))
        return BankState(p / jnp.sum(p), belief, u, jnp.zeros((faults, 2, kept)), zero)

    def step(
        self,
        state: BankState,
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[BankState, BankInfo]:
        """One sample: `u` and `y` (NaN: not sampled) now, `dt` s after the last."""
        prior, mixed = self.mix(state.p, state.belief, dt)

        def one(hypothesis: Hypothesis, belief: Belief) -> tuple[Belief, Float[Array, ""], Gain]:
            lane = SigmaPointFilter(self.plant, hypothesis, self.drifting, self.substeps)
            return lane.step(belief, state.u, u, y, dt)

        belief, likelihood, gain = jax.vmap(one)(self.hypothesis, mixed)
        p = posterior(prior, likelihood)
        healthy = jax.tree.map(lambda a: a[0], (mixed, gain))
        shift, seen = self.probe(state, healthy[0], healthy[1], u, y, dt)
        n = belief.mean.shape[1]
        slots = self.hypothesis.select.shape[-1]
        sd = jnp.sqrt(jnp.sum(belief.root[:, n - slots :] ** 2, axis=2))
        info = BankInfo(
            p, belief.mean[:, n - slots :], sd, p @ belief.mean[:, : n - slots], seen / self.enough
        )
        return BankState(p, belief, u, shift, seen), info

    def mix(
        self, p: Float[Array, "modes"], belief: Belief, dt: Float[Array, ""]
    ) -> tuple[Float[Array, "modes"], Belief]:
        """(prior of every mode, what its filter starts from)."""
        source, rate, place, fresh, entering, jump, leaving, hidden = self.links
        change = -jnp.expm1(-rate * dt)
        change = change.at[:, 0].set(jnp.exp(-leaving * dt))
        weight = p[source] * change
        prior = jnp.sum(weight, axis=1)
        weight = weight / prior[:, None]
        blurs = (weight < NEGLIGIBLE) & (prior > ESTABLISHED)[:, None]
        weight = jnp.where(blurs, 0.0, weight)
        weight = weight / jnp.sum(weight, axis=1, keepdims=True)
        m = jnp.where(fresh, 0.0, belief.mean[source[:, :, None], place])
        mean = jnp.sum(weight[:, :, None] * m, axis=1)
        covariance = belief.root @ jnp.swapaxes(belief.root, 1, 2)
        P = covariance[source[:, :, None, None], place[:, :, :, None], place[:, :, None, :]]
        kept = ~fresh
        P = jnp.where(kept[:, :, :, None] & kept[:, :, None, :], P, 0.0)
        apart = m - mean[:, None]
        P = P + apart[:, :, :, None] * apart[:, :, None, :]
        P = P + hidden[:, :, :, None] * hidden[:, :, None, :]
        new = jnp.sum(weight[:, :, None] * fresh, axis=1) * entering**2
        new = new + jnp.sum(weight[:, 1:], axis=1)[:, None] * jump**2
        P = jnp.sum(weight[:, :, None, None] * P, axis=1) + jax.vmap(jnp.diag)(new)
        return prior, Belief(mean, jax.vmap(cholesky)(P))

    def probe(
        self,
        state: BankState,
        healthy: Belief,
        gain: Gain,
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[Float[Array, "faults two kept"], Float[Array, "faults two"]]:
        """How far a fault of every kind would have moved the healthy filter, and how clearly the
        last samples would have shown it:

            J <- exp(-dt / memory) J + |S^-1/2 dv|^2

        with dv the innovation that the fault would have caused, found by simulation, so a bias
        that an actuator's limit cuts off, or a gain loss at rest, shows as nothing.
        """
        states, kept = len(self.plant.signals.states), state.shift.shape[-1]
        at = healthy.mean[:kept]
        every = self.hypothesis.select.shape[1]

        def run(z: Array, f: Array) -> tuple[Array, Array]:
            plant = with_parameters(self.plant, self.drifting, z[states:])
            x = integrate(plant, z[:states], state.u, u, f, dt, self.substeps)
            return jnp.concatenate([x, z[states:]]), respond(plant, x, u, f)[1]

        usual_z, usual_y = run(at, jnp.zeros(every))
        sizes = self.probes[:, :, None] * jnp.eye(len(self.probes), every)[:, None]
        moved, shown = jax.vmap(jax.vmap(run))(at + state.shift, sizes)
        change = jnp.where(jnp.isfinite(y), shown - usual_y, 0.0)
        white = jax.vmap(jax.vmap(solve_lower, (None, 0)), (None, 0))(gain.root, change)
        fade = jnp.exp(-dt / self.memory)
        shift = fade * (moved - usual_z - white @ gain.cross[:kept].T)
        finite = jnp.isfinite(white).all(axis=2) & jnp.isfinite(shift).all(axis=2)
        shift = jnp.where(finite[:, :, None], shift, 0.0)
        more = jnp.where(finite, jnp.sum(white**2, axis=2), 0.0) / 2
        return shift, jnp.minimum(fade * state.seen + more, FULL * self.enough)


def posterior(
    prior: Float[Array, "modes"], likelihood: Float[Array, "modes"]
) -> Float[Array, "modes"]:
    """Bayes' rule; a sample may be an outlier that fits every mode as well as the best one."""
    relative = likelihood - jnp.max(likelihood)
    p = prior * ((1 - OUTLIER) * jnp.exp(relative) + OUTLIER)
    p = jnp.maximum(p / jnp.sum(p), FLOOR)
    return p / jnp.sum(p)
