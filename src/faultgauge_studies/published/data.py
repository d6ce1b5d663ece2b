"""Where the records of the public benchmarks come from: their own loader, or a folder."""

import contextlib
import os
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.telemetry import Run, read_telemetry

__all__ = ["Record", "emps", "quarter_drone", "silverbox", "tanks", "wiener_hammerstein"]

PATIENCE = 5.0  # s until a download counts as impossible
HOSTS = {
    "EMPS": "drive.google.com",
    "Silverbox": "drive.google.com",
    "Cascaded_Tanks": "data.4tu.nl",
    "WienerHammerBenchMark": "www.ee.kth.se",
}
DRONE = {  # file of each run, without .csv.gz, and its time column
    "semi_static": ("sinal1_semi_estatica_malha_fechada", "t_s"),
    "steps": ("sinal2_degraus_malha_fechada", "t_s"),
    "swept_sine": ("sinal3_swept_sine_malha_fechada", "t_s"),
    "multisine": ("sinal4_multiseno_malha_fechada", "t_s"),
    "rig": ("dados_14_drone", "t_ms/1000"),
    "rig_sequence": ("14_drone_seq_20260529_195254", "t_ms/1000"),
}
DRONE_STEP = 0.01  # s


class Record(NamedTuple):
    """One uniformly sampled recording: step [s], input and output in the units of the set."""

    step: float
    u: Float[np.ndarray, "samples"]
    y: Float[np.ndarray, "samples"]

    def part(self, start: int, stop: int) -> "Record":
        return Record(self.step, self.u[start:stop], self.y[start:stop])

    def run(self, name: str, source: str, output: str) -> Run:
        """As a `Run` with columns `u` and `output`, time from zero."""
        return Run(name, source, self.step * np.arange(len(self.u)), {"u": self.u, output: self.y})


def emps() -> dict[str, Record]:
    """`train` (nominal) and `test` (pulses): motor voltage [V] as applied, position [m]."""
    sets = _loaded("EMPS")
    if sets is not None:
        return {"train": _record(sets[0]), "test": _record(sets[1])}
    found = {}
    for name, file in (("train", "train_nominal.csv.gz"), ("test", "test_pulses.csv.gz")):
        found[name] = _csv(_file("emps", file), "t_s", "v_V", "q_m", 1e-3)
    return found


def tanks() -> dict[str, Record]:
    """`train` and `test`: pump voltage [V], level sensor [V]; 4 s."""
    sets = _loaded("Cascaded_Tanks")
    if sets is not None:
        return {"train": _record(sets[0]), "test": _record(sets[1])}
    return {
        name: _csv(_file("cascaded_tanks", f"{name}.csv.gz"), "t_s", "u_V", "y_V", 4.0)
        for name in ("train", "test")
    }


def silverbox() -> dict[str, Record]:
    """`whole`: the record SNLS80mV, the arrow and then the multisines; input and output [V]."""
    sets = _loaded("Silverbox")
    if sets is not None:
        return {"whole": _record(sets)}
    return {"whole": _npz(_file("silverbox", "SNLS80mV.npz"), "V1_V", "V2_V")}


def wiener_hammerstein() -> dict[str, Record]:
    """`whole`: all 188000 samples; input and output [V]."""
    sets = _loaded("WienerHammerBenchMark")
    if sets is not None:
        return {"whole": _record(sets)}
    return {"whole": _npz(_file("wiener_hammerstein_2009", "wh2009.npz"), "u_V", "y_V")}


def quarter_drone() -> dict[str, Record]:
    """Its six runs by name: motor command [%], arm angle [deg].

    The two recordings of the rig are not quite uniform (7 to 14 ms, once 125 ms): they are put on
    a grid of 10 ms, the command held and the angle interpolated.
    """
    return {
        name: _csv(_file("quarter_drone", f"{file}.csv.gz"), time, "u_pct", "angle_deg", DRONE_STEP)
        for name, (file, time) in DRONE.items()
    }


def _loaded(name: str) -> Any | None:
    """Records by nonlinear_benchmarks, or None where it is absent or its download fails.

    It has no time limit of its own, so the host is knocked at first. What it prints goes to
    stderr, for stdout may be JSON.
    """
    try:
        import nonlinear_benchmarks  # pyright: ignore[reportMissingImports]
    except ImportError:
        return None
    load: Callable[..., Any] = getattr(nonlinear_benchmarks, name)
    before = socket.getdefaulttimeout()
    try:
        socket.create_connection((HOSTS[name], 443), PATIENCE).close()
        socket.setdefaulttimeout(PATIENCE)
        with contextlib.redirect_stdout(sys.stderr):
            return load(train_test_split=False)
    except Exception:  # noqa: BLE001  (whatever fails in a download, the folder is next)
        return None
    finally:
        socket.setdefaulttimeout(before)


def _record(loaded: Any) -> Record:
    return Record(
        float(loaded.sampling_time), np.asarray(loaded.u, float), np.asarray(loaded.y, float)
    )


def _file(folder: str, name: str) -> Path:
    """A file of the data folder; `InputError` that says how to get it."""
    root = Path(os.environ.get("FAULTGAUGE_DATA", Path("..") / "shared" / "data"))
    path = root / folder / name
    if not path.is_file():
        raise InputError(
            f"{path}: the records of this benchmark are absent; set FAULTGAUGE_DATA to the folder "
            f"that holds {folder}/{name}, or pip install faultgauge[peers] and connect to the "
            "internet."
        )
    return path


def _npz(path: Path, u: str, y: str) -> Record:
    try:
        with np.load(path) as held:
            return Record(1.0 / float(held["fs_Hz"]), held[u], held[y])
    except (OSError, KeyError, ValueError):
        raise InputError(
            f"{path}: not a NumPy archive with fs_Hz, {u} and {y}; fetch the benchmark's file anew."
        ) from None


def _csv(path: Path, time: str, u: str, y: str, step: float) -> Record:
    """A CSV file on a grid of `step` seconds: u held, y interpolated."""
    maps = [f"t={time}", f"u={u}", f"y={y}"]
    run = read_telemetry(path, time="t", maps=maps, names=["u", "y"])[0]
    grid = np.arange(round((run.t[-1] - run.t[0]) / step) + 1) * step
    t = run.t - run.t[0]
    if len(grid) == len(t) and np.allclose(grid, t, rtol=0, atol=step / 100):
        return Record(step, run.columns["u"], run.columns["y"])
    held = run.columns["u"][np.searchsorted(t, grid + step / 100, side="right") - 1]
    return Record(step, held, np.interp(grid, t, run.columns["y"]))
