"""Decisions on measured data: pulses in a positioning drive, and a healthy quarter drone.

python benchmarks/real_decisions.py [--seeds N] [--out FOLDER]

Seeds 0 to N - 1 of the drive's fits, by default 3; the drone with seed 0. With `--out` figures of
seed 0. Set FAULTGAUGE_DATA to the folder that holds emps/ and quarter_drone/.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from decision_studies.drive_pulses import Body, Found, bodies, by_bank, by_eso, trained
from decision_studies.drone_runs import healthy_runs, left_out
from faultgauge.detection.decisions import Decision
from faultgauge.reporting.time_figures import fault_estimate
from faultgauge_studies import merit
from faultgauge_studies.drive import DriveLogs, measured_logs


def spread(values: Sequence[float]) -> str:
    return f"{np.median(values):.4g} [{min(values):.4g}, {max(values):.4g}]"


def drive(logs: DriveLogs, seeds: range, folder: Path | None) -> None:
    """Every body by both observers, then the body that its healthy estimate chooses."""
    found: dict[int, dict[str, tuple[Body, Found, Found]]] = {}
    for seed in seeds:
        found[seed] = {}
        for name, plant in bodies().items():
            body = trained(name, plant, logs, seed)
            found[seed][name] = body, by_eso(body, logs), by_bank(body, logs)
    for name in found[0]:
        every = [found[seed][name] for seed in seeds]
        print(f"drive, {name}:")
        print(
            f"  free run on unseen healthy data, error: {spread([b.free_run for b, *_ in every])}"
        )
        print(f"  healthy estimate, RMS: {spread([b.healthy for b, *_ in every])} V")
        show("eso", [eso.figures for _, eso, _ in every])
        show("bank", [bank.figures for _, _, bank in every])
    chosen = {seed: min(each, key=lambda n: each[n][0].healthy) for seed, each in found.items()}
    freest = {seed: min(each, key=lambda n: each[n][0].free_run) for seed, each in found.items()}
    for how, which in (("healthy estimate", chosen), ("free run", freest)):
        print(f"drive, chosen by its {how}: {', '.join(which.values())}")
        picked = [found[seed][name] for seed, name in which.items()]
        show("eso", [eso.figures for _, eso, _ in picked])
        show("bank", [bank.figures for _, _, bank in picked])
    if folder:
        draw_drive(logs, {"eso": found[0][chosen[0]][1], "bank": found[0][chosen[0]][2]}, folder)


def show(observer: str, figures: Sequence[dict[str, float]]) -> None:
    text = ", ".join(f"{key} {spread([each[key] for each in figures])}" for key in figures[0])
    print(f"  {observer}: {text}")


def draw_drive(logs: DriveLogs, found: dict[str, Found], folder: Path) -> None:
    near = slice(300, 2400)  # two pulses, 1 kHz
    for name, each in found.items():
        picture = fault_estimate(
            logs.faulty.t[near],
            each.f[near],
            each.lo[near],
            each.hi[near],
            limit=None,
            name="pulse",
            unit="V",
            truth=logs.pulse[near],
            probable=True,
        )
        (folder / f"real_drive_{name}.svg").write_text(picture.svg)


def drone(folder: Path | None) -> None:
    """Each run judged by the other five."""
    runs = healthy_runs()
    found = {name: left_out(runs, name) for name in runs}
    for name, each in found.items():
        said = ", ".join(f"{status} {count}" for status, count in each.statuses.items())
        print(f"drone, {name} left out: {said}; alarms {each.alarms} in {each.seconds:.0f} s")
    count = sum(each.alarms for each in found.values())
    hours = sum(each.seconds for each in found.values()) / 3600
    rate = merit.alarm_rate(count, hours)
    print(
        f"drone: {count} alarms in {hours:.3g} h: {rate.value:.3g} per hour "
        f"[{rate.lo:.3g}, {rate.hi:.3g}]"
    )
    quiet = merit.share([each.alarms == 0 for each in found.values()])
    print(f"drone: runs without an alarm: {quiet.value:.1%} [{quiet.lo:.1%}, {quiet.hi:.1%}]")
    if folder:
        worst = max(found, key=lambda name: found[name].alarms)
        draw_drone(found[worst].decision, folder)


def draw_drone(decision: Decision, folder: Path) -> None:
    found = decision.posterior
    picture = fault_estimate(
        decision.run.t,
        found.f[:, 0],
        found.lo[:, 0],
        found.hi[:, 0],
        limit=None,
        name="push",
        unit="deg/s**2",
        events=[(e.start, e.end) for e in decision.events],
        not_judged=np.array(decision.status) == "NOT_JUDGED",
        probable=True,
    )
    (folder / "real_drone.svg").write_text(picture.svg)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    records = measured_logs()
    if records is None:
        sys.exit("set FAULTGAUGE_DATA to the folder that holds emps/ and quarter_drone/")
    drive(records, range(given.seeds), given.out)
    drone(given.out)
