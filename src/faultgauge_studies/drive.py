"""The demonstration: a real positioning drive, and a voltage pulse that is hidden from the model.

Data: EMPS, a DC motor with ball screw in closed loop, 1 kHz, measured (A. Janot, M. Gautier and
M. Brunot, "Data set and reference models of EMPS", 2019). In the second record a 5 V pulse is
added inside the loop every second; the model is given u = applied voltage - pulse, and the pulse
is what it must find. Where the files are absent a simulated drive of the same kind stands in.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.detection.answer.estimation import Estimated, estimate
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.calibration.calibration import Calibration, calibrate
from faultgauge.detection.decisions import Decision, decide_runs
from faultgauge.detection.rows.judged import Bank
from faultgauge.errors import InputError
from faultgauge.identification.fit import FitReport, fit
from faultgauge.identification.validation.evaluation import Prediction, evaluate
from faultgauge.plants.gray_box import load_plant
from faultgauge.plants.model import Model
from faultgauge.reporting.words.unjudged import unjudged_sentence
from faultgauge.telemetry import Run, read_telemetry
from faultgauge.verbs.checkup import parts
from faultgauge_studies import merit

__all__ = [
    "BODIES",
    "FAULT",
    "PULSE",
    "Drive",
    "DriveLogs",
    "measured_logs",
    "run_drive",
    "simulated_logs",
]

BODIES = {"physics": "positioning_drive", "network": "positioning_drive_network"}
FAULT = "pulse"
PULSE = 5.0  # V
SETTLED = 0.15  # s after an edge; the estimate is scored from there on
BAND = 0.05  # of the pulse: settled means inside
STEP = 1e-3
# The simulated drive's controller (1/s, V*s/m), screw ripple (N) and integration.
KP, KV, RIPPLE, SUBSTEPS = 160.18, 243.45, 3.0, 4


@dataclass(frozen=True)
class DriveLogs:
    """A healthy run, and a faulty one with its true pulse [V]; `source` is said to the user."""

    healthy: Run
    faulty: Run
    pulse: Float[np.ndarray, "samples"]
    source: str


@dataclass(frozen=True)
class Drive:
    """What one body of the plant (physics or network) made of the logs: decided by `bank`, and, for
    comparison, estimated by the ESO of `observers` alone."""

    whole: Model
    account: FitReport
    scores: dict[str, Any]
    predictions: list[Prediction]
    calibration: Calibration
    decision: Decision
    bank: FaultBank
    alone: Estimated
    observers: Bank
    figures: dict[str, float | int]


def measured_logs() -> DriveLogs | None:
    """The EMPS records, or None where they are absent (folder: FAULTGAUGE_DATA)."""
    folder = Path(os.environ.get("FAULTGAUGE_DATA", Path("..") / "shared" / "data")) / "emps"
    train, test = folder / "train_nominal.csv.gz", folder / "test_pulses.csv.gz"
    if not (train.is_file() and test.is_file()):
        return None
    healthy = read_telemetry(train, time="t_s", maps=["q=q_m", "u=v_V"], names=["q", "u"])[0]
    maps = ["q=q_m", "u=v_V - pulse_V", "pulse=pulse_V"]
    faulty = read_telemetry(test, time="t_s", maps=maps, names=["q", "u", "pulse"])[0]
    pulse = faulty.columns["pulse"]
    columns = {"q": faulty.columns["q"], "u": faulty.columns["u"]}
    return DriveLogs(healthy, replace(faulty, columns=columns), pulse, "measured (EMPS)")


def simulated_logs(seconds: float = 24.8) -> DriveLogs:
    """A simulated drive under a PD controller, with encoder noise; the same pulses.

    The plant has the preset's structure with constants near those of EMPS; the ripple of its
    screw stands for what neither body of the model knows.
    """
    plant = load_plant("positioning_drive")
    constants = {"M": 95.0, "Fv": 203.0, "Fc": 20.0, "offset": -3.2}
    values = {**plant.parameters, **{k: jnp.asarray(v) for k, v in constants.items()}}
    plant = eqx.tree_at(lambda p: p.parameters, plant, values)
    t = np.arange(0.0, seconds, STEP)
    pulse = np.where((t > 0.343) & ((t - 0.343) % 1.0 < 0.5), PULSE, 0.0)
    rng = np.random.default_rng(0)
    runs = []
    for name, extra in (("healthy", np.zeros_like(t)), ("faulty", pulse)):
        q, applied = _closed_loop(plant, t, extra)
        columns = {"q": q + 1e-7 * rng.standard_normal(len(t)), "u": applied}
        runs.append(Run(name, "simulated drive", t, columns))
    faulty = runs[1]
    columns = {"q": faulty.columns["q"], "u": faulty.columns["u"] - pulse}
    return DriveLogs(runs[0], replace(faulty, columns=columns), pulse, "simulated (no data files)")


def _closed_loop(
    plant: Any, t: Float[np.ndarray, "samples"], extra: Float[np.ndarray, "samples"]
) -> tuple[Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]]:
    """(position [m], applied voltage [V]) of the drive under its controller, sampled.

    u = kv (kp (reference - q) - v); the screw adds a force ripple over every 10 mm of travel.
    """
    p = {name: float(value) for name, value in plant.parameters.items()}
    reference = 0.12 * (1 - np.cos(2 * np.pi * t / 5.0)) * (1 + 0.2 * np.sin(2 * np.pi * t / 3.1))
    q = v = 0.0
    h = STEP / SUBSTEPS
    positions, applied = np.empty_like(t), np.empty_like(t)
    for k in range(len(t)):
        u = float(np.clip(KV * (KP * (reference[k] - q) - v) + extra[k], -10, 10))
        positions[k], applied[k] = q, u
        for _ in range(SUBSTEPS):
            friction = p["Fv"] * v + p["Fc"] * np.tanh(v / 1e-4) + p["offset"]
            ripple = RIPPLE * np.sin(2 * np.pi * q / 0.01)
            v += h * (p["gtau"] * u - friction - ripple) / p["M"]
            q += h * v
    return positions, applied


def run_drive(
    logs: DriveLogs,
    body: str,
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> Drive:
    """Everything about one body: free run on the faulty record, then the alarm chain.

    The free run is that of a model fitted on the whole healthy record, fed with what was really
    applied. For the alarms nothing is used twice: fitted on the first half of the healthy
    record, validated and calibrated on the third quarter, and tried on the last, which neither
    has seen, before the pulses are looked for. Raises `InputError` where the bank cannot be
    calibrated.
    """
    plant = load_plant(BODIES[body])
    whole, account = fit(plant, [logs.healthy], seed=seed, progress=progress)
    truth = {**logs.faulty.columns, "u": logs.faulty.columns["u"] + logs.pulse}
    applied = replace(logs.faulty, columns=truth)
    scores, predictions = evaluate(whole.plant, [applied], whole.max_step)
    first, third, last = parts([logs.healthy], 0.5, 0.75)
    model, _ = fit(plant, first, third, seed=seed, progress=progress)
    calibration = calibrate(model, third, progress=progress)
    (quiet, decision), bank = decide_runs(calibration.model, [*last, logs.faulty])
    if bank is None:
        raise InputError(unjudged_sentence(calibration.model))
    limited = calibrate(model, third, observer="eso", progress=progress).model
    (alone,), observers = estimate(limited, [logs.faulty])
    by_eso = estimate_figures(logs, alone.f[FAULT])
    figures = {
        "free_run_rmse_mm": 1e3 * (scores["outputs"]["q"]["rmse"] or np.inf),
        "events_on_held_out_nominal": merit.alarms(quiet.status),
        **pulse_figures(logs, decision.posterior.f[:, 0], decision.status),
        **{f"eso_{name}": value for name, value in by_eso.items()},
    }
    return Drive(
        whole, account, scores, predictions, calibration, decision, bank, alone, observers,
        figures,
    )  # fmt: skip


def pulse_figures(
    logs: DriveLogs, f: Float[np.ndarray, "samples"], status: Sequence[str]
) -> dict[str, float | int]:
    """How well the pulse was found: that of `estimate_figures`, and wrong half periods.

    A half period is wrong when any settled sample has the wrong status.
    """
    edges = merit.edges_of(logs.pulse)
    scored = merit.settled(logs.faulty.t, edges, SETTLED)
    right = merit.intervals_right(status, logs.pulse, edges, scored)
    return estimate_figures(logs, f) | {
        "half_periods": len(right),
        "half_periods_wrong": int(np.sum(~right)),
    }


def estimate_figures(logs: DriveLogs, f: Float[np.ndarray, "samples"]) -> dict[str, float]:
    """How well the pulse was estimated: error after settling, settling time."""
    t, pulse = logs.faulty.t, logs.pulse
    edges = merit.edges_of(pulse)
    scored = merit.settled(t, edges, SETTLED)
    judged = [bool(part.any()) for part in np.split(scored, edges)[1:]]
    times = merit.settling_times(t, f, pulse, edges, BAND)[judged]
    error = merit.rmse(f, pulse, scored)
    return {
        "pulse_rmse_v": error,
        "pulse_rmse_share": error / PULSE,
        "settling_median_s": float(np.median(times)),
        "settling_max_s": float(np.max(times)),
    }
