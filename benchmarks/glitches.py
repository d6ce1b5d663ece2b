"""Single-sample glitches of any size in healthy measured logs: what the bank makes of them.

    python benchmarks/glitches.py [--set NAME]... [--seeds N] [--rows N] [--models FOLDER]

Sets, plants, fits and calibrations are those of `real_sets.py`, and SKAB's record without anomalies
in three parts, with the faults of its own plant file; `--rows` takes at most so many of each log,
`--models` keeps what was fitted for the next time. Into the first hour of each run that neither fit
nor calibration has seen, or as much as there is, go 20 glitches in one output each: -9999, 0, 1e9
and values off by one standard deviation of the noise up to 1e12, log-uniform, of either sign. The
log without them is judged beside it. An alarm or event counts as the glitches' where it begins and
the log without them has none, of the same fault, within ten samples. Where there is any, the log
that lacks these samples is judged as well: nobody knows what they would have said, so what it
tells, too, is the record's own. Of the intervals count, five samples later, those that held 0
without. Set FAULTGAUGE_DATA to the folder that holds the records.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from faultgauge.detection.bank.bank import FaultBank, build_fault_bank
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.decisions import Decision, decide
from faultgauge.detection.posterior.verdicts import FAULT
from faultgauge.errors import InputError
from faultgauge.identification.fit import fit
from faultgauge.plants.model import Model, load_model, save_model
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import cut, paced
from faultgauge_studies.published.benchmark import plant_text
from faultgauge_studies.published.faulted_data import healthy_loop
from real_sets import HALVES, SETS, RealSet, split

COUNT = 20
KNOWN = (-9999.0, 0.0, 1e9)  # what sensors say that have nothing to say
LARGEST = 12.0  # decades
HOUR = 3600.0
FIRST = 30  # samples that a log begins without glitches: the bank is held off, and learns the step
APART = 8  # samples between two glitches, at least
NEAR = 10  # samples
LATER = 5  # samples


class Glitch(NamedTuple):
    row: int
    output: str
    value: float


class Told(NamedTuple):
    """When what began, and what there is to say of it."""

    t: float
    text: str


Stretches = list[tuple[str | None, float, float]]  # of one cause, from and to [s]


class Found(NamedTuple):
    """Of one run with glitches; `alarms` and `events` are those that the log without them lacks,
    `alone` those of both that a log without these samples lacks, too."""

    seconds: float
    alarms: list[Told]
    events: list[Told]
    alone: list[Told]
    healthy_alarms: int
    healthy_events: int
    held: int
    asked: int


def skab() -> list[RealSet]:
    """Fitted on a half, calibrated on a quarter; its faults enter states and are not rehearsed."""
    parts = [[part] for part in split(healthy_loop(), *HALVES)]
    return [RealSet("skab", plant_text("skab"), *parts)]


ALL = SETS | {"skab": skab}


def calibrated(each: RealSet, folder: Path | None) -> Model:
    """The set's model, fitted with seed 0, or as `folder` has kept it."""

    def progress(text: str) -> None:
        print(f"{each.name}: {text}", file=sys.stderr, flush=True)

    path = folder and folder / f"{each.name.replace(', ', ' ').replace(' ', '_')}.fgm"
    model = load_model(path) if path and path.exists() else None
    if model is None:
        model, _ = fit(each.body(), each.fit, seed=0, progress=progress)
        if path:
            save_model(model, path)
    if model.calibration is None:
        model = calibrate(model, each.calibrate, progress=progress).model
        if path:
            save_model(model, path)
    return model


def drawn(run: Run, sigma: dict[str, float], rng: np.random.Generator) -> Iterator[Glitch]:
    """20 glitches, in order."""
    sampled = np.any([np.isfinite(run.columns[n]) for n in sigma], axis=0)
    rows = FIRST + np.flatnonzero(sampled[FIRST:])
    room = len(rows) // COUNT
    sizes = list(KNOWN)
    for k in range(COUNT):
        row = int(rows[k * room + int(rng.integers(max(room - APART, 1)))])
        output = str(rng.choice([n for n in sigma if np.isfinite(run.columns[n][row])]))
        decade = rng.uniform(np.log10(sigma[output]), LARGEST)
        off = float(rng.choice([-1.0, 1.0]) * 10**decade)
        value = sizes.pop() if sizes else run.columns[output][row] + off
        yield Glitch(row, output, value)


def begun(said: Decision) -> np.ndarray:
    """The rows in which an alarm begins."""
    alarm = np.array(said.status) == FAULT
    return np.flatnonzero(alarm & ~np.append(False, alarm[:-1]))


def told(said: Decision) -> tuple[list[Told], list[Told]]:
    """(its alarms, its events)."""
    t = said.run.t
    alarms = [Told(float(t[k]), f"alarm ({said.reason[k]})") for k in begun(said)]
    return alarms, [Told(each.start, f"event {each.fault}") for each in said.events]


def beside(said: Decision, other: Decision) -> tuple[list[Told], list[Told]]:
    """The alarms and the events of `said` that begin where `other` has none: no row of an alarm,
    no event of the same fault."""
    near = NEAR * said.run.step
    t = other.run.t[np.array(other.status) == FAULT]
    alarms = [(None, each, each) for each in t.tolist()]
    events = [(each.fault, each.start, each.end) for each in other.events]

    def lacking(found: list[Told], causes: list[str | None], there: Stretches) -> list[Told]:
        return [
            each
            for each, cause in zip(found, causes, strict=True)
            if not any(c == cause and a - near <= each.t <= b + near for c, a, b in there)
        ]

    some, more = told(said)
    named: list[str | None] = [each.fault for each in said.events]
    return lacking(some, [None] * len(some), alarms), lacking(more, named, events)


def compared(bank: FaultBank, healthy: Decision, run: Run, seed: int) -> Found:
    """`run`, of which `healthy` was said, with the glitches of `seed`."""
    sigma = dict(zip(bank.model.plant.signals.output_names, bank.noise.sigma, strict=True))
    sigma = {name: float(each) for name, each in sigma.items() if name in bank.outputs}
    glitches = list(drawn(run, sigma, np.random.default_rng(seed)))

    def judged(values: Iterable[float]) -> Decision:
        columns = {name: each.copy() for name, each in run.columns.items()}
        for each, value in zip(glitches, values, strict=True):
            columns[each.output][each.row] = value
        return decide(bank, replace(run, columns=columns))

    said = judged(each.value for each in glitches)
    alarms, events = beside(said, healthy)
    alone = list[Told]()
    if alarms or events:
        lost = beside(said, judged(np.nan for _ in glitches))
        alone = [each for found in lost for each in found if each in (*alarms, *events)]
    rows = [each.row + LATER for each in glitches if each.row + LATER < len(run.t)]
    held = [(d.posterior.lo[rows] <= 0) & (d.posterior.hi[rows] >= 0) for d in (healthy, said)]
    return Found(
        float(run.t[-1] - run.t[0]),
        alarms,
        events,
        alone,
        len(begun(healthy)),
        len(healthy.events),
        int((held[0] & held[1]).sum()),
        int(held[0].sum()),
    )


def shortened(each: RealSet, rows: int) -> RealSet:
    """With at most so many rows of each log."""
    logs = ([cut(run, slice(0, rows)) for run in runs] for runs in each[2:])
    return RealSet(*each[:2], *logs)


def measured(each: RealSet, seeds: range, folder: Path | None) -> str:
    """A row of the table; what was told of glitches goes to stderr."""
    model = calibrated(each, folder)
    runs = [cut(run, slice(0, np.searchsorted(run.t, run.t[0] + HOUR))) for run in each.rehearse]
    found = []
    for run in map(paced, runs):
        bank = build_fault_bank(model, [run], noise_of(model))
        healthy = decide(bank, run)
        found += [compared(bank, healthy, run, seed) for seed in seeds]
    for one in found:
        for each_told in (*one.alarms, *one.events):
            why = "" if each_told in one.alone else "; it comes without these samples, too"
            print(f"{each.name}: {each_told.text} at {each_told.t:.6g} s{why}", file=sys.stderr)
    seconds = sum(one.seconds for one in found)
    alarms, events = (sum(len(one[k]) for one in found) for k in (1, 2))
    first = found[:: len(seeds)]
    healthy = f"{sum(o.healthy_alarms for o in first)}, {sum(o.healthy_events for o in first)}"
    alone = sum(len(one.alone) for one in found)
    held, asked = sum(one.held for one in found), sum(one.asked for one in found)
    return (
        f"| {each.name} | {len(found)}, {seconds:.0f} s | {COUNT * len(found)} | {healthy} | "
        f"{alarms} | {events} | {alone} | {held} of {asked} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--set", action="append", choices=list(ALL), dest="sets")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--rows", type=int, default=sys.maxsize)
    parser.add_argument("--models", type=Path)
    given = parser.parse_args()
    if given.models:
        given.models.mkdir(parents=True, exist_ok=True)
    print(
        "| set | logs | glitches | alarms, events without them | alarms more | events more | "
        "of these not where the samples are missing | intervals that hold 0 five samples later |\n"
        "|---|---|---|---|---|---|---|---|"
    )
    for name in given.sets or ALL:
        try:
            for each in ALL[name]():
                few = shortened(each, given.rows)
                print(measured(few, range(given.seeds), given.models), flush=True)
        except InputError as refusal:
            print(f"{name}: {refusal}", file=sys.stderr)


if __name__ == "__main__":
    main()
