"""A newcomer's way to an answer: own logs with odd headers, units and clock, and four commands.

    python benchmarks/newcomer.py [--keep FOLDER] [--drive]

The healthy log is as a German logger writes it: semicolons, decimal commas, a byte order mark,
local time, `Temp [degC]` in the header. The log to judge is a workbook. Half through it the heater
loses 15 % of its power. Nobody maps a column, and no plant file is written: `inspect` drafts one,
and `check` fits, calibrates and estimates; or each of these is a command of its own. Printed are
the commands, with wall and CPU time of each: cold, with no program compiled before, and warm; and
what they answered. Exit code 1 where an answer is more than ten
minutes off the onset.

`--drive` instead takes the measured EMPS drive (FAULTGAUGE_DATA names the folder that holds emps/):
milliseconds since 1970, millimetres, decimal commas, names of its own, and a 5 V pulse every second
that the voltage column hides. The preset nearest to it is printed and edited: its position and
voltage get the names of the columns. Exit code 1 where the first pulse is dated 10 ms off.
"""

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "telemetry"))
from workbooks import write_workbook

from faultgauge.telemetry import Run
from faultgauge_studies.drive import measured_logs

PACE = 10  # s
ROOM, PER_PERCENT, LOSING = 21.0, 0.012, 0.004  # degC, degC/s per %, 1/s
NOISE = 0.05  # degC
HEADER = "Zeit", "Heizung [%]", "Temp [degC]"
BEGUN = timedelta(hours=9, minutes=20)  # of the day: when the heater loses its power
ALLOWED = timedelta(minutes=10)
SHORT = (
    "inspect healthy.csv --time Zeit --init-plant plant.toml",
    "check healthy.csv suspect.xlsx --plant plant.toml --time Zeit --out result",
)
LONG = (
    SHORT[0],
    "fit plant.toml healthy.csv --time Zeit --out heater.fgm",
    "calibrate heater.fgm healthy.csv",
    "estimate heater.fgm suspect.xlsx --out estimates.csv --report report.html",
)
PRINTED = (
    "inspect healthy.csv --time Zeitstempel",
    "presets positioning_drive",
)
JUDGED = ("check healthy.csv suspect.csv --plant plant.toml --time Zeitstempel --resample 200",)
NAMES = {"q": "Weg", "u": "Spannung"}
FIRST_PULSE, NEAR = 0.343, 0.01  # s
EPOCH = 1_772_438_400_000  # ms since 1970: 08:00:00 UTC


def rows(count: int, start: datetime, seed: int, lost: float) -> list[list]:
    """(local time, heater [%], temperature [degC]) of a heated room; `lost` is the share of the
    power from the middle on."""
    rng = np.random.default_rng(seed)
    heater, warmth, found = 0.0, ROOM, []
    for k in range(count):
        if k % 90 == 0:
            heater = round(rng.uniform(10, 90), 1)
        at = start + timedelta(seconds=PACE * k)
        found.append([at, heater, round(warmth + rng.normal(0, NOISE), 2)])
        left = 1 - lost * (2 * k >= count)
        for _ in range(PACE):  # Euler at 1 s
            warmth += PER_PERCENT * left * heater - LOSING * (warmth - ROOM)
    return found


def write_logs(folder: Path) -> None:
    """`healthy.csv` and `suspect.xlsx`."""
    lines = [";".join(HEADER)]
    for at, *values in rows(4000, datetime(2026, 3, 2, 6), 5, 0.0):
        lines.append(
            ";".join([f"{at:%d.%m.%Y %H:%M:%S}", *(str(v).replace(".", ",") for v in values)])
        )
    (folder / "healthy.csv").write_bytes("\r\n".join([*lines, ""]).encode("utf-8-sig"))
    suspect = rows(2400, datetime(2026, 3, 9, 6), 6, 0.15)
    write_workbook(folder / "suspect.xlsx", {"Messung": [list(HEADER), *suspect]})


def run(command: str, folder: Path, cache: Path) -> tuple[float, float, str]:
    """(wall [s], CPU [s], what was answered) of a command."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "faultgauge", *command.split()],
        cwd=folder,
        env=os.environ | {"XDG_CACHE_HOME": str(cache)},
        capture_output=True,
        text=True,
        check=False,
    )
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{command}: exit code {done.returncode}: {done.stderr}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, cpu, done.stdout


def walk(name: str, commands: tuple[str, ...], folder: Path, cache: Path) -> str:
    """Run and print them; the last answer."""
    print(f"\n{name}: {len(commands)} commands")
    walls, cpus, answer = 0.0, 0.0, ""
    for command in commands:
        wall, cpu, answer = run(command, folder, cache)
        walls, cpus = walls + wall, cpus + cpu
        print(f"  {wall:6.1f} s, {cpu:6.1f} s of CPU   faultgauge {command}")
    print(f"  {walls:6.1f} s, {cpus:6.1f} s of CPU   in all\n{answer}", flush=True)
    return answer


def write_drive_logs(folder: Path) -> None:
    """`healthy.csv` and `suspect.csv`."""
    logs = measured_logs()
    if logs is None:
        sys.exit("set FAULTGAUGE_DATA to the folder that holds emps/")
    for name, run in (("healthy", logs.healthy), ("suspect", logs.faulty)):
        (folder / f"{name}.csv").write_text("\n".join(drive_lines(run)) + "\n")


def drive_lines(run: Run) -> list[str]:
    lines = ["Zeitstempel;Weg [mm];Spannung [V]"]
    for t, q, u in zip(run.t, run.columns["q"], run.columns["u"], strict=True):
        cells = f"{1000 * q:.5f};{u:.5f}".replace(".", ",")
        lines.append(f"{EPOCH + round(1000 * t)};{cells}")
    return lines


def edited(preset: str) -> str:
    """The preset with the names of the columns."""
    for name, column in NAMES.items():
        preset = re.sub(rf"\b{name}\b(?! =)", column, preset)
    return preset


def drive(folder: Path, cache: Path) -> bool:
    """Whether the first pulse was dated right."""
    folder.mkdir(parents=True, exist_ok=True)
    write_drive_logs(folder)
    preset = walk("measured drive, before the edit", PRINTED, folder, cache)
    (folder / "plant.toml").write_text(edited(preset))
    answer = walk("measured drive, after it", JUDGED, folder, cache)
    found = re.search(r"pulse \+.* since 08:00:(\d+\.\d+) \+-", answer)
    return found is not None and abs(float(found[1]) - FIRST_PULSE) <= NEAR


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, help="Keep logs and results in this folder.")
    parser.add_argument("--drive", action="store_true", help="The measured drive instead.")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        if given.drive:
            keep = (given.keep or Path(scratch)) / "drive"
            sys.exit(not drive(keep, Path(scratch) / "cache"))
        answers = []
        for way, commands in (("check", SHORT), ("step by step", LONG)):
            for state in ("cold", "warm"):
                folder = (given.keep or Path(scratch)) / f"{way} {state}"
                folder.mkdir(parents=True)
                write_logs(folder)
                cache = Path(scratch) / f"cache {way}"
                answers.append(walk(f"{way}, {state}", commands, folder, cache))
    sys.exit(not all(abs(since(answer) - BEGUN) <= ALLOWED for answer in answers))


def since(answer: str) -> timedelta:
    """The time of the day since when the first fault is there."""
    found = re.search(r"since (\d+):(\d+):(\d+)", answer)
    hours, minutes, seconds = map(int, found.groups()) if found else (0, 0, 0)
    return timedelta(hours=hours, minutes=minutes, seconds=seconds)


if __name__ == "__main__":
    main()
