"""A filter that needs no derivatives: first-order divided differences (DD1).

    z = [x, faults, growth rates of faults],    A_i = (Phi(z + s_i e_i) - Phi(z - s_i e_i)) / 2 s_i

with s_i the standard deviation of z_i, so that a sign, a dead zone or a limit counts as far as it
lies within what is not known (Norgaard, Poulsen and Ravn, Automatica 36 (2000), "New developments
in state estimation for nonlinear systems"). Outputs are taken one after another, P - K S K^T each.
A sample far outside of what is expected has its noise raised until it is `FAR` standard deviations
off: a glitch moves nothing, and what stays off speaks for whatever explains it.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.plants.disturbed import Disturbed
from faultgauge.plants.plant import respond
from faultgauge.products import among, contract, taken
from faultgauge.simulation.integrators import step_through
from faultgauge.simulation.intersample import line
from faultgauge.simulation.lanes import lanes_last

__all__ = [
    "FAR",
    "Belief",
    "DividedDifferenceFilter",
    "FilterNoise",
    "Flow",
    "Look",
    "Seen",
    "raised",
]

FAR = 5.0  # standard deviations of an innovation beyond which it is no noise
MISSING = 1.5  # steps from row to row
LEAST = 1e-7  # of a state's scale: the shortest difference
HUGE = 1e60  # above any number in any unit: its square must not overflow
LOST = -1e3  # log-likelihood of a sample that no finite prediction precedes


class Belief(NamedTuple):
    """Mean and covariance of z."""

    mean: Float[Array, "*many n"]
    P: Float[Array, "*many n n"]


class FilterNoise(NamedTuple):
    """Standard deviations: `process` per sqrt(s) of the states, `walk` per sqrt(s) of the faults,
    `sigma` of a sample, and by what its time errs, `jitter` [s] (none: not at all)."""

    process: Float[Array, "*many states"]
    walk: Float[Array, "*many faults"]
    sigma: Float[Array, "*many outputs"]
    jitter: Float[Array, "*many outputs"] | None = None


class Flow(NamedTuple):
    """One step linearised: z' = A z; `up` and `down` are what a unit of each fault does to the
    states upwards and downwards, which a limit makes different; towards 0 it is the mean of all
    the way there, as a fault that goes does so at once. `far` is
    what a unit of those does that come as large as `reach`."""

    A: Float[Array, "*many n n"]
    up: Float[Array, "*many states faults"]
    down: Float[Array, "*many states faults"]
    far: Float[Array, "*many states far"]


class Look(NamedTuple):
    """The outputs linearised: y = C z, with `up`, `down` and `far` as in `Flow`."""

    C: Float[Array, "*many outputs n"]
    up: Float[Array, "*many outputs faults"]
    down: Float[Array, "*many outputs faults"]
    far: Float[Array, "*many outputs far"]


class Seen(NamedTuple):
    """What each output said, in turn: the whitened innovation (0: not sampled), the root of its
    variance (infinite: not sampled), the same before it was raised for what is far off, and the
    gain of z."""

    white: Float[Array, "*many outputs"]
    root: Float[Array, "*many outputs"]
    usual: Float[Array, "*many outputs"]
    gain: Float[Array, "*many outputs n"]


def raised(squares: Float[Array, "*any"]) -> Float[Array, "*any"]:
    """How many times as large the variance of innovations is taken, by their squares over it."""
    return jnp.maximum(1.0, squares * FAR**-2)


def _finite(slope: Float[Array, "*any"], other: Float[Array, "*any"]) -> Float[Array, "*any"]:
    """`slope`, where that is no number the `other` one."""
    return jnp.where(jnp.isfinite(slope), slope, other)


class DividedDifferenceFilter(eqx.Module):
    """One filter over a plant and its discrepancy; pure `step`.

    `growing` are the faults that have a growth rate in z, `scale` the sizes of the states and
    `probe` those of the faults, by which those that are known exactly are varied; `far` are faults
    of which a size of `reach` does something else; rows are `step_s` [s] apart, and where one is
    missing, nobody knows when within it an input changed.
    """

    plant: Disturbed
    scale: Float[Array, "states"]
    probe: Float[Array, "faults"]
    growing: tuple[int, ...] = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    step_s: Float[Array | np.ndarray, ""] = eqx.field(default_factory=lambda: np.asarray(np.inf))
    far: tuple[int, ...] = eqx.field(static=True, default=())
    reach: Float[Array | np.ndarray, "far"] = eqx.field(default_factory=lambda: np.zeros(0))

    @property
    def states(self) -> int:
        return len(self.plant.signals.states)

    @property
    def faults(self) -> int:
        return len(self.plant.signals.faults)

    @property
    def _trailing(self) -> slice:
        """Where what trails stands behind the plant's own states."""
        g, own = self.plant.parts.g, self.plant.count
        return slice(g.start - own, g.stop - own)

    def begin(self, x: Float[Array, "states"], sd: Float[Array, "states"]) -> Belief:
        """The states at `x` +- `sd`, and no fault."""
        more = self.faults + len(self.growing)
        mean = jnp.concatenate([x + self.plant.lately, jnp.zeros(more)])
        return Belief(mean, jnp.diag(jnp.concatenate([sd, jnp.zeros(more)]) ** 2))

    def predict(
        self,
        belief: Belief,
        noise: FilterNoise,
        u_before: Float[Array, "inputs"],
        u: Float[Array, "inputs"],
        dt: Float[Array, ""],
    ) -> tuple[Belief, Flow]:
        """The belief `dt` s later."""
        n, k, own = self.states, self.faults, self.plant.count
        times = dt * np.arange(2 * self.substeps + 1) / (2 * self.substeps)
        stages = line(self.plant.signals, u_before, u, self.substeps)
        middle = stages[self.substeps]

        def flow(x: Array, f: Array) -> Array:
            plant, forces = self.plant.own_at(x), self.plant.forces(x, middle, f, times)
            end = step_through(plant, x[:own], stages, f, dt, self.substeps, forces=forces)
            return jnp.concatenate([end, self.plant.trails(plant, x, end, stages, u, f, dt)])

        def placed(rows: Array) -> Array:
            rest = jnp.zeros((n - own, *rows.shape[1:]))
            return jnp.concatenate([rows[:own], rest.at[self._trailing].set(rows[own:])])

        after, F, middle, *sides = self._differences(flow, belief, self.plant.stirring)
        z, size = belief.mean, len(belief.mean)
        mixed, plain, back = self.rows(size)
        # what stands behind the plant's own states fades; but for what trails it follows nobody
        fades = jnp.concatenate(
            [jnp.zeros(own), self.plant.lasting(dt, z, after), jnp.ones(size - n)]
        )
        F = F + np.eye(n)[mixed[: len(F)]] * fades[:n]
        M = jnp.concatenate([F, middle, jnp.zeros((len(F), size - n - k))], axis=1)
        grows = np.zeros((len(self.growing), size))
        grows[range(len(grows)), range(n + k, size)] = 1.0
        grows = np.eye(size)[mixed[len(F) :]] + dt * grows
        after = after + taken(fades * z, mixed[: len(F)])
        parts = after, contract("ij,j->i", grows, z), taken(fades * z, plain)
        after = taken(jnp.concatenate(parts), back)
        # were it less where a fault takes an input's effect, noise that is too large would speak
        # for the fault
        none = jnp.zeros(k)
        unseen = jnp.where(dt > MISSING * self.step_s, dt - self.step_s, 0.0)
        jump = self.plant.jumps(after[:n], u_before, u, none, none, unseen)
        f, rates = z[n : n + k], jnp.zeros(size - n - k)
        mean = after.at[:n].add(self.plant.leans(u_before, u, f, f))
        doubts = self.plant.doubts(u_before, u, z[:n], after[:n], dt)
        process = doubts * noise.process
        Q = dt * jnp.concatenate([process, noise.walk * self._present(belief), rates]) ** 2
        Q = Q.at[:n].add((doubts * jump) ** 2)
        M, rest = jnp.concatenate([M, grows]), np.eye(size)[plain] * fades
        P = self.carried(M, taken(fades, plain), belief.P) + jnp.diag(Q)
        A = taken(jnp.concatenate([M, rest]), back)
        return Belief(mean, P), Flow(A, *map(placed, sides))

    def rows(
        self, size: int
    ) -> tuple[Int[np.ndarray, "mixed"], Int[np.ndarray, "plain"], Int[np.ndarray, "n"]]:
        """Which rows of the A of a `Flow` hang on many of z (the plant's own states, what trails
        them, what grows), which on their own alone, and where in these two, one behind the other,
        each stands."""
        g = self.plant.parts.g
        grow = [self.states + slot for slot in self.growing]
        mixed = np.array([*range(self.plant.count), *range(g.start, g.stop), *grow])
        plain = np.delete(np.arange(size), mixed)
        return mixed, plain, np.argsort(np.concatenate([mixed, plain]))

    def through(self, A: Float[Array, "n n"], M: Float[Array, "n m"]) -> Float[Array, "n m"]:
        """A M for the A of a `Flow`."""
        mixed, plain, back = self.rows(len(A))
        fades = taken(jnp.diagonal(A), plain)
        parts = contract("ij,jk->ik", taken(A, mixed), M), fades[:, None] * taken(M, plain)
        return taken(jnp.concatenate(parts), back)

    def carried(
        self, M: Float[Array, "mixed n"], fades: Float[Array, "plain"], P: Float[Array, "n n"]
    ) -> Float[Array, "n n"]:
        """A P A^T for the A that has the rows M and `fades` of the other rows' diagonal."""
        _, plain, back = self.rows(len(P))
        rows = contract("ij,jk->ik", M, P)
        both, side = contract("ij,kj->ik", rows, M), taken(rows, plain, 1) * fades
        rest = taken(taken(P, plain), plain, 1) * fades[:, None] * fades
        upper = jnp.concatenate([both, side], axis=1)
        lower = jnp.concatenate([side.T, rest], axis=1)
        return taken(taken(jnp.concatenate([upper, lower]), back), back, 1)

    def look(
        self, belief: Belief, u: Float[Array, "inputs"]
    ) -> tuple[Float[Array, "outputs"], Look]:
        """(the outputs expected under `u`, how they depend on z)."""
        n, k = self.states, self.faults

        def look(x: Array, f: Array) -> Array:
            return respond(self.plant, x, u, f)[1]

        y, H, middle, *sides = self._differences(look, belief, self.plant.shown)
        rates = jnp.zeros((len(y), len(belief.mean) - n - k))
        C = jnp.concatenate([H + self.plant.added, middle, rates], axis=1)
        return y, Look(C, *sides)

    def sampled(
        self,
        noise: FilterNoise,
        look: Look,
        before: Float[Array, "n"],
        after: Float[Array, "n"],
        dt: Float[Array, ""],
    ) -> FilterNoise:
        """`noise` of a sample where z went from `before` to `after` in `dt` [s]: one that came too
        early or too late is off by the rate of its output, sigma^2 + (jitter C dz/dt)^2."""
        if noise.jitter is None:
            return noise
        rate = contract("ij,j->i", look.C, after - before) / jnp.where(dt > 0, dt, 1.0)
        sigma = jnp.sqrt(noise.sigma**2 + (noise.jitter * rate) ** 2)
        return noise._replace(sigma=sigma)

    def update(
        self,
        belief: Belief,
        noise: FilterNoise,
        expected: Float[Array, "outputs"],
        look: Look,
        y: Float[Array, "outputs"],
    ) -> tuple[Belief, Float[Array, ""], Seen]:
        """(the belief after `y` (NaN: not sampled), its log-likelihood, what each output said)."""
        mean, P, total, said = belief.mean, belief.P, jnp.zeros(()), []
        halves: list[Array] = []
        for j in range(len(y)):
            there, H = jnp.isfinite(y[j]), look.C[j]
            HP = contract("i,ij->j", H, P)
            for half in halves:
                HP = HP - contract("i,i->", H, half) * half
            known = contract("i,i->", HP, H)
            S = known + noise.sigma[j] ** 2
            moved = contract("i,i->", H, mean - belief.mean)
            e = jnp.where(there, y[j] - expected[j] - moved, 0.0)
            usual, S = jnp.sqrt(S), S * raised(e**2 / S)
            root = jnp.sqrt(S)
            half = jnp.where(there, HP * (1 / root), 0.0)
            halves.append(half)
            mean = mean + half * (e / root)
            total += jnp.where(there, -0.5 * (e**2 / S + jnp.log(2 * jnp.pi * S)), 0.0)
            said.append(
                (e / root, *(jnp.where(there, a, jnp.inf) for a in (root, usual)), half / root)
            )
        for half in halves:
            P = P - jnp.outer(half, half)
        # no sample takes back what rounding makes asymmetric, and an unstable plant lets it grow
        P = (P + P.T) / 2
        seen = Seen(*(jnp.stack(each) for each in zip(*said, strict=True)))
        return Belief(mean, P), total, seen

    def step(
        self,
        belief: Belief,
        noise: FilterNoise,
        u_before: Float[Array, "inputs"],
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[Belief, Float[Array, ""], Flow, Look, Seen]:
        """One sample, `dt` s after the last: a filter that leaves all bounds stays where it was,
        and says so by its likelihood."""
        predicted, flow = self.predict(belief, noise, u_before, u, dt)
        expected, look = self.look(predicted, u)
        noise = self.sampled(noise, look, belief.mean, predicted.mean, dt)
        after, likelihood, seen = self.update(predicted, noise, expected, look, y)
        # what is no number anywhere is none in the variances either
        rows = self.rows(len(after.mean))[0]
        sizes = [after.mean, jnp.diagonal(after.P), taken(flow.A, rows), *flow[1:], *look]
        # of each number on its own: a largest one waits for all before it
        within = jnp.stack([jnp.all(jnp.abs(part) < HUGE) for part in sizes])
        sound = jnp.isfinite(likelihood) & jnp.all(within)
        never = jnp.full_like(seen.root, jnp.inf)
        nothing = Seen(jnp.zeros_like(seen.white), never, never, jnp.zeros_like(seen.gain))
        still = Flow(jnp.eye(len(belief.mean)), *map(jnp.zeros_like, flow[1:]))  # 0 * NaN is NaN
        blind = jax.tree.map(jnp.zeros_like, look)
        return jax.tree.map(
            lambda new, old: jnp.where(sound, new, old),
            (after, likelihood, flow, look, seen),
            (belief, jnp.asarray(LOST), still, blind, nothing),
        )

    def _present(self, belief: Belief) -> Float[Array, "faults"]:
        """1 for every fault that is there: not known to be 0."""
        n, k = self.states, self.faults
        return jnp.where(jnp.diagonal(belief.P)[n : n + k] > 0, 1.0, 0.0)

    def _differences(
        self,
        of: Callable[[Array, Array], Array],
        belief: Belief,
        stirring: Int[np.ndarray, "some"],
    ) -> tuple[
        Float[Array, "m"],
        Float[Array, "m states"],
        Float[Array, "m faults"],
        Float[Array, "m faults"],
        Float[Array, "m faults"],
        Float[Array, "m far"],
    ]:
        """(`of` in the middle, its slopes over the states, 0 but for those `stirring` it, and over
        the faults within what is not known of them, upwards and downwards, and to those that are
        far); all points run at once."""
        n, k = self.states, self.faults
        sd = jnp.sqrt(jnp.maximum(jnp.diagonal(belief.P)[: n + k], 0.0))
        s = jnp.where(
            sd > 0,
            jnp.maximum(sd, LEAST * jnp.concatenate([self.scale, self.probe])),
            jnp.concatenate([LEAST * self.scale, self.probe]),
        )
        free = np.concatenate([stirring, np.arange(n, n + k)])
        one, m = np.eye(n + k), len(free)
        sides = np.concatenate([0 * one[:, :1], one[:, free], -one[:, free]], axis=1)
        mean, f = belief.mean[: n + k, None], belief.mean[n : n + k]
        far = mean + one[:, [n + fault for fault in self.far]] * self.reach
        points = mean + sides * s[:, None], mean * (1 - one[:, n:]), far
        points = jnp.concatenate(points, axis=1)
        images = lanes_last(of, points[:n], points[n:])
        ends = [0, 1, 1 + m, 1 + 2 * m, 1 + 2 * m + k, images.shape[1]]
        at, over, under, without, farther = (images[:, a:b] for a, b in pairwise(ends))
        each = 1 / s[free]  # divisions are slow
        up, down = (over - at) * each, (at - under) * each
        # a point may lie where the plant is no number: the other side knows
        up, zero = _finite(up, down), jnp.zeros_like(up)
        down = _finite(down, up)
        up, down = _finite(up, zero), _finite(down, zero)
        middle, up, down = (up + down) / 2, up[:, m - k :], down[:, m - k :]
        # a fault that goes does all that its size does, which differs where a limit cuts it off
        large = (jnp.abs(f) > s[n:]) & jnp.isfinite(without)
        back = (at - without) * (1 / jnp.where(large, f, 1.0))
        up = jnp.where(large & (f < 0), back, up)
        down = jnp.where(large & (f > 0), back, down)
        large = (farther - at) / self.reach
        large = _finite(large, jnp.zeros_like(large))
        sides = middle[:, m - k :], up, down, large
        return at[:, 0], among(middle[:, : m - k], stirring, n), *sides
