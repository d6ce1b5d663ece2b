"""What the detectability sheet foretells beside what a rehearsal finds.

    python benchmarks/detectability.py [--set NAME]... [--case NAME]... [--trials N] [--out FOLDER]

Sets are those of `real_sets.py`, cases those of `mismatch_rig.py`: each is fitted and calibrated
with seed 0, and its faults are rehearsed in healthy logs that neither has seen. For each fault: the
size that `rehearse` found 90 % of the time over the one that the sheet foretells for 90 % of onsets
in the same windows, and over the median over these windows of what the middle of the training
envelope foretells. With `--out`, `detectability.svg` shows all sizes. Set FAULTGAUGE_DATA to the
folder that holds the records.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from faultgauge.detection.answer import least_told
from faultgauge.detection.bank import build_fault_bank
from faultgauge.detection.calibration import calibrate
from faultgauge.detection.noise import noise_of
from faultgauge.detection.smallest import smallest_along
from faultgauge.identification.fit import fit
from faultgauge.plants.model import Model
from faultgauge.rehearsal.design import MIDDLE, windows_of
from faultgauge.rehearsal.rehearse import rehearse
from faultgauge.reporting import style
from faultgauge.reporting.svg import Figure, figure
from faultgauge.telemetry import Run
from mismatch.harness import CALIBRATE, CALIBRATIONS, FIT, HEALTHY, calibrated
from mismatch_rig import CASES
from real_sets import SETS

__all__ = ["Compared", "compared", "scatter"]

TRIALS = 60
WINDOWS = 4  # at most, in which sizes are foretold
ONSETS = np.linspace(*MIDDLE, 7)  # shares of a window: where a rehearsal's faults begin
FOUND = 0.9
REHEARSED = 3  # healthy logs of a case


class Compared(NamedTuple):
    """A fault's sizes [its unit]: found 90 % of the time by the rehearsal (`at_most`: or less),
    foretold along the log, and by the middle of the envelope; None: none."""

    where: str
    fault: str
    unit: str
    found: float | None
    at_most: bool
    along: float | None
    middle: float | None

    def ratio(self, foretold: float | None) -> float | None:
        return self.found / foretold if self.found and foretold else None


def compared(where: str, model: Model, runs: Sequence[Run], trials: int) -> list[Compared]:
    """What is foretold in the rehearsal's own windows beside what it finds."""
    windows = windows_of(runs)[0]
    places = np.unique(np.linspace(0, len(windows) - 1, WINDOWS).astype(int))
    sizes = list[list[float | None]]()
    middle = list[list[float | None]]()
    for k in places:
        bank = build_fault_bank(model, [windows[k]], noise_of(model))
        sizes += [smallest_along(bank, windows[k], float(share)) for share in ONSETS]
        middle.append([least_told(bank, windows[k], j) for j in range(len(bank.size))])
    result = rehearse(model, runs, trials=trials, progress=lambda s: print(s, file=sys.stderr))
    found = {each.name: each.smallest for each in result.faults}
    rows = []
    for k, fault in enumerate(model.plant.signals.faults):
        smallest = found.get(fault.name)
        rows.append(
            Compared(
                where,
                fault.name,
                fault.unit,
                None if smallest is None else smallest.size,
                smallest is not None and smallest.at_most,
                _quantile([each[k] for each in sizes], FOUND),
                _quantile([each[k] for each in middle], 0.5),
            )
        )
    return rows


def _quantile(sizes: Sequence[float | None], share: float) -> float | None:
    """Of sizes, where no size counts as the largest."""
    value = np.quantile(
        [np.inf if size is None else size for size in sizes], share, method="higher"
    )
    return float(value) if np.isfinite(value) else None


def scatter(rows: Sequence[Compared]) -> Figure:
    """Found over foretold, of all faults that have both, on logarithmic axes."""
    shown = [each for each in rows if each.found and each.along]
    with style.drawing():
        canvas, (axes,) = style.panels((5.0,))
        for which, marker, label in (("along", "o", "along the log"), ("middle", "x", "middle")):
            points = [(y, each.found) for each in shown if (y := getattr(each, which))]
            if points:
                x, y = np.array(points).T
                axes.plot(x, y, marker, markersize=5, label=label)
        sizes = [each.found for each in shown] + [each.along for each in shown]
        ends = np.array([min(sizes, default=1.0) / 2, max(sizes, default=1.0) * 2])  # type: ignore[type-var]
        axes.plot(ends, ends, color=style.GREY, linewidth=0.8)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("smallest size foretold (the fault's unit)")
        axes.set_ylabel("found 90 % of the time (the fault's unit)")
        style.legend(axes)
        caption = "Each fault of each set twice: foretold along the log, and by its middle."
        return figure(canvas, "Foretold and found", caption)


def _subjects(sets: Sequence[str], cases: Sequence[str]) -> Iterator[tuple[str, Model, list[Run]]]:
    """(name, calibrated model, healthy runs that it has not seen)."""
    for name in sets:
        for each in SETS[name]():
            model, _ = fit(each.body(), each.fit, seed=0)
            yield each.name, calibrate(model, each.calibrate).model, each.rehearse
    for name in cases:
        case = CASES[name]()
        fitted = [case.log(f"fit {k}", _seed(FIT, k)) for k in range(case.fits)]
        sound = [case.log(f"calibrate {k}", _seed(CALIBRATE, k)) for k in range(CALIBRATIONS)]
        model, _ = calibrated(case.plant, fitted, sound, {})
        logs = [case.log(f"healthy {k}", _seed(HEALTHY, k)) for k in range(REHEARSED)]
        yield name, model, logs


def _seed(kind: int, k: int) -> np.random.Generator:
    """That of a log of `mismatch_rig.py`."""
    return np.random.default_rng((kind, k))


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--set", action="append", choices=list(SETS), dest="sets")
    parser.add_argument("--case", action="append", choices=list(CASES), dest="cases")
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    every = not (given.sets or given.cases)
    sets, cases = (given.sets or [], given.cases or []) if not every else (SETS, CASES)
    rows = list[Compared]()
    for where, model, runs in _subjects(list(sets), list(cases)):
        new = compared(where, model, runs, given.trials)
        rows += new
        for each in new:
            found = f"{'<= ' if each.at_most else ''}{_shown(each.found)}"
            print(
                f"{where}: {each.fault}: found {found} {each.unit}".rstrip()
                + f"; along the log {_shown(each.along)} (found / foretold "
                f"{_shown(each.ratio(each.along))}), middle {_shown(each.middle)} "
                f"({_shown(each.ratio(each.middle))})",
                flush=True,
            )
    known = [r for each in rows if (r := each.ratio(each.along)) is not None]
    if known:
        print(f"found / foretold along the log: median {np.median(known):.3g} of {len(known)}")
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / "detectability.svg").write_text(scatter(rows).svg)
        text = json.dumps([each._asdict() for each in rows], indent=1)
        (given.out / "detectability.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
