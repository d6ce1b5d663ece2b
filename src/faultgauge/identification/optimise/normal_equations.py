"""Normal equations of least squares with many samples and few unknowns.

    c = sum_k r_k(theta)^2,    H = J J',    g = J r

The Jacobian is built sample by sample, in reverse mode or, where one sample gives more equations
than there are unknowns, in forward mode, and stored as (parameters, equations * samples). Where
samples are `Means`, each of their points stands for a sample until the means are taken.

Where unknowns belong to one sample alone, theta = [shared, local of sample 1, local of sample 2,
...], and H is block diagonal but for the border of the shared ones.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.identification.optimise.means import means_of, points_of

__all__ = [
    "Linearised",
    "Residual",
    "bordered_equations",
    "forward",
    "normal_equations",
    "own",
    "shared",
]

Residual = Callable[[Float[Array, "parameters"], Any], Float[Array, "equations"]]
Linearised = Callable[
    [Float[Array, "own"], Any],
    tuple[Float[Array, "equations"], Float[Array, "equations own"]],
]


def normal_equations(
    residual: Residual, theta: Float[Array, "parameters"], samples: Any
) -> tuple[Float[Array, ""], Float[Array, "parameters parameters"], Float[Array, "parameters"]]:
    """(c, H, g)."""
    points = points_of(samples)

    def one(theta: Array, sample: Any) -> tuple[Array, Array]:
        r = residual(theta, sample)
        return r, r

    equations = jax.eval_shape(residual, theta, jax.tree.map(lambda a: a[0], points)).size
    if equations == 1:

        def scalar(theta: Array, sample: Any) -> Array:
            return residual(theta, sample)[0]

        r, J = jax.vmap(jax.value_and_grad(scalar), (None, 0), (0, -1))(theta, points)
    else:
        jacobian = jax.jacfwd if equations > theta.size else jax.jacrev
        J, r = jax.vmap(jacobian(one, has_aux=True), (None, 0), (-1, -1))(theta, points)
        J = jnp.moveaxis(J, 1, 0).reshape(theta.size, -1)
        r = r.reshape(-1)
    # One product gives all three; as a further row, r also keeps J stored row by row, which XLA
    # would otherwise turn round: a third of the time of a trial.
    rows = jnp.concatenate([J, r[None]]).reshape(theta.size + 1, equations, -1)
    rows = means_of(samples, rows).reshape(theta.size + 1, -1)
    products = rows @ rows.T
    return products[-1, -1], products[:-1, :-1], products[:-1, -1]


def forward(residual: Residual) -> Linearised:
    """(residual, Jacobian) in forward mode."""

    def one(theta: Array, sample: Any) -> tuple[Array, Array]:
        r = residual(theta, sample)
        return r, r

    jacobian = jax.jacfwd(one, has_aux=True)
    return lambda theta, sample: jacobian(theta, sample)[::-1]


def own(theta: Float[Array, "parameters"], samples: Any, local: int) -> Float[Array, "samples own"]:
    """[shared, local] as every sample sees it."""
    count = jax.tree.leaves(samples)[0].shape[0]
    common, locals_ = theta[: theta.size - count * local], theta[theta.size - count * local :]
    return jnp.concatenate(
        [jnp.broadcast_to(common, (count, common.size)), locals_.reshape(count, local)], axis=1
    )


def shared(each: Float[Array, "samples own"], local: int) -> Float[Array, "parameters"]:
    """The transpose of `own`: what every sample says, added up where they share."""
    common = each.shape[1] - local
    return jnp.concatenate([each[:, :common].sum(axis=0), each[:, common:].ravel()])


def bordered_equations(
    linearised: Linearised, theta: Float[Array, "parameters"], samples: Any, local: int
) -> tuple[
    Float[Array, ""],
    Float[Array, "parameters parameters"],
    Float[Array, "parameters"],
    Float[Array, "samples equations rows"],
]:
    """(c, H, g, [J, r] of every sample) with `local` unknowns to each sample; `linearised` gives
    (residual, Jacobian) of one."""
    r, J = jax.vmap(linearised)(own(theta, samples, local), samples)
    rows = jnp.concatenate([J, r[..., None]], axis=2)
    products = jnp.einsum("seo,sep->sop", rows, rows)
    common = J.shape[2] - local
    total = jnp.sum(products[:, :common], axis=0)
    square, border = products[:, common:-1, common:-1], products[:, :common, common:-1]
    locals_ = len(J) * local
    border = jnp.moveaxis(border, 0, 1).reshape(common, locals_)
    blocks = jnp.einsum("sab,st->satb", square, jnp.eye(len(J))).reshape(locals_, locals_)
    hessian = jnp.block([[total[:, :common], border], [border.T, blocks]])
    gradient = jnp.concatenate([total[:, -1], products[:, common:-1, -1].ravel()])
    return jnp.sum(products[:, -1, -1]), hessian, gradient, rows
