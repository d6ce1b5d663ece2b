"""Gradient descent with momentum and an adaptive learning rate: the peer of Levenberg-Marquardt.

    step  <-  m step - (1 - m) lr dc/dtheta,    c(theta) = mean of r_k(theta)^2

T. P. Vogl et al., "Accelerating the convergence of the back-propagation method", Biological
Cybernetics 59 (1988): a step that raises the cost by more than a few per cent is taken back, the
learning rate falls and the momentum is dropped; one that lowers the cost lets the rate grow. The
constants are those in common use. As rises within the allowance are kept, theta swings about a
minimum whose cost is not zero; the best point seen is what is returned. Every start is
a program of its own in one compiled loop.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.identification.optimise.levenberg_marquardt import (
    CONVERGED,
    FAILED,
    NOT_CONVERGED,
    VALIDATION_STOP,
    Residual,
    Solution,
)
from faultgauge.identification.optimise.means import means_of, points_of
from faultgauge.programs import program

__all__ = ["DescentOptions", "gradient_descent"]


class DescentOptions(NamedTuple):
    """Limits and rates of one descent, for residuals of order one.

    `max_fail` counts epochs without a better validation cost: the same share of the cap as for
    Levenberg-Marquardt, because momentum swings past a good point for many epochs in a row. A
    start has converged when no component of the projected gradient of c exceeds `min_gradient`.
    """

    max_epochs: int = 5000
    max_fail: int = 100
    momentum: float = 0.9
    rate: float = 0.01
    rate_growth: float = 1.05
    rate_cut: float = 0.7
    max_increase: float = 1.04
    min_gradient: float = 1e-5


DEFAULTS = DescentOptions()


class _State(NamedTuple):
    theta: Array
    cost: Array
    gradient: Array
    step: Array
    rate: Array
    best: Array
    best_cost: Array
    best_validation: Array
    fails: Array
    epoch: Array
    status: Array
    history: Array


class _Descent(NamedTuple):
    """What is minimised, and the way from one epoch to the next."""

    residual: Residual
    samples: Any
    validation: Any | None
    lower: Array
    upper: Array
    options: DescentOptions

    def squares(self, theta: Array, data: Any) -> Array:
        return means_of(data, jax.vmap(self.residual, (None, 0))(theta, points_of(data)).T) ** 2

    def size(self, theta: Array) -> int:
        return jax.eval_shape(self.squares, theta, self.samples).size

    def mean_and_gradient(self, theta: Array) -> tuple[Array, Array]:
        return jax.value_and_grad(lambda theta: jnp.mean(self.squares(theta, self.samples)))(theta)

    def validate(self, theta: Array, cost: Array) -> Array:
        if self.validation is None:
            return self.size(theta) * cost
        return jnp.sum(self.squares(theta, self.validation))

    def settled(self, theta: Array, gradient: Array) -> Array:
        free = theta - jnp.clip(theta - gradient, self.lower, self.upper)
        return jnp.max(jnp.abs(free)) <= self.options.min_gradient

    def begin(self, theta: Array) -> _State:
        options = self.options
        cost, gradient = self.mean_and_gradient(theta)
        valid = self.validate(theta, cost)
        finite = jnp.isfinite(cost) & jnp.all(jnp.isfinite(gradient))
        going = jnp.where(self.settled(theta, gradient), CONVERGED, -1)
        return _State(
            theta=theta,
            cost=cost,
            gradient=gradient,
            step=-options.rate * gradient,
            rate=jnp.asarray(options.rate),
            best=theta,
            best_cost=cost,
            best_validation=jnp.where(jnp.isfinite(valid), valid, jnp.inf),
            fails=jnp.asarray(0),
            epoch=jnp.asarray(0),
            status=jnp.where(finite, going, FAILED),
            history=jnp.full((options.max_epochs, 2), jnp.nan),
        )

    def epoch(self, s: _State) -> _State:
        options, m = self.options, self.options.momentum
        moved = s.theta + m * s.step - (1 - m) * s.rate * s.gradient
        theta = jnp.clip(moved, self.lower, self.upper)
        cost, gradient = self.mean_and_gradient(theta)
        taken = jnp.all(jnp.isfinite(gradient)) & (cost <= options.max_increase * s.cost)
        growth = jnp.where(cost < s.cost, options.rate_growth, 1.0)
        rate = s.rate * jnp.where(taken, growth, options.rate_cut)
        valid = self.validate(theta, cost)
        improved = taken & (valid < s.best_validation)
        fails = jnp.where(improved, 0, s.fails + taken)
        status = jnp.where(taken & self.settled(theta, gradient), CONVERGED, -1)
        if self.validation is not None:
            status = jnp.where((status < 0) & (fails >= options.max_fail), VALIDATION_STOP, status)
        keep = lambda new, old: jnp.where(taken, new, old)  # noqa: E731
        costs = jnp.stack([self.size(theta) * keep(cost, s.cost), keep(valid, jnp.nan)])
        return _State(
            theta=keep(theta, s.theta),
            cost=keep(cost, s.cost),
            gradient=keep(gradient, s.gradient),
            # after a refusal the next step is a plain gradient step
            step=keep(theta - s.theta, -rate * s.gradient),
            rate=rate,
            best=jnp.where(improved, theta, s.best),
            best_cost=jnp.where(improved, cost, s.best_cost),
            best_validation=jnp.where(improved, valid, s.best_validation),
            fails=fails,
            epoch=s.epoch + 1,
            status=status,
            history=s.history.at[s.epoch].set(costs),
        )


@program
def gradient_descent(
    residual: Residual,
    starts: Float[Array, "starts parameters"],
    samples: Any,
    validation: Any | None,
    lower: Float[Array, "parameters"],
    upper: Float[Array, "parameters"],
    options: DescentOptions = DEFAULTS,
) -> Solution:
    """Fit from every start, full batch; arguments and result as `levenberg_marquardt` has them.

    Costs in the `Solution` are sums of squares, a trial is an epoch. The parameters of the lowest
    validation cost (without `validation`: the lowest cost) are returned. Steps are projected on
    [lower, upper], and momentum is what was really moved, so none gathers behind a bound.
    """
    descent = _Descent(residual, samples, validation, lower, upper, options)
    size = descent.size(starts[0])

    def run(theta: Array) -> _State:
        going = lambda s: (s.status < 0) & (s.epoch < options.max_epochs)  # noqa: E731
        return jax.lax.while_loop(going, descent.epoch, descent.begin(theta))

    final = jax.lax.map(run, jnp.clip(starts, lower, upper))
    return Solution(
        theta=final.best,
        cost=size * final.best_cost,
        validation_cost=final.best_validation,
        status=jnp.where(final.status < 0, NOT_CONVERGED, final.status),
        trials=final.epoch,
        history=final.history,
    )
