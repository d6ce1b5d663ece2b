"""A long stream through `faultgauge estimate MODEL -`: rows per second of one core, and memory.

    python benchmarks/stream_speed.py [ROWS] [--leak SIZE]

Two tanks in a row, both levels measured, one declared leak; fitted and calibrated on logs of their
own. Rows come as fast as they are taken. Processor time counts from the first thousandth of the
rows on, so that compiling does not; memory is what the process holds (Linux: /proc). With `--leak`
the leak is there from the middle on, and the rows of its event are kept until it is over.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import IO

import numpy as np
from scipy.signal import cont2discrete

STEP, SIGMA = 0.1, 2e-3
FITTED, CALIBRATED = 3000, 6000
SHOWN = 5  # parts of the stream after which memory is told
PLANT = """name = "two tanks"
[states.upper]
derivative = "u - a*upper"
[states.lower]
derivative = "a*upper - c*lower"
[inputs.u]
hold = "zero"
[outputs.upper]
value = "upper"
[outputs.lower]
value = "lower"
[parameters]
a = { value = 1, min = 0 }
c = { value = 1, min = 0 }
[faults.leak]
enters = "state"
target = "lower"
"""
COMMAND = [sys.executable, "-c", "from faultgauge.cli import main; main()"]
TICKS = os.sysconf("SC_CLK_TCK")


def rows(seed: int, count: int, leak: float = 0.0) -> str:
    """A log as CSV, exact under the hold; `leak` from the middle on."""
    rng = np.random.default_rng(seed)
    a, c = 0.5, 0.8
    continuous = np.array([[-a, 0.0], [a, -c]]), np.eye(2), np.eye(2), np.zeros((2, 2))
    A, B, *_ = cont2discrete(continuous, STEP)
    (p, _), (q, r) = A.tolist()
    u = np.repeat(rng.uniform(0, 2, count // 20 + 1), 20)[:count]
    f = np.where(np.arange(count) < count // 2, 0.0, leak)
    driven = (np.stack([u, f], axis=1) @ B.T).tolist()
    upper, lower, x = 0.0, 0.0, np.zeros((count, 2))
    for k, (first, second) in enumerate(driven):
        x[k] = upper, lower
        upper, lower = p * upper + first, q * upper + r * lower + second
    y = x + SIGMA * rng.standard_normal(x.shape)
    cells = zip((STEP * np.arange(count)).tolist(), u.tolist(), *y.T.tolist(), strict=True)
    return "t,u,upper,lower\n" + "".join(
        ",".join(f"{cell:.10g}" for cell in each) + "\n" for each in cells
    )


def faultgauge(*arguments: str, folder: Path) -> None:
    subprocess.run([*COMMAND, *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def prepared(folder: Path) -> None:
    """plant.toml and model.fgm, calibrated."""
    (folder / "plant.toml").write_text(PLANT)
    (folder / "fit.csv").write_text(rows(1, FITTED))
    (folder / "healthy.csv").write_text(rows(2, CALIBRATED))
    faultgauge("fit", "plant.toml", "fit.csv", "--out", "model.fgm", folder=folder)
    faultgauge("calibrate", "model.fgm", "healthy.csv", folder=folder)


def feed(into: IO[bytes], data: bytes) -> None:
    with into:
        into.write(data)


def used(pid: int) -> tuple[float, float]:
    """(processor time [s], memory [MB]) of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    resident = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return (int(fields[11]) + int(fields[12])) / TICKS, resident * os.sysconf("SC_PAGE_SIZE") / 1e6


def measured(folder: Path, count: int, leak: float) -> None:
    data = rows(3, count, leak).encode()
    first, every = max(count // 1000, 1000), count // SHOWN
    with subprocess.Popen(
        [*COMMAND, "estimate", "model.fgm", "-"],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as running:
        assert running.stdin is not None
        assert running.stdout is not None
        threading.Thread(target=feed, args=(running.stdin, data), daemon=True).start()
        cpu = wall = 0.0
        for k, _ in enumerate(running.stdout):
            if k == first:
                cpu, wall = used(running.pid)[0], time.perf_counter()
            if k and k % every == 0 and k < count:
                print(f"{k} rows: {used(running.pid)[1]:.0f} MB", flush=True)
            if k == count - 1:
                last, memory = used(running.pid)
                per_s = (count - first) / (last - cpu)
                passed = (count - first) / (time.perf_counter() - wall)
                print(
                    f"{count} rows: {memory:.0f} MB; {per_s:.0f} rows per second of one core, "
                    f"{passed:.0f} beside what else the machine does"
                )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("rows", type=int, nargs="?", default=1_000_000)
    parser.add_argument("--leak", type=float, default=0.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        prepared(Path(name))
        measured(Path(name), given.rows, given.leak)
