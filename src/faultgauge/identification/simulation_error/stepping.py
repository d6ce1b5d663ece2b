"""What the integration step adds to a fit's error."""

from dataclasses import replace

import numpy as np

from faultgauge.identification.simulation_error.candidate import Candidate
from faultgauge.identification.simulation_error.data import Data
from faultgauge.identification.simulation_error.window_fit import simulated
from faultgauge.simulation.free_run import fastest_rate

__all__ = ["fine_enough", "stable"]

MATTERS, MOST_SUBSTEPS = 0.05, 32  # of the fit's error: what halving the step may change
# Longest step of RK4 times the fastest rate: beyond 2.785 what fades grows (E. Hairer and G.
# Wanner, "Solving ODEs II", IV.2), and friction at a standstill chatters.
STABLE = 2.5
POINTS = 2000  # at which the rates are looked at


def fine_enough(data: Data, candidate: Candidate) -> bool:
    """Whether the steps are stable and more of them would change nothing that matters, or there are
    no more."""
    if data.substeps >= MOST_SUBSTEPS:
        return True
    return stable(data, candidate) and step_error(data, candidate) <= MATTERS


def stable(data: Data, candidate: Candidate) -> bool:
    """Whether what fades in the plant fades in its simulation, too: at the states as measured, as a
    simulation that chatters leaves those where it does."""
    pairs = zip(data.records, data.guesses, strict=True)
    x = np.concatenate([np.where(np.isfinite(r.x), r.x, guess) for r, guess in pairs])
    u = np.concatenate([record.u for record in data.records])
    sound = np.flatnonzero(np.all(np.isfinite(x), axis=1) & np.all(np.isfinite(u), axis=1))
    at = sound[np.linspace(0, len(sound) - 1, min(POINTS, len(sound))).astype(int)]
    step = max(record.step for record in data.records)
    return fastest_rate(candidate.assembled, x[at], u[at]) * step / data.substeps <= STABLE


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
