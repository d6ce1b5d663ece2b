"""The bench end to end: `simulate --realtime | estimate -` at 10 and 100 Hz, a fault injected.

    python benchmarks/bench_realtime.py [--seconds 60] [--rates 10 100] [--out FILE]

Fits and calibrates a drive on simulated healthy logs of each rate, runs the pair against the clock
and prints how late the rows were, and what log, estimates and events say of the injected fault.
Every figure comes from what the two commands have written.
"""

import argparse
import csv
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path
from typing import Any

PLANT = """name = "drive"
[states.speed]
unit = "rad/s"
derivative = "b*u - a*speed"
[inputs.u]
unit = "A"
hold = "zero"
[outputs.speed]
unit = "rad/s"
value = "speed"
[parameters]
a = { value = 1.0, min = 0 }
b = { value = 1.0 }
[faults.load]
enters = "state"
target = "speed"
unit = "rad/s^2"
[observer]
bandwidth = 3
"""
SCENARIO = """name = "drive"
plant = "drive.toml"
seconds = {seconds}
step = {step}
seed = {seed}
[parameters]
a = 0.8
b = 2.5
[inputs.u]
source = "noise"
sigma = 0.8
low = 0.02
high = 1
[inputs.u.feedback.speed]
kp = 0.2
[noise]
speed = 0.002
"""
SIZE = 0.3  # rad/s^2
FAULTGAUGE = [sys.executable, "-c", "from faultgauge.cli import main; main()"]


def command(*arguments: object) -> list[str]:
    return [*FAULTGAUGE, *map(str, arguments)]


def prepare(folder: Path, rate: float, seconds: float) -> tuple[Path, Path]:
    """(calibrated model, scenario of the run) for logs of `rate` [Hz]."""
    step = 1 / rate
    logs, model = [], folder / "model.fgm"
    (folder / "drive.toml").write_text(PLANT)
    for seed, length in ((0, 120), (1, 300), (2, seconds)):
        scenario = folder / f"{seed}.toml"
        scenario.write_text(SCENARIO.format(seconds=length, step=step, seed=seed))
        logs.append((scenario, folder / f"{seed}.csv"))
    for scenario, log in logs[:2]:
        subprocess.run(command("simulate", scenario, "--out", log), check=True, capture_output=True)
    fit = command("fit", folder / "drive.toml", logs[0][1], "--out", model)
    subprocess.run(fit, check=True, capture_output=True)
    subprocess.run(command("calibrate", model, logs[1][1]), check=True, capture_output=True)
    return model, logs[2][0]


def run_pair(folder: Path, model: Path, scenario: Path, seconds: float, prefix: list[str]) -> None:
    """Run the pair and inject after a third of `seconds`."""
    files = [folder / name for name in ("bench.csv", "events.ndjson", "estimates.csv")]
    simulate = command("simulate", scenario, "--realtime", "--stream", "csv", "--out", files[0])
    estimate = command("estimate", model, "-", "--events", files[1])
    with open(files[2], "w") as rows, open(folder / "said.txt", "w") as said:
        first = subprocess.Popen(
            prefix + simulate, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        second = subprocess.Popen(prefix + estimate, stdin=first.stdout, stdout=rows, stderr=said)
        assert first.stdin is not None
        assert first.stdout is not None
        assert first.stderr is not None
        first.stdout.close()  # so that the first learns when the second has gone
        while b"running" not in (line := first.stderr.readline()):
            if not line:
                sys.exit("the simulation did not start; run it by hand to see why")
        time.sleep(seconds / 3)
        first.stdin.write(f"inject load {SIZE}\n".encode())
        first.stdin.close()
        first.stderr.read()
        codes = [first.wait(), second.wait()]
    if any(codes):
        sys.exit(f"the pair ended with {codes}: {(folder / 'said.txt').read_text()}")


def figures(folder: Path) -> dict[str, Any]:
    """What log, record, estimates and events say."""
    commands = read_ndjson(folder / "bench.injections.ndjson")
    injected, end = commands[0], commands[-1]
    log = read_csv(folder / "bench.csv")
    rows = read_csv(folder / "estimates.csv")
    onset = next(k for k, row in enumerate(log) if float(row["true_load"]) != 0)
    late = [float(row["f_load"]) for row in rows if float(row["t"]) >= injected["t"] + 5]
    said = [each for each in read_ndjson(folder / "events.ndjson") if each["fault"] == "load"]
    events = [each for each in said if each["said"] == "event"]
    event = max(events, key=lambda each: each["end"] - each["start"])
    alarms = [each for each in said if each["said"] == "alarm" and each["start"] < injected["t"]]
    return {
        **{key: end[key] for key in ("samples", "period_ms", "jitter_ms", "overruns")},
        "answered": len(rows),
        "last_answer_after_log_s": modified(folder / "estimates.csv")
        - modified(folder / "bench.csv"),
        "injected": {"sample": injected["sample"], "t": injected["t"], "size": injected["size"]},
        "log": {"sample": onset, "t": float(log[onset]["t"]), "size": float(log[-1]["true_load"])},
        "estimate": {"mean": sum(late) / len(late), "from_s": injected["t"] + 5},
        "event": {key: event[key] for key in ("start", "end", "size", "lo", "hi")},
        "alarms_before": len(alarms),
    }


def modified(path: Path) -> float:
    return path.stat().st_mtime


def read_csv(path: Path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def read_ndjson(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def show(rate: float, found: dict[str, Any]) -> None:
    jitter, event, log = found["jitter_ms"], found["event"], found["log"]
    print(
        f"{rate:g} Hz, {found['samples']} samples, one every {found['period_ms']:g} ms\n"
        f"  rows late by          {jitter['p50']:.2f} ms (p50), {jitter['p99']:.2f} ms (p99), "
        f"{jitter['max']:.2f} ms (max); overruns {found['overruns']}\n"
        f"  rows answered         {found['answered']}, the last "
        f"{1e3 * found['last_answer_after_log_s']:+.0f} ms after the log was written\n"
        f"  fault, as injected    {found['injected']['size']:g} rad/s^2 at sample "
        f"{found['injected']['sample']}, {found['injected']['t']:g} s\n"
        f"  in the log            {log['size']:g} rad/s^2 from sample {log['sample']}, "
        f"{log['t']:g} s\n"
        f"  in the estimates      {found['estimate']['mean']:.4f} rad/s^2, mean from "
        f"{found['estimate']['from_s']:g} s on\n"
        f"  in the events         {event['size']:.4f} [{event['lo']:.4f}, {event['hi']:.4f}] "
        f"rad/s^2 from {event['start']:g} s to {event['end']:g} s; alarms before it: "
        f"{found['alarms_before']}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run")
    parser.add_argument("--rates", type=float, nargs="+", default=[10.0, 100.0], help="Hz")
    parser.add_argument("--prefix", default="", help='of both commands, as "chrt -f 10"')
    parser.add_argument("--out", type=Path, help="also write the run record, as JSON")
    arguments = parser.parse_args()
    record: dict[str, Any] = {
        "machine": platform.machine(),
        "system": platform.platform(),
        "cpus": os.cpu_count(),
        "nice": os.nice(0),
        "prefix": arguments.prefix,
        "load_before": os.getloadavg(),
        "python": platform.python_version(),
        "jax": metadata.version("jax"),
        "began": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "rates_hz": {},
    }
    print(
        ", ".join(
            f"{key} {record[key]}" for key in ("system", "cpus", "nice", "prefix", "load_before")
        )
    )
    for rate in arguments.rates:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            model, scenario = prepare(folder, rate, arguments.seconds)
            run_pair(folder, model, scenario, arguments.seconds, arguments.prefix.split())
            record["rates_hz"][f"{rate:g}"] = found = figures(folder)
        show(rate, found)
    record["load_after"] = os.getloadavg()
    if arguments.out is not None:
        arguments.out.write_text(json.dumps(record, indent=2) + "\n")


if __name__ == "__main__":
    main()
