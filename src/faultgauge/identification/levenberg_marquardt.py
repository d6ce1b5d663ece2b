"""Levenberg-Marquardt for many small residuals with few parameters.

    minimise  c(theta) = sum_k r_k(theta)^2 + sum_i penalty_i theta_i^2

The Jacobian is built sample by sample, in reverse mode or, where one sample gives more equations
than there are unknowns (a whole run, simulated), by forward sensitivities, and stored as
(parameters, samples). The normal equations are solved by Cholesky, damping follows Nielsen's gain
ratio (H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05). Every start is a
program of its own in one compiled loop, and one that fails does not disturb the others.

Unknowns may belong to one sample alone, as the initial state of a simulated run does: `local` of
them per sample stand at the end, theta = [shared, local of sample 1, local of sample 2, ...], and
cost a sample no more than its own; `linearised` then may give (residual, Jacobian) at once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

__all__ = [
    "CONVERGED",
    "FAILED",
    "NOT_CONVERGED",
    "Options",
    "Solution",
    "VALIDATION_STOP",
    "levenberg_marquardt",
    "normal_equations",
]

CONVERGED, VALIDATION_STOP, NOT_CONVERGED, FAILED = range(4)

Residual = Callable[[Float[Array, "parameters"], Any], Float[Array, "equations"]]
Linearised = Callable[
    [Float[Array, "own"], Any],
    tuple[Float[Array, "equations"], Float[Array, "equations own"]],
]


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


class _State(NamedTuple):
    theta: Array
    cost: Array
    hessian: Array
    gradient: Array
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


def normal_equations(
    residual: Residual,
    theta: Float[Array, "parameters"],
    samples: Any,
    local: int = 0,
    linearised: Linearised | None = None,
) -> tuple[Float[Array, ""], Float[Array, "parameters parameters"], Float[Array, "parameters"]]:
    """(c, J J^T, J r) with J stored as (parameters, equations * samples)."""

    def one(theta: Array, sample: Any) -> tuple[Array, Array]:
        r = residual(theta, sample)
        return r, r

    if local:
        forward = jax.jacfwd(one, has_aux=True)
        return _bordered(linearised or (lambda *at: forward(*at)[::-1]), theta, samples, local)
    equations = jax.eval_shape(residual, theta, jax.tree.map(lambda a: a[0], samples)).size
    if equations == 1:

        def scalar(theta: Array, sample: Any) -> Array:
            return residual(theta, sample)[0]

        r, J = jax.vmap(jax.value_and_grad(scalar), (None, 0), (0, -1))(theta, samples)
    else:
        jacobian = jax.jacfwd if equations > theta.size else jax.jacrev
        J, r = jax.vmap(jacobian(one, has_aux=True), (None, 0), (-1, -1))(theta, samples)
        J = jnp.moveaxis(J, 1, 0).reshape(theta.size, -1)
        r = r.reshape(-1)
    # One product gives all three; as a further row, r also keeps J stored row by row, which XLA
    # would otherwise turn round: a third of the time of a trial.
    rows = jnp.concatenate([J, r[None]])
    products = rows @ rows.T
    return products[-1, -1], products[:-1, :-1], products[:-1, -1]


def own(theta: Float[Array, "parameters"], samples: Any, local: int) -> Float[Array, "samples own"]:
    """[shared, local] as every sample sees it."""
    count = jax.tree.leaves(samples)[0].shape[0]
    shared, locals_ = theta[: theta.size - count * local], theta[theta.size - count * local :]
    return jnp.concatenate(
        [jnp.broadcast_to(shared, (count, shared.size)), locals_.reshape(count, local)], axis=1
    )


def _bordered(
    linearised: Linearised, theta: Array, samples: Any, local: int
) -> tuple[Array, Array, Array]:
    """The same where J J^T is block diagonal but for the border of the shared unknowns."""
    each = own(theta, samples, local)
    r, J = jax.vmap(linearised)(each, samples)
    rows = jnp.concatenate([J, r[..., None]], axis=2)
    products = jnp.einsum("seo,sep->sop", rows, rows)
    count, shared = len(each), each.shape[1] - local
    total = jnp.sum(products, axis=0)
    border = jnp.moveaxis(products[:, :shared, shared:-1], 0, 1).reshape(shared, count * local)
    square = products[:, shared:-1, shared:-1]
    blocks = jnp.einsum("sab,st->satb", square, jnp.eye(count)).reshape(border.shape[1], -1)
    hessian = jnp.block([[total[:shared, :shared], border], [border.T, blocks]])
    gradient = jnp.concatenate([total[:shared, -1], products[:, shared:-1, -1].ravel()])
    return total[-1, -1], hessian, gradient


@eqx.filter_jit
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
) -> Solution:
    """Fit from every start. `samples` and `validation` are trees of arrays, samples first.

    `penalty` is part of `cost` and not of the cost over `validation` samples. With `validation`
    the parameters of the lowest validation cost are returned; unknowns that are `local` to the
    samples allow none. Steps are projected on [lower, upper] (D. P. Bertsekas, "Projected Newton
    methods", SICON 20, 1982). `residual` must be a hashable function or an Equinox module, so that
    the compiled program is found again.
    """

    def equations(theta: Array) -> tuple[Array, Array, Array]:
        cost, hessian, gradient = normal_equations(residual, theta, samples, local, linearised)
        if penalty is None:
            return cost, hessian, gradient
        return (
            cost + penalty @ theta**2,
            hessian + jnp.diag(penalty),
            gradient + penalty * theta,
        )

    def validate(theta: Array, cost: Array) -> Array:
        if validation is None:
            return cost
        r = jax.vmap(residual, (None, 0))(theta, validation)
        return jnp.sum(r * r)

    def begin(theta: Array) -> _State:
        cost, hessian, gradient = equations(theta)
        scale = jnp.max(jnp.diag(hessian))
        valid = validate(theta, cost)
        finite = jnp.isfinite(cost) & jnp.isfinite(scale)
        history = jnp.full((options.max_trials, 2), jnp.nan)
        return _State(
            theta=theta,
            cost=cost,
            hessian=hessian,
            gradient=gradient,
            mu=options.tau * jnp.maximum(scale, 1e-300),
            nu=jnp.asarray(2.0),
            best=theta,
            best_cost=cost,
            best_validation=jnp.where(jnp.isfinite(valid), valid, jnp.inf),
            fails=jnp.asarray(0),
            stalls=jnp.asarray(0),
            trial=jnp.asarray(0),
            status=jnp.where(finite, -1, FAILED),
            history=history,
        )

    def trial(s: _State) -> _State:
        # a parameter that its bound holds back stays out, or the others' step would count on it
        held = (s.theta <= lower) & (s.gradient > 0) | (s.theta >= upper) & (s.gradient < 0)
        reduced = jnp.where(held[:, None] | held, 0.0, s.hessian)
        factor = jax.scipy.linalg.cho_factor(reduced + s.mu * jnp.eye(s.theta.size))
        step = jax.scipy.linalg.cho_solve(factor, s.gradient)
        theta = jnp.clip(s.theta - step, lower, upper)
        delta = theta - s.theta
        cost, hessian, gradient = equations(theta)
        # predicted reduction of c by the quadratic model, for the step really taken
        predicted = -(2 * s.gradient @ delta + delta @ s.hessian @ delta)
        ratio = (s.cost - cost) / predicted
        better = jnp.isfinite(cost) & jnp.all(jnp.isfinite(delta)) & (cost < s.cost)
        better &= jnp.all(jnp.isfinite(hessian))
        gain = jnp.clip(ratio, 0.0, 1e3)
        shrink = jnp.maximum(1 / 3, 1 - (2 * gain - 1) ** 3)
        valid = validate(theta, cost)
        improved = better & (valid < s.best_validation)
        small = (s.cost - cost) <= options.tolerance * s.cost
        stuck = jnp.max(jnp.abs(delta)) <= 1e-12 * (1 + jnp.max(jnp.abs(s.theta)))
        stalls = jnp.where(better & small, s.stalls + 1, jnp.where(better, 0, s.stalls))
        fails = jnp.where(improved, 0, jnp.where(better, s.fails + 1, s.fails))
        done = (stalls >= 2) | stuck | (s.mu > 1e16 * jnp.max(jnp.diag(s.hessian)))
        status = jnp.where(done, CONVERGED, -1)
        if validation is not None:
            status = jnp.where((status < 0) & (fails >= options.max_fail), VALIDATION_STOP, status)
        keep = lambda new, old: jnp.where(better, new, old)  # noqa: E731
        return _State(
            theta=keep(theta, s.theta),
            cost=keep(cost, s.cost),
            hessian=keep(hessian, s.hessian),
            gradient=keep(gradient, s.gradient),
            mu=keep(s.mu * shrink, s.mu * s.nu),
            nu=keep(2.0, s.nu * 2.0),
            best=jnp.where(improved, theta, s.best),
            best_cost=jnp.where(improved, cost, s.best_cost),
            best_validation=jnp.where(improved, valid, s.best_validation),
            fails=fails,
            stalls=stalls,
            trial=s.trial + 1,
            status=status,
            history=s.history.at[s.trial].set(
                jnp.stack([keep(cost, s.cost), keep(valid, jnp.nan)])
            ),
        )

    def run(theta: Array) -> _State:
        going = lambda s: (s.status < 0) & (s.trial < options.max_trials)  # noqa: E731
        return jax.lax.while_loop(going, trial, begin(theta))

    final = jax.lax.map(run, jnp.clip(starts, lower, upper), batch_size=options.batch)
    return Solution(
        theta=final.best,
        cost=final.best_cost,
        validation_cost=final.best_validation,
        status=jnp.where(final.status < 0, NOT_CONVERGED, final.status),
        trials=final.trial,
        history=final.history,
    )
