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
added back. A fault is varied by its own size, to the side of the guess, so that a limit counts.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.observers.divided_difference import Belief, DividedDifferenceFilter, FilterNoise
from faultgauge.programs import program

__all__ = ["KnownStretch", "Shocks", "shocks"]


class KnownStretch(NamedTuple):
    """A stretch, the faults that are `known` and a guess `f` of another, per sample; `dt[k]`
    leads to sample k. Declared faults come first, then undeclared ones."""

    u: Float[Array, "samples inputs"]
    y: Float[Array, "samples outputs"]
    dt: Float[Array, "samples"]
    f: Float[Array, "samples faults"]
    known: Float[Array, "samples faults"]


class Shocks(NamedTuple):
    """For an onset at each sample: `score` and `information` of each fault's size, and the
    log-likelihood gained by an `unknown` shock of the states.

    `base` is ln p(y) with the known faults alone; `fit` the guess's part of the innovations and
    `white` what it leaves of them, both in standard deviations.
    """

    score: Float[Array, "samples faults"]
    information: Float[Array, "samples faults"]
    unknown: Float[Array, "samples"]
    base: Float[Array, ""]
    white: Float[Array, "samples outputs"]
    fit: Float[Array, "samples outputs"]


class _Effect(NamedTuple):
    """One sample of the equations above, e and the guess's part of it, and ln p(y); by how much the
    states jump for a unit of a fault that begins before it."""

    e: Float[Array, "*samples outputs"]
    part: Float[Array, "*samples outputs"]
    G: Float[Array, "*samples outputs n"]
    T: Float[Array, "*samples n n"]
    likelihood: Float[Array, "*samples"]
    late: Float[Array, "*samples n faults"]


@program
def shocks(
    lane: DividedDifferenceFilter,
    noise: FilterNoise,
    belief: Belief,
    record: KnownStretch,
    shock: Float[Array, "states"],
) -> Shocks:
    """Filter forwards, collect backwards; `belief` is of the states, `shock` the standard
    deviations of an unknown shock to each."""
    n, F = lane.states, lane.faults
    up = jnp.sum(record.f + record.known, axis=0) >= 0

    def forwards(
        carry: tuple[Belief, Array, Array, Array, Array], sample: KnownStretch
    ) -> tuple[tuple[Belief, Array, Array, Array, Array], _Effect]:
        before, u_before, d, known, f = carry
        told, others = sample.f + sample.known, sample.known + f
        # a fault that is told comes late where its input does
        x = before.mean[:n]
        late = lane.plant.leans(u_before, u_before, known + f, told)
        late = late + lane.plant.shows_late(x, u_before, known + f, told)
        mean = jnp.concatenate([x + late, told, before.mean[n + F :]])
        d = d + lane.plant.leans(u_before, u_before, others, told)
        d = d + lane.plant.shows_late(x, u_before, others, told)
        late = lane.plant.enters(x, u_before, told, lane.probe)
        after, likelihood, flow, look, seen = lane.step(
            Belief(mean, before.P), noise, u_before, sample.u, sample.y, sample.dt
        )
        B, D = jnp.where(up, flow.up, flow.down), jnp.where(up, look.up, look.down)
        M = jnp.concatenate([flow.A[:n, :n], B], axis=1)
        rows = []
        for j in range(len(seen.white)):
            row = look.C[j, :n] @ M + jnp.concatenate([jnp.zeros(n), D[j]])
            rows.append(row / seen.root[j])
            row = jnp.where(jnp.isfinite(seen.root[j]), row, 0.0)
            M = M - seen.gain[j, :n, None] * row
        G = jnp.stack(rows)
        guess = jnp.concatenate([d, sample.f])
        part = G @ guess
        e = seen.white + part
        likelihood += (seen.white @ seen.white - e @ e) / 2
        T = jnp.concatenate([M, np.eye(n + F)[n:]])
        carry = after, sample.u, M @ guess, sample.known, sample.f
        return carry, _Effect(e, part, G, T, likelihood, late)

    start = belief, record.u[0], jnp.zeros(n), record.known[0], record.f[0]
    effects = jax.lax.scan(forwards, start, record)[1]
    score, information, unknown = _backwards(effects, n, shock)
    base = jnp.sum(effects.likelihood)
    return Shocks(score, information, unknown, base, effects.e - effects.part, effects.part)


def _backwards(
    effects: _Effect, n: int, shock: Float[Array, "states"]
) -> tuple[Array, Array, Array]:
    size = effects.T.shape[-1]

    def body(carry: tuple[Array, Array], effect: _Effect) -> tuple[tuple[Array, Array], Array]:
        r, N = carry
        r = effect.G.T @ effect.e + effect.T.T @ r
        N = effect.G.T @ effect.G + effect.T.T @ N @ effect.T
        M = shock[:, None] * N[:n, :n] * shock + jnp.eye(n)
        L = jnp.linalg.cholesky(M)
        white = jax.scipy.linalg.solve_triangular(L, shock * r[:n], lower=True)
        gained = white @ white / 2 - jnp.sum(jnp.log(jnp.diagonal(L)))
        unit = jnp.concatenate([effect.late, jnp.eye(size - n)])
        informed = jnp.sum(unit * (N @ unit), axis=0)
        return (r, N), jnp.concatenate([unit.T @ r, informed, gained[None]])

    start = jnp.zeros(size), jnp.zeros((size, size))
    rows = jax.lax.scan(body, start, effects, reverse=True)[1]
    count = size - n
    return rows[:, :count], rows[:, count : 2 * count], rows[:, -1]
