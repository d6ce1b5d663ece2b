"""`estimate --smooth` against the Cramer-Rao bound of a constant fault whose onset is unknown.

With y ~ N(m(c), R), c = (size, onset, first state),

    cov c >= (M^T R^-1 M)^-1,   M = dm/dc

(Van Trees, "Detection, Estimation, and Modulation Theory", 2.4.3). M and R are written out here in
NumPy, apart from the code that is measured. A fault in a state bends the output and does not make
it jump, so m is smooth in the onset and the bound exists.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from decision_studies import optimal
from decision_studies.wheel import base_flight
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import decide
from faultgauge.detection.onset.retrospective import Retrospect, retrospect
from faultgauge.simulation.run_scenario import simulate
from faultgauge.simulation.schedules import Constant, Schedule
from faultgauge.telemetry import Run
from faultgauge_studies import merit

__all__ = ["Hindsight", "linear_hindsight", "wheel_hindsight"]

SAMPLES = 1500  # of a linear record
NOISE = 0.05  # N*m*s


@dataclass(frozen=True)
class Hindsight:
    """One record: the error of the size over the bound's standard deviation, with the onset
    unknown (`error`) and, of the estimate that is told the onset over the bound of that problem,
    known (`told_onset`); the error of the onset [s] and whether the 95 %
    intervals hold; NaN and False where the fault was not named. `online` is the error of the
    bank's last estimate of the size over the same bound, `delay` [s] of being told."""

    named: bool
    error: float
    told_onset: float
    onset_error: float
    size_covered: bool
    onset_covered: bool
    online: float
    delay: float


def linear_hindsight(bank: FaultBank, seed: int) -> Hindsight:
    """The first-order lag: a fault of 0.02 to 0.2 of either sign, from anywhere in the middle half
    on, between samples too."""
    rng = np.random.default_rng([seed, 11])
    size = float(rng.choice([-1.0, 1.0]) * 10 ** rng.uniform(-1.7, -0.7))
    end = SAMPLES * optimal.STEP
    onset = float(rng.uniform(0.25, 0.75) * end)
    t = optimal.STEP * np.arange(SAMPLES)
    u = np.repeat(rng.uniform(-1, 1, SAMPLES // 50), 50)
    a, step = optimal.A, optimal.STEP
    fade, gain = np.exp(-a * step), (1 - np.exp(-a * step)) / a
    x = size * _bend(t - onset)
    driven = np.zeros(SAMPLES)
    w = optimal.PROCESS * np.sqrt(step) * rng.standard_normal(SAMPLES)
    for k in range(SAMPLES - 1):
        driven[k + 1] = fade * driven[k] + gain * optimal.B * u[k] + w[k]
    y = x + driven + optimal.SIGMA * rng.standard_normal(SAMPLES)
    run = Run(f"{seed}", "linear", t, {"u": u, "x": y})
    lag = np.subtract.outer(np.arange(SAMPLES), np.arange(1, SAMPLES))
    spread = np.where(lag >= 0, fade ** np.maximum(lag, 0), 0.0)
    R = optimal.PROCESS**2 * step * spread @ spread.T + optimal.SIGMA**2 * np.eye(SAMPLES)
    since = np.maximum(t - onset, 0.0)
    M = np.stack([_bend(t - onset), -size * (since > 0) * np.exp(-a * since), np.exp(-a * t)], 1)
    return _scored(bank, run, "f", size, onset, M.T @ np.linalg.solve(R, M))


def _bend(since: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "samples"]:
    """The lag's answer to a unit step of the fault."""
    return -np.expm1(-optimal.A * np.maximum(since, 0.0)) / optimal.A


def wheel_hindsight(bank: FaultBank, seed: int) -> Hindsight:
    """The paper's wheel on its flight: friction of 0.01 to 0.1 N*m from a sample between 250 and
    750 s on. The bound knows of the noise alone, not of the inner disturbance."""
    rng = np.random.default_rng([seed, 12])
    size, onset = float(10 ** rng.uniform(-2, -1)), 0.25 * float(rng.integers(1000, 3000))
    fault = Schedule("friction", "state", "h", Constant(size, onset))
    run = simulate(replace(base_flight(), seed=seed, faults=(fault,)))
    slope = _slope(run.columns["hm"])  # its noise, 0.06 rad/s, is small beside w_0 and w_st
    M = np.zeros((len(run.t), 3))
    M[0, 2] = 1.0
    for k in range(1, len(run.t)):
        dt = run.t[k] - run.t[k - 1]
        fade = np.exp(slope[k - 1] * dt)
        begun = run.t[k - 1] >= onset
        M[k] = fade * M[k - 1] + np.array([dt if begun else 0.0, 0.0, 0.0])
        if begun and run.t[k - 2] < onset:
            M[k, 1] = -size
    seen = Run(run.name, "flight", run.t, {name: run.columns[name] for name in ("u", "hm")})
    return _scored(bank, seen, "friction", size, onset, M.T @ M / NOISE**2)


def _slope(h: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "samples"]:
    """d(dh/dt)/dh of the wheel's friction at momentum h [1/s]; the published parameters."""
    J, viscous, coulomb, stick, w_st, w_0 = 0.84, 2.5e-4, 0.03, 0.037, 5.0, 1.0

    def friction(h: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "samples"]:
        w = h / J
        return viscous * w + (coulomb + (stick - coulomb) * np.exp(-((w / w_st) ** 2))) * np.tanh(
            w / w_0
        )

    return -(friction(h + 1e-4) - friction(h - 1e-4)) / 2e-4


def _scored(
    bank: FaultBank,
    run: Run,
    fault: str,
    size: float,
    onset: float,
    fisher: Float[np.ndarray, "three three"],
) -> Hindsight:
    bound = float(np.sqrt(np.linalg.inv(fisher)[0, 0]))
    known = float(np.sqrt(np.linalg.inv(fisher[np.ix_([0, 2], [0, 2])])[0, 0]))
    decision = decide(bank, run)
    found = [each for each in retrospect(bank, decision) if each.cause == fault]
    k = bank.model.plant.signals.fault_names.index(fault)
    online = float(decision.posterior.f[-1, k] - size) / bound
    told = [e.start for e in decision.events if e.fault == fault]
    delay = merit.found_after(told, onset)
    if len(found) != 1:
        return Hindsight(False, np.nan, np.nan, np.nan, False, False, online, delay)
    at, low, high, since, first, last = _figures(found[0])
    t, given = found[0].t, found[0].given
    told_size = float(np.interp(onset, t[:-1], given[1:]))  # what acts from sample n - 1 on
    return Hindsight(
        True,
        (at - size) / bound,
        (told_size - size) / known,
        since - onset,
        low <= size <= high,
        first <= onset <= last,
        online,
        delay,
    )


def _figures(found: Retrospect) -> tuple[float, ...]:
    values = (found.size, found.lo, found.hi, found.onset, found.onset_lo, found.onset_hi)
    return tuple(float(value) for value in values if value is not None)
