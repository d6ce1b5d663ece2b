"""A linear plant with Gaussian noise, where the Kalman filter is optimal: bank against filter.

dx = -a x + b u + f + w,   y = x + v,   f = 0 before its onset, then a step and a random walk.
"""

from dataclasses import dataclass, replace

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from decision_studies.rig import true_model
from faultgauge.detection.bank.bank import FaultBank, build_fault_bank
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.decisions import decide
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from faultgauge_studies import merit

__all__ = ["Errors", "against_kalman", "linear_bank"]

PLANT = """
name = "first-order lag"
[states.x]
derivative = "-0.1*x + 0.2*u"
[inputs.u]
hold = "zero"
[outputs.x]
value = "x"
[faults.f]
enters = "state"
target = "x"
"""
A, B, STEP = 0.1, 0.2, 0.5
PROCESS, SIGMA, WALK = 0.01, 0.1, 0.002  # per sqrt(s), per sample, per sqrt(s)
SAMPLES, ONSET, SETTLED = 3000, 1000, 200
SIZE = 0.2


@dataclass(frozen=True)
class Errors:
    """RMSE of the fault from 200 samples after its onset, and the share of them inside the bank's
    95 % interval; `delay` [s] until the fault is named, and how its onset was told."""

    bank: float
    kalman: float
    coverage: float
    delay: float
    dated: merit.Dated | None


def linear_bank(walk: float | None = WALK) -> FaultBank:
    """The bank with the noise levels that the filter knows too, the fault walking by `walk` per
    sqrt(s); None: as for a plant file that declares no rate."""
    run = _record(0, 0.0)[0]
    model = true_model(GrayBoxPlant.untrained(parse_plant(PLANT)), [run])
    nothing, soon = np.array([1e-9]), np.array([10 * STEP])
    none = np.zeros(0)
    noise = Noise(
        np.array([SIGMA]), np.array([PROCESS]), none, nothing, soon, nothing, soon,
        none, none,
    )  # fmt: skip
    bank = build_fault_bank(model, [run], noise)
    if walk is None:
        return bank
    walks = bank.modes.noise.walk.at[:, 0].set(walk)
    return replace(bank, modes=eqx.tree_at(lambda m: m.noise.walk, bank.modes, walks))


def against_kalman(bank: FaultBank, seed: int) -> Errors:
    """One record, both estimates."""
    run, f = _record(seed, SIZE * (-1.0) ** seed)
    decision = decide(bank, run)
    found = decision.posterior
    late = np.arange(len(f)) >= ONSET + SETTLED
    told = [event.start for event in decision.events if event.fault == "f"]
    return Errors(
        merit.rmse(found.f[:, 0], f, late),
        merit.rmse(_kalman(run), f, late),
        merit.coverage(found.lo[:, 0], found.hi[:, 0], f, late),
        merit.found_after(told, ONSET * STEP),
        merit.dated(decision.events, "f", ONSET * STEP),
    )


def _record(seed: int, size: float) -> tuple[Run, Float[np.ndarray, "samples"]]:
    rng = np.random.default_rng([seed, 7])
    u = np.repeat(rng.uniform(-1, 1, SAMPLES // 50), 50)
    f = np.zeros(SAMPLES)
    steps = WALK * np.sqrt(STEP) * rng.standard_normal(SAMPLES - ONSET)
    f[ONSET:] = (size + np.cumsum(steps)) if size else 0.0
    x = np.zeros(SAMPLES)
    fade, gain = np.exp(-A * STEP), (1 - np.exp(-A * STEP)) / A
    w = PROCESS * np.sqrt(STEP) * rng.standard_normal(SAMPLES)
    for k in range(SAMPLES - 1):
        x[k + 1] = fade * x[k] + gain * (B * u[k] + f[k]) + w[k]
    y = x + SIGMA * rng.standard_normal(SAMPLES)
    run = Run(f"{seed}", "linear", STEP * np.arange(SAMPLES), {"u": u, "x": y})
    return run, f


def _kalman(run: Run) -> Float[np.ndarray, "samples"]:
    """The steady-state Kalman filter of [x, f] with the true noise levels; NumPy and SciPy."""
    fade, gain = np.exp(-A * STEP), (1 - np.exp(-A * STEP)) / A
    F, H = np.array([[fade, gain], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    Q = STEP * np.diag([PROCESS**2, WALK**2])
    P = solve_discrete_are(F.T, H.T, Q, np.array([[SIGMA**2]]))
    K = (P @ H.T / (H @ P @ H.T + SIGMA**2))[:, 0]
    z, found = np.zeros(2), np.zeros(len(run.t))
    u, y = run.columns["u"], run.columns["x"]
    for k in range(len(y)):
        if k:
            z = F @ z + np.array([gain * B * u[k - 1], 0.0])
        z = z + K * (y[k] - z[0])
        found[k] = z[1]
    return found
