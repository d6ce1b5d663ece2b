"""The first fits: from several starts over short windows, each with a start of its own."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from faultgauge.identification.simulation_error.data import FIRST_SIGMA, Data
from faultgauge.identification.simulation_error.records import Piece
from faultgauge.identification.simulation_error.window_fit import Fitted
from faultgauge.identification.unknowns import Unknowns
from faultgauge.plants.gray_box import GrayBoxPlant

__all__ = ["around", "over_short_windows"]

SCATTER = 0.5  # prior standard deviations: a factor of 3 for positive constants
HEAT_TRIALS, MORE_TRIALS, FAVOURITES = 10, 30, 5  # of every start, and of how many that go on


def around(
    first: Float[np.ndarray, "parameters"], seed: int, k: int
) -> Float[np.ndarray, "parameters"]:
    """The k-th start of parameters around `first`."""
    return first + SCATTER * np.random.default_rng([seed, 7, k]).standard_normal(len(first))


def over_short_windows(
    data: Data,
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    thetas: Sequence[Float[np.ndarray, "unknowns"]],
    short: Sequence[Piece],
) -> tuple[list[Fitted], int]:
    """(fits, best first; number of starts without a finite error): a heat of all, then the best.

    A parameter has one value for all windows here: with one to each, they would explain anything.
    """
    found: list[Fitted] = []
    common, data = replace(unknowns, varying=(), slow=()), replace(data, drift=data.drift.none())
    failed = 0
    for trials in (HEAT_TRIALS, MORE_TRIALS):
        fits = data.fit(
            plant,
            common,
            np.stack([each.theta for each in found] or thetas),
            pieces=short,
            after=found,
            sigma=FIRST_SIGMA,
            trials=trials,
        )
        failed += sum(not each.usable for each in fits)
        found = sorted((each for each in fits if each.usable), key=lambda each: each.mse)
        found = found[:FAVOURITES]
        if not found:
            break
    return found, failed
