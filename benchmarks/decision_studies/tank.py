"""The README's tank: a model with an error of its own, fitted to one log, and a leak in another."""

from dataclasses import dataclass

import numpy as np

from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.decisions import decide_runs
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import load_plant
from faultgauge.telemetry import Run
from faultgauge_studies import merit

__all__ = ["Leak", "leak_found", "tank_log"]

LEAK, ONSET = -0.002, 4000.0  # m/s, s
STEP, SECONDS = 2.0, 7200.0  # s


@dataclass(frozen=True)
class Leak:
    """The last event of the leak: whether its 95 % interval holds the size, how the onset was told,
    half the size's interval over the truth, and the alarms before the onset."""

    sized: bool
    dated: merit.Dated | None
    width: float
    early: int


def tank_log(rng: np.random.Generator, leak: float) -> Run:
    """Two hours under a pump that is set anew every two minutes; as in the README."""
    t = np.arange(0.0, SECONDS, STEP)
    pump = np.repeat(rng.uniform(2.0, 8.0, 60), 60)
    level, x = np.empty_like(t), 1.0
    for k in range(len(t)):
        level[k] = x
        for _ in range(20):  # Euler at 0.1 s
            out = 0.04 * np.sqrt(max(x, 0.0)) - leak * (t[k] >= ONSET)
            x = max(x + 0.1 * (0.01 * pump[k] - out), 0.0)
    level += rng.normal(0.0, 0.002, len(t))
    return Run("leak" if leak else "healthy", "tank", t, {"u": pump, "level": level})


def leak_found(seed: int) -> Leak | None:
    """One tank; None where the leak was not named."""
    rng = np.random.default_rng(seed)
    healthy, suspect = tank_log(rng, 0.0), tank_log(rng, LEAK)
    model = calibrate(fit(load_plant("tank"), [healthy])[0], [healthy]).model
    (decision,), _ = decide_runs(model, [suspect])
    events = [e for e in decision.events if e.fault == "leak"]
    late = [e for e in events if e.end >= ONSET]
    if not late:
        return None
    lo, hi = (float(value) for value in (late[-1].lo, late[-1].hi) if value is not None)
    return Leak(
        sized=lo <= LEAK <= hi,
        dated=merit.dated(events, "leak", ONSET),
        width=(hi - lo) / 2 / abs(LEAK),
        early=sum(e.start < ONSET for e in decision.events),
    )
