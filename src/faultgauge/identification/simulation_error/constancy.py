"""Whether constants are constant: what they would explain if they changed along the logs.

Let a parameter have a value of its own in every part of a window (a quarter of a run; a whole
window where a run is cut into many). With the Jacobian J of the errors r over all unknowns, o those
that were fitted and p these values,

    drop = s' (H_pp - H_po (H_oo + P)^-1 H_op)^+ s,   s = g_p - H_po (H_oo + P)^-1 g_o,

H = J J', g = J r and P the priors, is by how much r' r would fall to first order: the statistic of
the score test (C. R. Rao, 1948) before it is divided by the noise, which is not white here. A share
of r' r that is large without any noise to compare it with is what counts.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

__all__ = ["drops", "steps"]


def steps(
    length: int, parts: int, parameters: int
) -> Float[np.ndarray, "samples parts parameters"]:
    """What a value of its own in each part of a window adds to each parameter at each sample."""
    inside = np.arange(length)[:, None] * parts // length == np.arange(parts)
    return np.repeat(inside[..., None].astype(float), parameters, axis=2)


def drops(
    hessian: Float[np.ndarray, "n n"],
    inverse: Float[np.ndarray, "fitted fitted"],
    gradient: Float[np.ndarray, "n"],
    fitted: Int[np.ndarray, "fitted"],
    own: Sequence[Int[np.ndarray, "columns"]],
) -> Float[np.ndarray, "parameters"]:
    """The drop of r' r for each of the sets of columns `own`, with (H_oo + P)^-1 of those that are
    `fitted`. `gradient` holds the priors' part."""
    found = []
    for columns in own:
        across = hessian[np.ix_(fitted, columns)]
        score = gradient[columns] - across.T @ inverse @ gradient[fitted]
        left = hessian[np.ix_(columns, columns)] - across.T @ inverse @ across
        found.append(float(score @ np.linalg.pinv(left, rcond=1e-9, hermitian=True) @ score))
    return np.array(found)
