"""Levenberg-Marquardt for many small residuals with few parameters.

    minimise  c(theta) = sum_k r_k(theta)^2 + sum_i penalty_i theta_i^2

The normal equations (see `normal_equations`) are solved by Cholesky, damping follows Nielsen's gain
ratio (H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05). Every start is a
program of its own in one compiled loop, and one that fails does not disturb the others.

Unknowns may belong to one sample alone, as the initial state of a simulated run does: `local` of
them per sample stand at the end. There, and where `linearised` gives residual and Jacobian at once,
a residual is a long loop and its Jacobian dear, so every step is bent along the valley by its
geodesic acceleration, for one residual more (M. K. Transtrum
and J. P. Sethna, "Improvements to the Levenberg-Marquardt algorithm", arXiv:1201.5885, 2012):

    theta + v + a / 2,   a = -(H + mu I)^-1 J k,   k = d^2 r / dh^2 along theta + h v
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from faultgauge.identification.optimise.means import means_of, points_of
from faultgauge.identification.optimise.normal_equations import (
    Linearised,
    Residual,
    bordered_equations,
    forward,
    normal_equations,
    own,
    shared,
)
from faultgauge.programs import program

__all__ = [
    "CONVERGED",
    "FAILED",
    "NOT_CONVERGED",
    "VALIDATION_STOP",
    "Options",
    "Residual",
    "Solution",
    "levenberg_marquardt",
    "not_converged",
]

CONVERGED, VALIDATION_STOP, NOT_CONVERGED, FAILED = range(4)

REACH = 0.1  # of a step: where its curvature is felt
BENDS = 0.75  # of a step: its acceleration at most, or the quadratic no longer holds


class Options(NamedTuple):
    """Limits of one fit: `tau` scales the first damping; `max_fail` counts steps without a
    better validation cost; `tolerance` is the relative reduction of cost that still counts;
    `batch` starts go through each trial together, which pays where a residual is a long loop."""

    max_trials: int = 300
    max_fail: int = 6
    tau: float = 1e-3
    tolerance: float = 1e-10
    batch: int | None = None


DEFAULTS = Options()


class Solution(NamedTuple):
    """One row per start. `status` is CONVERGED, VALIDATION_STOP, NOT_CONVERGED (the cap was
    hit) or FAILED (no finite cost); `history` holds (cost, validation cost) per trial, NaN
    after the end."""

    theta: Float[Array, "starts parameters"]
    cost: Float[Array, "starts"]
    validation_cost: Float[Array, "starts"]
    status: Int[Array, "starts"]
    trials: Int[Array, "starts"]
    history: Float[Array, "starts trials 2"]


def not_converged(name: str, trials: int) -> str:
    """What to tell of a fit of `name` that hit the cap."""
    return (
        f"{name}: the search ended after {trials} trials before it had converged; judge the model "
        "by its error on held-out data, and where that is too large give better parameter values, "
        "more restarts or fewer hidden units"
    )


class _State(NamedTuple):
    theta: Array
    cost: Array
    hessian: Array
    gradient: Array
    rows: Array | None
    mu: Array
    nu: Array
    best: Array
    best_cost: Array
    best_validation: Array
    fails: Array
    stalls: Array
    trial: Array
    status: Array
    history: Array


class _Problem(NamedTuple):
    """What is minimised, and the way from one trial to the next."""

    residual: Residual
    samples: Any
    validation: Any | None
    lower: Array
    upper: Array
    options: Options
    penalty: Array | None
    local: int
    linearised: Linearised | None
    beside: Callable[[Float[Array, "parameters"]], Float[Array, "rows"]] | None

    @property
    def bordered(self) -> bool:
        return bool(self.local) or self.linearised is not None

    def equations(self, theta: Array) -> tuple[Array, Array, Array, Array | None]:
        """(c, H, g, rows of Jacobian and residual where steps are bent)."""
        if self.bordered:
            at_once = self.linearised or forward(self.residual)
            cost, hessian, gradient, rows = bordered_equations(
                at_once, theta, self.samples, self.local
            )
        else:
            cost, hessian, gradient = normal_equations(self.residual, theta, self.samples)
            rows = None
        if self.beside is not None:
            r, J = self.beside(theta), jax.jacrev(self.beside)(theta)
            cost, hessian, gradient = cost + r @ r, hessian + J.T @ J, gradient + J.T @ r
        if self.penalty is None:
            return cost, hessian, gradient, rows
        return (
            cost + self.penalty @ theta**2,
            hessian + jnp.diag(self.penalty),
            gradient + self.penalty * theta,
            rows,
        )

    def no_rows(self, theta: Array) -> Array:
        """Zeros in the shape of `equations`' rows, which need not be traced for it."""
        each = own(theta, self.samples, self.local)
        r = jax.eval_shape(lambda: jax.vmap(self.residual)(each, self.samples))
        return jnp.zeros((*r.shape, each.shape[1] + 1))

    def bend(self, s: _State, rows: Array, factor: Any, held: Array, step: Array) -> Array:
        """a / 2; the curvature from one residual at a part of the step."""
        jacobian, r = rows[..., :-1], rows[..., -1]
        each = own(s.theta + REACH * step, self.samples, self.local)
        reached = jax.vmap(self.residual)(each, self.samples)
        slope = jnp.einsum("seo,so->se", jacobian, own(step, self.samples, self.local))
        k = 2 / REACH * ((reached - r) / REACH - slope)
        pulled = shared(jnp.einsum("seo,se->so", jacobian, k), self.local)
        if self.beside is not None:
            r, pull = jax.vjp(self.beside, s.theta)
            slope = jax.jvp(self.beside, (s.theta,), (step,))[1]
            k = 2 / REACH * ((self.beside(s.theta + REACH * step) - r) / REACH - slope)
            pulled += pull(k)[0]
        a = -jax.scipy.linalg.cho_solve(factor, jnp.where(held, 0.0, pulled))
        return jnp.where(jnp.linalg.norm(a) <= BENDS * jnp.linalg.norm(step), a / 2, 0.0)

    def validate(self, theta: Array, cost: Array) -> Array:
        if self.validation is None:
            return cost
        r = jax.vmap(self.residual, (None, 0))(theta, points_of(self.validation))
        return jnp.sum(means_of(self.validation, r.T) ** 2)

    def begin(self, theta: Array) -> _State:
        """Before the first trial, which only evaluates: one place in the program that does."""
        nothing = jnp.zeros_like(theta)
        infinite = jnp.asarray(jnp.inf)
        return _State(
            theta=theta,
            cost=infinite,
            hessian=jnp.zeros((theta.size, theta.size)),
            gradient=nothing,
            rows=self.no_rows(theta) if self.bordered else None,
            mu=jnp.asarray(1.0),
            nu=jnp.asarray(2.0),
            best=theta,
            best_cost=infinite,
            best_validation=infinite,
            fails=jnp.asarray(0),
            stalls=jnp.asarray(0),
            trial=jnp.asarray(-1),
            status=jnp.asarray(-1),
            history=jnp.full((self.options.max_trials, 2), jnp.nan),
        )

    def reach(self, s: _State) -> tuple[Array, Array]:
        """(where the next step leads, the reduction of c that the quadratic model predicts)."""
        lower, upper = self.lower, self.upper
        # a parameter that its bound holds back stays out, or the others' step would count on it
        held = (s.theta <= lower) & (s.gradient > 0) | (s.theta >= upper) & (s.gradient < 0)
        reduced = jnp.where(held[:, None] | held, 0.0, s.hessian)
        factor = jax.scipy.linalg.cho_factor(reduced + s.mu * jnp.eye(s.theta.size))
        step = -jax.scipy.linalg.cho_solve(factor, s.gradient)
        # for the step that the quadratic model knows, before it is bent
        delta = jnp.clip(s.theta + step, lower, upper) - s.theta
        predicted = -(2 * s.gradient @ delta + delta @ s.hessian @ delta)
        if s.rows is not None:
            step += self.bend(s, s.rows, factor, held, step)
        return jnp.clip(s.theta + step, lower, upper), predicted

    def trial(self, s: _State) -> _State:
        options = self.options
        first = s.trial < 0
        theta, predicted = self.reach(s)
        delta = theta - s.theta
        cost, hessian, gradient, rows = self.equations(theta)
        scale = jnp.max(jnp.diag(hessian))
        finite = jnp.isfinite(cost) & jnp.isfinite(scale)
        better = finite & jnp.all(jnp.isfinite(delta)) & (cost < s.cost)
        better &= jnp.all(jnp.isfinite(hessian))
        gain = jnp.clip((s.cost - cost) / predicted, 0.0, 1e3)
        shrink = jnp.maximum(1 / 3, 1 - (2 * gain - 1) ** 3)
        valid = self.validate(theta, cost)
        improved = better & (valid < s.best_validation)
        small = (s.cost - cost) <= options.tolerance * s.cost
        stuck = jnp.max(jnp.abs(delta)) <= 1e-12 * (1 + jnp.max(jnp.abs(s.theta)))
        stalls = jnp.where(better & small & ~first, s.stalls + 1, jnp.where(better, 0, s.stalls))
        fails = jnp.where(improved | first, 0, jnp.where(better, s.fails + 1, s.fails))
        done = (stalls >= 2) | stuck | (s.mu > 1e16 * jnp.max(jnp.diag(s.hessian)))
        status = jnp.where(done & ~first, CONVERGED, -1)
        status = jnp.where(first & ~finite, FAILED, status)
        if self.validation is not None:
            status = jnp.where((status < 0) & (fails >= options.max_fail), VALIDATION_STOP, status)
        keep = lambda new, old: jnp.where(better, new, old)  # noqa: E731
        costs = jnp.stack([keep(cost, s.cost), keep(valid, jnp.nan)])
        mu = jnp.where(
            first, options.tau * jnp.maximum(scale, 1e-300), keep(s.mu * shrink, s.mu * s.nu)
        )
        return _State(
            theta=keep(theta, s.theta),
            cost=keep(cost, s.cost),
            hessian=keep(hessian, s.hessian),
            gradient=keep(gradient, s.gradient),
            rows=None if rows is None else keep(rows, s.rows),
            mu=mu,
            nu=keep(2.0, s.nu * 2.0),
            best=jnp.where(improved, theta, s.best),
            best_cost=jnp.where(improved | first, cost, s.best_cost),
            best_validation=jnp.where(improved, valid, s.best_validation),
            fails=fails,
            stalls=stalls,
            trial=s.trial + 1,
            status=status,
            history=jnp.where(first, s.history, s.history.at[s.trial].set(costs)),
        )


@program
def levenberg_marquardt(
    residual: Residual,
    starts: Float[Array, "starts parameters"],
    samples: Any,
    validation: Any | None,
    lower: Float[Array, "parameters"],
    upper: Float[Array, "parameters"],
    options: Options = DEFAULTS,
    penalty: Float[Array, "parameters"] | None = None,
    local: int = 0,
    linearised: Linearised | None = None,
    limit: Int[Array, ""] | None = None,
    beside: Callable[[Float[Array, "parameters"]], Float[Array, "rows"]] | None = None,
) -> Solution:
    """Fit from every start. `samples` and `validation` are trees of arrays, samples first, or
    `Means` over such.

    `penalty`, and the squares of the rows `beside` all samples, are part of `cost` and not of the
    cost over `validation` samples. With `validation`
    the parameters of the lowest validation cost are returned; unknowns that are `local` to the
    samples allow none. Steps are projected on [lower, upper] (D. P. Bertsekas, "Projected Newton
    methods", SICON 20, 1982). `limit` is a lower cap of the trials, with which nothing is compiled
    anew. `residual` must be a hashable function or an Equinox module, so that
    the compiled program is found again.
    """
    problem = _Problem(
        residual, samples, validation, lower, upper, options, penalty, local, linearised, beside
    )
    most = options.max_trials if limit is None else jnp.minimum(limit, options.max_trials)

    def run(theta: Array) -> _State:
        going = lambda s: (s.status < 0) & (s.trial < most)  # noqa: E731
        return jax.lax.while_loop(going, problem.trial, problem.begin(theta))

    final = jax.lax.map(run, jnp.clip(starts, lower, upper), batch_size=options.batch)
    return Solution(
        theta=final.best,
        cost=final.best_cost,
        validation_cost=final.best_validation,
        status=jnp.where(final.status < 0, NOT_CONVERGED, final.status),
        trials=final.trial,
        history=final.history,
    )
