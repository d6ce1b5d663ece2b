"""The measured quarter drone, healthy: each of its six runs judged by what the other five taught.

Of the five, the first half of each is fitted on, the next tenth stops the fit, and the rest
calibrates, so the judged run is new to the model, to its noise and to its limits.
"""

from dataclasses import dataclass
from pathlib import Path

from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.decisions import Decision, decide_runs
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import load_plant
from faultgauge.telemetry import Run
from faultgauge.verbs.checkup import parts
from faultgauge_studies import merit
from faultgauge_studies.published.data import quarter_drone

__all__ = ["Judged", "healthy_runs", "left_out"]

PLANT = Path(__file__).parent / "quarter_drone.toml"
SHARES = (0.5, 0.6)  # of each of the five runs


@dataclass(frozen=True)
class Judged:
    """A healthy run that was left out: samples by status, its alarms, and how long it is [s]."""

    decision: Decision
    statuses: dict[str, int]
    alarms: int
    seconds: float
    warnings: tuple[str, ...]


def healthy_runs() -> dict[str, Run]:
    """The six runs. Raises `InputError` where they are absent (folder: FAULTGAUGE_DATA)."""
    records = quarter_drone()
    return {name: each.run(name, "quarter drone", "theta") for name, each in records.items()}


def left_out(runs: dict[str, Run], name: str, seed: int = 0) -> Judged:
    """The run `name`, judged by the others."""
    others = [run for each, run in runs.items() if each != name]
    first, stop, rest = parts(others, *SHARES)
    model, _ = fit(load_plant(PLANT), first, stop, seed=seed)
    calibration = calibrate(model, rest)
    decision = decide_runs(calibration.model, [runs[name]])[0][0]
    said = {each: decision.status.count(each) for each in dict.fromkeys(decision.status)}
    run = runs[name]
    seconds = float(run.t[-1] - run.t[0])
    found = merit.alarms(decision.status)
    return Judged(decision, said, found, seconds, tuple(calibration.warnings))
