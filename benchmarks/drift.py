"""A thermometer that drifts by 0.5 K/h while it controls a heater: is that named, and dated?

    python benchmarks/drift.py [--runs N] [--healthy M] [--without-discrepancy] [--json FILE]

A PI controller holds what the thermometer says at a set-point that moves every hour, so a drift
shows in the power alone. The truth, in plain Python, has a sensor lag of 5 s, a room that wanders
by 0.2 K and noise of 0.05 K, rounded to 0.05 K; the plant file has none of these, and declares the
drift with its `rate` beside a loss of heating and a bias of the power. It is fitted to three
healthy logs and calibrated on five others; then N logs of eight hours (by default 40, seeds 0 to
N - 1) with a drift of either sign from 1.5 to 4 h on, and M healthy ones (half as many), are
judged.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from faultgauge.detection.decisions import Decision, decide_runs
from faultgauge.detection.posterior.events import UNKNOWN
from faultgauge.detection.posterior.verdicts import FAULT, NOT_JUDGED
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from faultgauge_studies import merit
from mismatch.harness import calibrated, without_discrepancy
from mismatch.report import share
from mismatch.scoring import wilson
from mismatch.truth import Acting, Truth, Vector, coloured, simulate, white

FILE = """
name = "heater under control"
[states]
T = { unit = "degC", derivative = "g*P - k*(T - room)" }
[inputs]
P = { unit = "W", min = 0, max = 100, hold = "zero" }
[outputs]
reading = { unit = "degC", value = "T" }
[parameters]
g = { value = 0.0015, min = 0 }
k = { value = 0.0015, min = 0 }
room = { value = 22, fixed = true }
[faults]
thermometer = { enters = "output", target = "reading", unit = "K", rate = 1.3888889e-4 }
heating_loss = { enters = "gain", target = "P" }
power_bias = { enters = "input", target = "P", unit = "W" }
"""
DRIFT = 0.5 / 3600  # K/s
STEP, SAMPLES, HOUR = 20.0, 1440, 3600.0  # s
HEATING, LOSS, SENSOR, ROOM = 0.002, 1 / 600, 5.0, 22.0  # K/s/W, 1/s, s, degC
WANDER, WANDER_TIME = 0.2, 1800.0  # K, s
NOISE, QUANTUM = 0.05, 0.05  # K
PROPORTIONAL, INTEGRAL = 4.0, 0.01  # W/K, W/(K s)
FITS, CALIBRATIONS = 3, 5
FIT, CALIBRATE, HEALTHY, DRIFTING = range(4)  # the first number of a seed
EARLIEST, LATEST = 1.5 * HOUR, 4 * HOUR
NAME = "thermometer"


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    """States T and what the thermometer has of it [degC]; d: the room [degC]."""
    temperature, felt = x
    return (
        HEATING * u[0] - LOSS * (temperature - d[0]),
        (temperature - felt) / SENSOR,
    )


def truth(rng: np.random.Generator) -> Truth:
    """Eight hours; the controller starts settled."""
    wanted = np.repeat(rng.uniform(50.0, 65.0, 8), round(HOUR / STEP))
    settled = LOSS / HEATING * (wanted[0] - ROOM)
    pushed = [settled]  # W: the integral part, sample by sample

    def command(k: int, y: Sequence[Vector]) -> Vector:
        error = float(wanted[k]) - y[k][0]
        asked = PROPORTIONAL * error + pushed[k]
        power = min(max(asked, 0.0), 100.0)
        pushed.append(pushed[k] + (INTEGRAL * STEP * error if power == asked else 0.0))
        return (power,)

    return Truth(
        rates=rates,
        states=("T", "felt"),
        start=(float(wanted[0]), float(wanted[0])),
        sensors=(1,),
        command=command,
        limits=((0.0, 100.0),),
        disturbances=ROOM + coloured(rng, SAMPLES, STEP, (WANDER,), WANDER_TIME),
        noise=white(rng, SAMPLES, (NOISE,)),
        quantum=(QUANTUM,),
        step=STEP,
        substeps=4,
    )


def log(kind: int, seed: int) -> tuple[Run, Acting | None]:
    """One record, and its drift."""
    rng = np.random.default_rng([kind, seed])
    drift = None
    if kind == DRIFTING:
        onset = STEP * round(rng.uniform(EARLIEST, LATEST) / STEP)
        drift = Acting("output", 0, float(rng.choice([-1.0, 1.0])) * DRIFT, onset, grows=True)
    drawn = truth(rng)
    u, y = simulate(drawn, [drift] if drift else [])
    t = STEP * np.arange(len(y))
    return Run(f"{kind} {seed}", "drift", t, {"P": u[:, 0], "reading": y[:, 0]}), drift


def scored(decision: Decision, drift: Acting) -> dict[str, Any]:
    """One drifting log: what was named, and how the drift was dated and, at the last event's end,
    sized."""
    named = {event.fault for event in decision.events}
    late = [e for e in decision.events if e.fault == NAME and e.end >= drift.onset]
    dated = merit.dated(decision.events, NAME, drift.onset)
    last = max(late, key=lambda event: event.end) if late else None
    size = drift.at(last.end) if last else None
    sized = None
    if last and last.lo is not None and last.hi is not None and size is not None:
        sized = bool(last.lo <= size <= last.hi)
    told = min((event.start for event in late), default=None)
    return {
        "onset": drift.onset,
        "named": bool(late),
        "exact": named == {NAME} and bool(late) and len(late) == len(decision.events),
        "wrong": bool(named - {NAME, UNKNOWN}),
        "unknown": UNKNOWN in named,
        "dated": None if dated is None else dated.inside,
        "dated_width": None if dated is None else dated.width,
        "sized": sized,
        "delay": None if told is None else max(told - drift.onset, 0.0),
        "not_judged": float(np.mean(np.array(decision.status) == NOT_JUDGED)),
    }


def middle(values: Sequence[float | None], scale: float) -> str:
    found = [value / scale for value in values if value is not None]
    return f"{np.median(found):.3g} [{min(found):.3g}, {max(found):.3g}]" if found else "none"


def known(found: Sequence[dict[str, Any]], key: str) -> list[bool]:
    return [each[key] for each in found if each[key] is not None]


def show(found: Sequence[dict[str, Any]], alarmed: Sequence[bool]) -> None:
    for key, text in (
        ("named", "the drift named"),
        ("exact", "and nothing else"),
        ("wrong", "a wrong name"),
        ("unknown", "something undeclared told"),
        ("dated", "onset inside its interval, where named"),
        ("sized", "what it had grown to inside its interval, where named"),
    ):
        print(f"  {text}: {share(wilson(known(found, key)))}")
    print(f"  healthy logs with an alarm: {share(wilson(alarmed))}")
    print(f"  onset interval, as long as [h]: {middle([e['dated_width'] for e in found], HOUR)}")
    print(f"  delay [h]: {middle([each['delay'] for each in found], HOUR)}")
    judged = np.mean([each["not_judged"] for each in found])
    print(f"  not judged, of samples: {judged:.1%}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--healthy", type=int)
    parser.add_argument("--without-discrepancy", action="store_true")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    healthy = max(given.runs // 2, 1) if given.healthy is None else given.healthy
    if given.runs < 1 or healthy < 1:
        parser.error("--runs and --healthy are at least 1.")
    options = without_discrepancy() if given.without_discrepancy else {}
    plant = GrayBoxPlant.untrained(parse_plant(FILE))
    print("fitting and calibrating", file=sys.stderr)
    fitted, sound = (
        [log(kind, seed)[0] for seed in range(count)]
        for kind, count in ((FIT, FITS), (CALIBRATE, CALIBRATIONS))
    )
    model, warnings = calibrated(plant, fitted, sound, options)
    print("drift of 0.5 K/h:")
    for warning in warnings:
        print(f"  warned: {warning}")
    alarmed, found = list[bool](), list[dict[str, Any]]()
    for seed in range(healthy):
        (decision,), _ = decide_runs(model, [log(HEALTHY, seed)[0]])
        alarmed.append(FAULT in decision.status or bool(decision.events))
    for seed in range(given.runs):
        run, drift = log(DRIFTING, seed)
        assert drift is not None
        (decision,), _ = decide_runs(model, [run])
        found.append(scored(decision, drift))
        print(f"{seed + 1} of {given.runs}", file=sys.stderr)
    show(found, alarmed)
    if given.json:
        given.json.write_text(json.dumps({"drifting": found, "healthy_alarm": alarmed}))


if __name__ == "__main__":
    main()
