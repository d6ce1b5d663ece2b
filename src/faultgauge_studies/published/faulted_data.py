"""The two public sets with real faults, as runs: CrazyPAD's flights and SKAB's water loop."""

import csv
import gzip
import os
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from faultgauge.errors import InputError
from faultgauge.telemetry import Run, read_telemetry
from faultgauge.telemetry.clock import Clock

__all__ = ["SENSORS", "Experiment", "flights", "healthy_loop", "water_loop"]

FLIGHT = ("m1", "m2", "m3", "m4", "p", "q", "r", "az")
SENSORS = {  # our name of each sensor, and SKAB's
    "acc1": "Accelerometer1RMS",
    "acc2": "Accelerometer2RMS",
    "current": "Current",
    "pressure": "Pressure",
    "temperature": "Temperature",
    "thermocouple": "Thermocouple",
    "voltage": "Voltage",
    "flow": "Volume Flow RateRMS",
}
PARTS = ("valve1", "valve2", "other")


class Experiment(NamedTuple):
    """One file of SKAB: its sensors, and which rows its authors call anomalous."""

    run: Run
    anomalous: Bool[np.ndarray, "rows"]


def flights() -> dict[str, Run]:
    """CrazyPAD's flights of vehicle E8 by name, the rows in hover: commands m1 to m4, body rates
    [rad/s], specific force [g]. Raises `InputError` where they are absent."""
    found = {}
    for path in _files("crazypad", "*.csv.gz"):
        name = path.name.removesuffix(".csv.gz")
        (run,) = read_telemetry(path, time="t", names=FLIGHT, where="hover == 1")
        found[name] = Run(name, run.source, run.t, run.columns)
    return found


def water_loop() -> dict[str, Experiment]:
    """SKAB's 34 experiments by name, as `valve1/0`; about 1 Hz. Raises `InputError` where they are
    absent or not as its authors export them."""
    paths = [path for part in PARTS for path in _files("skab", f"{part}/*.csv.gz")]
    named = {f"{path.parent.name}/{path.name.removesuffix('.csv.gz')}": path for path in paths}
    return {name: _experiment(name, path) for name, path in named.items()}


def healthy_loop() -> Run:
    """SKAB's record without anomalies, some hours at about 1 Hz; refusals as of `water_loop`."""
    (path,) = _files("skab", "anomaly-free/*.csv.gz")
    run, _ = _sensors("anomaly-free", path)
    return run


def _experiment(name: str, path: Path) -> Experiment:
    run, rows = _sensors(name, path)
    try:
        return Experiment(run, np.array([float(row["anomaly"]) > 0 for row in rows]))
    except (KeyError, ValueError):
        raise _not_as_exported(path) from None


def _sensors(name: str, path: Path) -> tuple[Run, list[dict[str, str]]]:
    """The run of a file, and its rows."""
    try:
        with gzip.open(path, "rt", newline="") as text:
            rows = list(csv.DictReader(text, delimiter=";"))
        clock = [datetime.fromisoformat(row["datetime"]) for row in rows]
        t = np.array([(each - clock[0]).total_seconds() for each in clock])
        columns = {
            ours: np.array([float(row[its]) for row in rows]) for ours, its in SENSORS.items()
        }
    except (OSError, KeyError, ValueError, IndexError):
        raise _not_as_exported(path) from None
    return Run(name, str(path), t, columns, clock=Clock(clock[0])), rows


def _not_as_exported(path: Path) -> InputError:
    return InputError(
        f"{path}: not as SKAB exports it (semicolons, datetime, eight sensors, anomaly); fetch the "
        "file anew."
    )


def _files(folder: str, pattern: str) -> list[Path]:
    """The files of a set, by name; `InputError` that says where to put them."""
    root = Path(os.environ.get("FAULTGAUGE_DATA", Path("..") / "shared" / "data"))
    found = sorted((root / folder).glob(pattern))
    if not found:
        raise InputError(
            f"{root / folder / pattern}: the records of this benchmark are absent; set "
            f"FAULTGAUGE_DATA to the folder that holds {folder}/."
        )
    return found
