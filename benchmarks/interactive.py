"""How long a command takes, as its user waits: processor time of whole processes, cold and warm.

    python benchmarks/interactive.py [--quick] [--rounds N] [--states N ...] [--json FILE]

A chain of heated bodies (N states, of which every second is measured; an input; faults that are a
heat flow into a body, a bias of a sensor, a loss of the heater's gain) is simulated exactly, fitted
to one log and calibrated on two others. `estimate` judges another log with a fault. Cold is a
process that finds no compiled program, warm one that finds all of them; warm figures are medians of
N rounds (by default 3). With several numbers of states the exponent by which time grows with them
is told, a line through the logarithms. `--quick` leaves out long logs and more than four states.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm

STEP = 1.0  # s
RATE, LOSS, GAIN = 0.08, 0.01, 0.05  # 1/s between neighbours, 1/s to the room, degC/s of full power
NOISE = 0.02  # degC


def plant(states: int, faults: int) -> str:
    """The plant file: of the faults the first heats the middle body, the others take turns."""
    lines = ['name = "chain"', ""]
    for k in range(states):
        flows = [f"rate*(T{j} - T{k})" for j in (k - 1, k + 1) if 0 <= j < states]
        heat = ["gain*u"] if k == 0 else []
        lines += [f"[states.T{k}]", 'unit = "degC"']
        lines += [f'derivative = "{" + ".join([*flows, *heat])} - loss*T{k}"', ""]
    lines += ["[inputs.u]", 'unit = "1"', "min = 0.0", "max = 1.0", ""]
    for k in range(0, states, 2):
        lines += [f"[outputs.y{k}]", 'unit = "degC"', f'value = "T{k}"', ""]
    for name, value in (("rate", 0.06), ("loss", 0.02), ("gain", 0.04)):
        lines += [f"[parameters.{name}]", f"value = {value}", "min = 0.001", "max = 1.0", ""]
    for k in range(faults):
        enters, target = ("state", f"T{states // 2 + k // 3}")
        if k % 3 == 1:
            enters, target = "output", f"y{2 * (k // 3) % (2 * ((states + 1) // 2))}"
        elif k % 3 == 2:
            enters, target = "state", f"T{k // 3}"
        lines += [f"[faults.f{k}]", f'enters = "{enters}"', f'target = "{target}"', ""]
    return "\n".join(lines)


def log(states: int, rows: int, seed: int, fault: float) -> dict[str, np.ndarray]:
    """A record; from the middle on `fault` [degC/s] heats the middle body."""
    random = np.random.default_rng(seed)
    A = np.zeros((states + 2, states + 2))
    for k in range(states):
        for j in (k - 1, k + 1):
            if 0 <= j < states:
                A[k, j] += RATE
                A[k, k] -= RATE
        A[k, k] -= LOSS
    A[0, states], A[states // 2, states + 1] = GAIN, 1.0
    step = expm(A * STEP)
    u = np.repeat(random.uniform(0, 1, rows // 25 + 1), 25)[:rows]
    x, told = np.zeros(states), np.empty((rows, states))
    for k in range(rows):
        told[k] = x
        x = (step @ np.concatenate([x, [u[k], fault * (k >= rows // 2)]]))[:states]
    told += random.normal(0, NOISE, told.shape)
    measured = {f"y{k}": told[:, k] for k in range(0, states, 2)}
    return {"t": STEP * np.arange(rows), "u": u, **measured}


def written(folder: Path, name: str, columns: dict[str, np.ndarray]) -> str:
    path = folder / f"{name}.csv"
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.8g")
    return str(path)


def spent(arguments: list[str], cache: Path) -> float:
    """Processor time [s] of a process that keeps what it compiles in `cache`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    call = [sys.executable, "-m", "faultgauge", *arguments]
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    for name in ("JAX_COMPILATION_CACHE_DIR", "FAULTGAUGE_PROGRAMS"):
        environment.pop(name, None)
    done = subprocess.run(call, env=environment, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(arguments)}: {done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measured(states: int, faults: int, rows: int, rounds: int, folder: Path) -> dict[str, Any]:
    """Seconds of every command, cold and warm."""
    folder.mkdir()
    logs = [written(folder, f"healthy{k}", log(states, 5000, k, 0.0)) for k in range(3)]
    suspect = written(folder, "suspect", log(states, rows, 9, 0.02))
    (folder / "plant.toml").write_text(plant(states, faults))
    fitted, model = str(folder / "fit.fgm"), str(folder / "model.fgm")
    cache = folder / "cache"
    commands = {
        "fit": ["fit", str(folder / "plant.toml"), logs[0], "--out", fitted],
        "calibrate": ["calibrate", fitted, *logs[1:], "--out", model],
        "estimate": ["estimate", model, suspect, "--out", str(folder / "rows.csv")],
    }
    found: dict[str, Any] = {"states": states, "faults": faults, "rows": rows}
    for name, arguments in commands.items():
        cold = spent(arguments, cache)
        warm = [spent(arguments, cache) for _ in range(rounds)]
        found[name] = {"cold": cold, "warm": float(np.median(warm)), "all": warm}
        print(
            f"{states:>3} states, {faults:>2} faults, {rows:>7,} rows, {name:<9}: "
            f"{found[name]['warm']:6.2f} s [{min(warm):.2f}, {max(warm):.2f}], cold {cold:.2f} s",
            flush=True,
        )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--states", type=int, nargs="+", default=[5, 10])
    parser.add_argument("--json", type=Path, metavar="FILE")
    given = parser.parse_args()
    sizes = [(4, 4, 5000)]
    if not given.quick:
        sizes += [(4, 4, 100_000), *((n, 1, 5000) for n in given.states)]
    with tempfile.TemporaryDirectory() as folder:
        found = [
            measured(*size, given.rounds, Path(folder) / str(k)) for k, size in enumerate(sizes)
        ]
    alone = [each for each in found if each["faults"] == 1]
    for name in ("fit", "calibrate", "estimate"):
        if len(alone) > 1:
            n = np.log([each["states"] for each in alone])
            slope = np.polyfit(n, np.log([each[name]["warm"] for each in alone]), 1)[0]
            print(f"{name} grows as the number of states to the power of {slope:.2f}")
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
