"""How much of the error is the luck of the seed: free runs of models fitted with several seeds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

__all__ = ["SeedSpread", "seed_spread"]


@dataclass(frozen=True)
class SeedSpread:
    """Free runs of models that differ in their seed only; the model itself comes first.

    Attributes:
        rmse: of each model, the output's unit; NaN where it diverges.
        spread: standard deviation over the models that do not, root mean square over samples.
        explained: share of their mean square error that differs between them; the rest is common
            to all: bias, missing dynamics and measurement noise.
    """

    rmse: Float[np.ndarray, "models"]
    spread: float
    explained: float


def seed_spread(
    measured: Float[np.ndarray, "samples"], predicted: Sequence[Float[np.ndarray, "samples"]]
) -> SeedSpread | None:
    """Spread of the predictions of several models, with

        mean_m e_m(t)**2 = (mean_m e_m(t))**2 + var_m yhat_m(t)

    summed over t. None where fewer than two models stay finite.
    """
    errors = measured - np.stack(list(predicted))
    with np.errstate(over="ignore", invalid="ignore"):
        mean_square = np.mean(errors**2, axis=1)
    good = np.isfinite(mean_square)
    count = int(np.sum(good))
    if count < 2:
        return None
    varying = float(np.mean(np.var(errors[good], axis=0)))
    total = float(np.mean(mean_square[good]))
    return SeedSpread(
        rmse=np.sqrt(np.where(good, mean_square, np.nan)),
        spread=float(np.sqrt(varying * count / (count - 1))),
        explained=varying / total if total > 0 else 0.0,
    )
