"""What a fault that began at any sample would have left in the healthy filter's innovations.

With e the whitened innovations, an additive fault f and the filter's error d that it causes,

    d_k = A_k d_k-1 + b_k f,      e_k = e0_k + H_k d_k-1 + s_k f,      e0 ~ N(0, I),

so for an onset at sample n the score and the information of [d, f] come from one backward pass
over all samples, for every n at once:

    r_n = G_n^T e_n + T_n^T r_n+1,    N_n = G_n^T G_n + T_n^T N_n+1 T_n,

    G = [H s],   T = [A b; 0 I]

(de Jong and Penzer, JASA 93 (1998), "Diagnosing shocks in time series"; the generalised likelihood
ratio of Willsky and Jones, IEEE TAC 21 (1976)). The filter is told the faults that are known, and a
guess of the one that is looked for, around which it is linearised: what the guess does to e is
added back.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.observers.interacting import cholesky
from faultgauge.observers.sigma_point import (
    Belief,
    Hypothesis,
    SigmaPointFilter,
    solve_lower,
    with_parameters,
)
from faultgauge.plants.plant import Plant, respond
from faultgauge.simulation.integrators import step as integrate

__all__ = ["Record", "Shocks", "Sizes", "shocks"]


class Record(NamedTuple):
    """A stretch, the faults that are `known` and a guess `f` of another, per sample; `dt[k]`
    leads to sample k."""

    u: Float[Array, "samples inputs"]
    y: Float[Array, "samples outputs"]
    dt: Float[Array, "samples"]
    f: Float[Array, "samples faults"]
    known: Float[Array, "samples faults"]


class Sizes(NamedTuple):
    """Prior standard deviations of what acts undeclared: `driven` behind the declared faults, and
    a `jump` of the states."""

    driven: Float[Array, "driven"]
    jump: Float[Array, "states"]


class Shocks(NamedTuple):
    """For an onset at each sample: `score` and `information` of each declared fault's size, and
    the log-likelihood gained by undeclared drives of all states, without and with a jump.

    `base` is ln p(y) with the known faults alone; `fit` the guess's part of the innovations and
    `white` what it leaves of them, both in standard deviations.
    """

    score: Float[Array, "samples declared"]
    information: Float[Array, "samples declared"]
    unknown: Float[Array, "samples two"]
    base: Float[Array, ""]
    white: Float[Array, "samples outputs"]
    fit: Float[Array, "samples outputs"]


class _Effect(NamedTuple):
    """One sample of the equations above, e and the guess's part of it, and ln p(y)."""

    e: Float[Array, "*samples outputs"]
    part: Float[Array, "*samples outputs"]
    G: Float[Array, "*samples outputs n"]
    T: Float[Array, "*samples n n"]
    likelihood: Float[Array, "*samples"]


@eqx.filter_jit
def shocks(
    plant: Plant,
    noise: Hypothesis,
    belief: Belief,
    record: Record,
    sizes: Sizes,
    drifting: tuple[str, ...],
    substeps: int,
    span: Float[Array, "faults"] | None = None,
) -> Shocks:
    """Filter forwards, collect backwards; `belief` is of [states, drifting parameters].

    What the filter is told is a slot of its own that is known to be 1, times the faults. With a
    `span`, a fault acts in proportion to what that size of it does, limits and all, instead of by
    its slope at what was told.
    """
    kept = len(belief.mean)
    mean = jnp.append(belief.mean, 1.0)
    root = jnp.zeros((kept + 1, kept + 1)).at[:kept, :kept].set(belief.root)

    def forwards(
        carry: tuple[Belief, Array, Array], sample: Record
    ) -> tuple[tuple[Belief, Array, Array], _Effect]:
        before, u_before, d = carry
        told = sample.f + sample.known
        lane = SigmaPointFilter(plant, noise._replace(select=told[:, None]), drifting, substeps)
        after, likelihood, gain = lane.step(before, u_before, sample.u, sample.y, sample.dt)
        H, s, A, b = _linear(lane, before.mean[:kept], u_before, sample, span)
        seen = jnp.isfinite(sample.y)[:, None]
        whiten = jax.vmap(solve_lower, (None, 1), 1)
        H, s = (whiten(gain.root, jnp.where(seen, part, 0.0)) for part in (H, s))
        white, cross = solve_lower(gain.root, gain.innovation), gain.cross[:kept]
        A, b = A - cross @ H, b - cross @ s
        part = H @ d + s @ sample.f
        e = white + part
        likelihood += (white @ white - e @ e) / 2
        below = jnp.eye(len(sample.f), kept + len(sample.f), kept)
        T = jnp.concatenate([jnp.concatenate([A, b], axis=1), below])
        effect = _Effect(e, part, jnp.concatenate([H, s], axis=1), T, likelihood)
        return (after, sample.u, A @ d + b @ sample.f), effect

    start = Belief(mean, root), record.u[0], jnp.zeros(kept)
    effects = jax.lax.scan(forwards, start, record)[1]
    score, information, unknown = _backwards(effects, kept, sizes)
    base = jnp.sum(effects.likelihood)
    return Shocks(score, information, unknown, base, effects.e - effects.part, effects.part)


def _linear(
    lane: SigmaPointFilter,
    z: Float[Array, "kept"],
    u: Float[Array, "inputs"],
    sample: Record,
    span: Float[Array, "faults"] | None,
) -> tuple[Array, Array, Array, Array]:
    """(dy/dz, dy/df, dz'/dz, dz'/df) over one sample, z' and y being the next ones."""
    states = len(lane.plant.signals.states)

    def look(z: Array, f: Array) -> tuple[Array, Array]:
        plant = with_parameters(lane.plant, lane.drifting, z[states:])
        x = integrate(plant, z[:states], u, sample.u, f, sample.dt, lane.substeps)
        return respond(plant, x, sample.u, f)[1], jnp.concatenate([x, z[states:]])

    (y_z, y_f), (z_z, z_f) = jax.jacfwd(look, (0, 1))(z, sample.f + sample.known)
    if span is not None:
        y, after = look(z, sample.known)
        y_all, after_all = jax.vmap(look, (None, 0))(z, sample.known + jnp.diag(span))
        y_f, z_f = ((y_all - y) / span[:, None]).T, ((after_all - after) / span[:, None]).T
    return y_z, y_f, z_z, z_f


def _backwards(effects: _Effect, kept: int, sizes: Sizes) -> tuple[Array, Array, Array]:
    n = effects.T.shape[-1]
    declared = slice(kept, n - len(sizes.driven))
    driven = np.arange(n - len(sizes.driven), n)
    jumped = np.concatenate([np.arange(len(sizes.jump)), driven])
    both = jnp.concatenate([sizes.jump, sizes.driven])

    def body(carry: tuple[Array, Array], effect: _Effect) -> tuple[tuple[Array, Array], Array]:
        r, N = carry
        r = effect.G.T @ effect.e + effect.T.T @ r
        N = effect.G.T @ effect.G + effect.T.T @ N @ effect.T
        alien = jnp.stack([_gained(r, N, driven, sizes.driven), _gained(r, N, jumped, both)])
        return (r, N), jnp.concatenate([r[declared], jnp.diagonal(N)[declared], alien])

    start = jnp.zeros(n), jnp.zeros((n, n))
    rows = jax.lax.scan(body, start, effects, reverse=True)[1]
    count = declared.stop - declared.start
    return rows[:, :count], rows[:, count : 2 * count], rows[:, 2 * count :]


def _gained(
    r: Float[Array, "n"],
    N: Float[Array, "n n"],
    which: np.ndarray,
    size: Float[Array, "k"],
) -> Float[Array, ""]:
    """ln of the likelihood ratio of shocks ~ N(0, diag size^2) to none."""
    M = size[:, None] * N[np.ix_(which, which)] * size + jnp.eye(len(size))
    L = cholesky(M)
    white = solve_lower(L, size * r[which])
    return white @ white / 2 - jnp.sum(jnp.log(jnp.diagonal(L)))
