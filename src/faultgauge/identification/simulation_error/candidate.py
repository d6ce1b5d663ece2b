"""A fitted plant among others, and what it is worth on samples that no fit has seen."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.identification.simulation_error.claims import Claims
from faultgauge.identification.simulation_error.data import (
    FIRST_SIGMA,
    Data,
    unseen_errors,
    validation_error,
)
from faultgauge.identification.simulation_error.records import Piece
from faultgauge.identification.simulation_error.window_fit import Fitted, Ridge
from faultgauge.identification.unknowns import Unknowns
from faultgauge.plants.gray_box import GrayBoxPlant

__all__ = [
    "WARM",
    "Candidate",
    "few_starts",
    "fitted_again",
    "sample_count",
    "sigma_of",
    "validated",
]

LEAST_SIGMA = 1e-4  # of the outputs' spread
WARM = "warm start"


@dataclass(frozen=True)
class Candidate:
    """A fitted plant, how it came about, and its free-run error on unseen samples (a share of
    the outputs' spread): RMS, and sample by sample; what its networks leave to the physics. The fit
    weighs its networks' weights theta with ridge s^2 |theta|^2, s its own error, `sigma_of`."""

    plant: GrayBoxPlant
    unknowns: Unknowns
    fitted: Fitted
    validation: float
    origin: str
    ridge: Ridge = 1.0
    unseen: Float[np.ndarray, "samples"] = field(default_factory=lambda: np.zeros(0))
    claims: Claims | None = None

    @property
    def assembled(self) -> GrayBoxPlant:
        """The plant with what was fitted."""
        return self.unknowns.assemble(self.plant, jnp.asarray(self.fitted.theta))


def sigma_of(fitted: Fitted) -> float:
    """What residuals count in a fit that goes on from `fitted`: their own size, within limits."""
    return float(np.clip(np.sqrt(fitted.mse), LEAST_SIGMA, FIRST_SIGMA))


def sample_count(pieces: Sequence[Piece]) -> int:
    """Samples in all `pieces`."""
    return sum(piece.stop - piece.start for piece in pieces)


def fitted_again(data: Data, candidate: Candidate, ridge: Ridge, trials: int) -> Candidate:
    """The candidate fitted on from where it stands, over the same pieces; not validated."""
    fitted = data.fit(
        candidate.plant,
        candidate.unknowns,
        candidate.fitted.theta[None],
        after=[candidate.fitted],
        sigma=sigma_of(candidate.fitted),
        ridge=ridge,
        trials=trials,
        claims=candidate.claims,
    )[0]
    return replace(candidate, fitted=fitted, ridge=ridge)


def few_starts(what: str, lost: int, count: int) -> list[str]:
    """What to say where most of `count` starts of `what` have no finite error; a few that are lost
    are no matter: the best start is kept."""
    if 2 * lost <= count:
        return []
    return [
        f"{what}: in {lost} of {count} starts the simulation has no finite error, which leaves few "
        "or none to choose from; look for a wrong sign, or a root, log or division that leaves its "
        "domain, in the plant file, and give values to start from, with min and max"
    ]


def validated(data: Data, candidate: Candidate) -> Candidate:
    """`candidate` with its error on what no fit has seen; infinite where the fit is of no use."""
    plant, unknowns, fitted = candidate.plant, candidate.unknowns, candidate.fitted
    if not fitted.usable:
        return replace(candidate, validation=np.inf)
    unseen = unseen_errors(data, plant, unknowns, fitted)
    return replace(candidate, validation=validation_error(data, fitted, unseen), unseen=unseen)
