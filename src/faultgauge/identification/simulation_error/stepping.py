"""What the integration step adds to a fit's error."""

from dataclasses import replace

import numpy as np

from faultgauge.identification.simulation_error.candidate import Candidate
from faultgauge.identification.simulation_error.data import Data
from faultgauge.identification.simulation_error.window_fit import simulated

__all__ = ["fine_enough"]

MATTERS, MOST_SUBSTEPS = 0.05, 32  # of the fit's error: what halving the step may change


def fine_enough(data: Data, candidate: Candidate) -> bool:
    """Whether more substeps would change nothing that matters, or there are no more."""
    return data.substeps >= MOST_SUBSTEPS or step_error(data, candidate) <= MATTERS


def step_error(data: Data, candidate: Candidate) -> float:
    """What twice the substeps change in the simulated outputs, as a share of the fit's error."""
    fitted, found = candidate.fitted, []
    for factor in (1, 2):
        finer = replace(data, substeps=factor * data.substeps)
        windows = finer.windows(data.pieces)
        found.append(
            simulated(
                candidate.plant,
                candidate.unknowns,
                fitted.theta,
                fitted.z,
                windows,
                finer.substeps,
            )[1]
        )
    coarse, fine = found
    weighed = max(int(np.sum(windows.weight > 0)), 1)
    change = float(np.sqrt(np.sum((fine - coarse) ** 2) / weighed))
    return change / max(float(np.sqrt(fitted.mse)), 1e-12)
