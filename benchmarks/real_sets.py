"""The measured healthy sets made ready to rehearse: a plant file with a bias declared on every
input and output, runs to fit, runs to calibrate, and healthy runs that neither has seen.

    python benchmarks/real_sets.py [--set NAME]... [--trials N] [--json FILE]
    python benchmarks/real_sets.py --list

fits and calibrates each set and rehearses its faults in runs that neither has seen; `--list` prints
what each set holds. A set of one record is split in time. The plant files are those that
are shipped for `faultgauge benchmark`; a bias may be as large as half of the signal's range in the
runs to fit. CrazyPAD's healthy flights give five sets, each flight left out of the other four in
turn: trims differ between flights, and fewer would not tell by how much. Set FAULTGAUGE_DATA to the
folder that holds the records.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.posterior.uncalibrated import level_in
from faultgauge.errors import InputError
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.rehearsal.rehearse import TRIALS, rehearse
from faultgauge.telemetry import Run, cut
from faultgauge_studies.published import data
from faultgauge_studies.published.benchmark import plant_text
from faultgauge_studies.published.crazypad import case_of
from faultgauge_studies.published.faulted_data import flights

__all__ = ["HALVES", "SETS", "RealSet", "split", "with_biases"]

HALVES = (0.5, 0.75, 1.0)  # of one record: fitted, calibrated, rehearsed on
FITTED = 0.6  # of each of several runs; the rest calibrates


class RealSet(NamedTuple):
    """A plant file's text with its biases, and the runs."""

    name: str
    plant: str
    fit: list[Run]
    calibrate: list[Run]
    rehearse: list[Run]

    def body(self) -> GrayBoxPlant:
        """The plant, untrained."""
        return GrayBoxPlant.untrained(parse_plant(self.plant, self.name))


def with_biases(text: str, runs: Sequence[Run]) -> str:
    """A plant file's `text` with a fault `NAME_bias` on each input and output, of up to half of the
    range that the signal has in `runs`."""
    signals = parse_plant(text, "a shipped plant file").signals
    added = []
    for enters, each in [
        *(("input", each) for each in signals.inputs),
        *(("output", each) for each in signals.outputs),
    ]:
        values = np.concatenate([run.columns[each.name] for run in runs])
        half = float(f"{(np.nanmax(values) - np.nanmin(values)) / 2:.2g}")
        unit = f'unit = "{each.unit}"\n' if each.unit else ""
        added.append(
            f'[faults.{each.name}_bias]\nenters = "{enters}"\ntarget = "{each.name}"\n'
            f"{unit}min = {-half:g}\nmax = {half:g}\n"
        )
    return "\n".join([text, *added])


def emps() -> list[RealSet]:
    """The nominal record in three parts: half, a quarter, a quarter."""
    run = data.emps()["train"].run("nominal", "emps", "q")
    fit, calibrate, rehearse = split(run, *HALVES)
    return [_set("emps", [fit], [calibrate], [rehearse])]


def cascaded_tanks() -> list[RealSet]:
    """Fitted on the training record; the halves of the test record calibrate and are rehearsed on:
    a whole record is too short to be split and fitted."""
    found = data.tanks()
    fit = found["train"].run("train", "cascaded_tanks", "y")
    first, second = split(found["test"].run("test", "cascaded_tanks", "y"), 0.5, 1.0)
    return [_set("cascaded_tanks", [fit], [first], [second])]


def silverbox() -> list[RealSet]:
    """Multisines: fitted on the benchmark's training part, the halves of the test part calibrate
    and are rehearsed on."""
    whole = data.silverbox()["whole"]
    fit = whole.part(40650, 105712).run("multisines", "silverbox", "y")
    first, second = split(whole.part(105712, 127400).run("later", "silverbox", "y"), 0.5, 1.0)
    return [_set("silverbox", [fit], [first], [second])]


def wiener_hammerstein_2009() -> list[RealSet]:
    """Fitted on the benchmark's training part, the halves of what it scores calibrate and are
    rehearsed on."""
    whole, name = data.wiener_hammerstein()["whole"], "wiener_hammerstein_2009"
    fit = whole.part(0, 100000).run("first", name, "y")
    first, second = split(whole.part(105200, 184000).run("later", name, "y"), 0.5, 1.0)
    return [_set(name, [fit], [first], [second])]


def quarter_drone() -> list[RealSet]:
    """Fitted on the first 60 % of the benchmark's four training runs, calibrated on the rest of
    them, rehearsed on the two that it tests with."""
    runs = {n: each.run(n, "quarter_drone", "theta") for n, each in data.quarter_drone().items()}
    tests = [runs.pop("swept_sine"), runs.pop("rig_sequence")]
    fit, calibrate = zip(*(split(run, FITTED, 1.0) for run in runs.values()), strict=True)
    return [_set("quarter_drone", list(fit), list(calibrate), tests)]


def crazypad() -> list[RealSet]:
    """Each healthy flight left out; the other four are fitted and calibrated on."""
    healthy = [run for name, run in flights().items() if case_of(name).kind == "healthy"]
    found = []
    for left in healthy:
        others = [run for run in healthy if run is not left]
        each = _set("crazypad", others, others, [left])
        found.append(each._replace(name=f"crazypad, without {left.name}"))
    return found


SETS: dict[str, Callable[[], list[RealSet]]] = {
    each.__name__: each
    for each in (
        emps,
        cascaded_tanks,
        silverbox,
        wiener_hammerstein_2009,
        quarter_drone,
        crazypad,
    )
}


def _set(name: str, fit: list[Run], calibrate: list[Run], rehearse: list[Run]) -> RealSet:
    return RealSet(name, with_biases(plant_text(name), fit), fit, calibrate, rehearse)


def split(run: Run, *ends: float) -> list[Run]:
    """`run` cut at shares of its length, each part under a name of its own."""
    edges = [0, *(round(end * len(run.t)) for end in ends)]
    parts = enumerate(pairwise(edges))
    return [replace(cut(run, slice(a, b)), name=f"{run.name} {k + 1}") for k, (a, b) in parts]


def _seconds(runs: Sequence[Run]) -> str:
    return ", ".join(f"{run.name} {run.t[0]:.4g} to {run.t[-1]:.4g} s" for run in runs)


def listed(each: RealSet) -> None:
    print(f"{each.name}")
    print(f"  fit: {_seconds(each.fit)}\n  calibrate: {_seconds(each.calibrate)}")
    print(f"  rehearse: {_seconds(each.rehearse)}")
    for fault in each.body().signals.faults:
        bounds = f"{fault.min:g} to {fault.max:g} {fault.unit}".rstrip()
        print(f"  {fault.name}: {fault.enters} {fault.target}, {bounds}")


def rehearsed(each: RealSet, trials: int) -> dict[str, object]:
    """Fit, calibrate and rehearse one set with seed 0; prints what a user would read."""

    said_before = [""]

    def progress(text: str) -> None:
        if text != said_before[0]:
            print(f"{each.name}: {text}", file=sys.stderr, flush=True)
        said_before[0] = text

    times = [time.perf_counter()]
    model, _ = fit(each.body(), each.fit, seed=0, progress=progress)
    times.append(time.perf_counter())
    found = calibrate(model, each.calibrate, progress=progress)
    times.append(time.perf_counter())
    said = rehearse(found.model, each.rehearse, trials=trials, progress=progress)
    times.append(time.perf_counter())
    bank = level_in(found.model)
    own = bank.model_dump(include={"widened", "level", "memory_s"})
    fit_s, calibrate_s, rehearse_s = (b - a for a, b in pairwise(times))
    took = {"fit_s": fit_s, "calibrate_s": calibrate_s, "rehearse_s": rehearse_s}
    print(f"== {each.name}: {own}, {took}\n{said}\n", flush=True)
    return {"set": each.name, **own, **took, "rehearsal": said.as_dict()}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--set", action="append", choices=list(SETS), dest="sets")
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    results = []
    for name in given.sets or SETS:
        try:
            sets = SETS[name]()
        except InputError as refusal:
            print(f"{name}: {refusal}")
            continue
        for each in sets:
            if given.list:
                listed(each)
            else:
                results.append(rehearsed(each, given.trials))
    if given.json:
        given.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
