"""What the detectability sheet foretells beside what a rehearsal finds.

    python benchmarks/detectability.py [--set NAME]... [--case NAME]... [--trials N] [--out FOLDER]

Sets are those of `real_sets.py`, cases those of `mismatch_rig.py`: each is fitted and calibrated
with seed 0, and its faults are rehearsed in healthy logs that neither has seen. For each fault: the
size that `rehearse` found 90 % of the time over the one that the sheet foretells for 90 % of onsets
in the same windows. With `--out`, `detectability.svg` shows all sizes. Set FAULTGAUGE_DATA to the
folder that holds the records.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.identification.fit import fit
from faultgauge.plants.model import Model
from faultgauge.rehearsal.rehearse import rehearse
from faultgauge.reporting import style
from faultgauge.reporting.svg import Figure, figure
from faultgauge.telemetry import Run
from mismatch.harness import CALIBRATE, CALIBRATIONS, FIT, HEALTHY, calibrated
from mismatch_rig import CASES
from real_sets import SETS

__all__ = ["Compared", "compared", "scatter"]

TRIALS = 60
REHEARSED = 3  # healthy logs of a case


class Compared(NamedTuple):
    """A fault's sizes [its unit]: found 90 % of the time by the rehearsal (`at_most`: or less), and
    foretold along the log; None: none."""

    where: str
    fault: str
    unit: str
    found: float | None
    at_most: bool
    along: float | None

    @property
    def ratio(self) -> float | None:
        return self.found / self.along if self.found and self.along else None


def compared(where: str, model: Model, runs: Sequence[Run], trials: int) -> list[Compared]:
    """What is foretold in the rehearsal's own windows beside what it finds."""
    result = rehearse(model, runs, trials=trials, progress=lambda s: print(s, file=sys.stderr))
    return [
        Compared(
            where,
            each.name,
            each.unit,
            None if each.smallest is None else each.smallest.size,
            each.smallest is not None and each.smallest.at_most,
            each.along,
        )
        for each in result.faults
    ]


def scatter(rows: Sequence[Compared]) -> Figure:
    """Found over foretold, of all faults that have both, on logarithmic axes."""
    points = [(each.along, each.found) for each in rows if each.found and each.along]
    foretold, found = np.array(points or [(np.nan, np.nan)]).T
    with style.drawing():
        canvas, (axes,) = style.panels((5.0,))
        axes.plot(foretold, found, "o", markersize=5)
        sizes = [size for point in points for size in point]
        ends = np.array([min(sizes, default=1.0) / 2, max(sizes, default=1.0) * 2])
        axes.plot(ends, ends, color=style.GREY, linewidth=0.8)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("smallest size foretold (the fault's unit)")
        axes.set_ylabel("found 90 % of the time (the fault's unit)")
        return figure(canvas, "Foretold and found", "Each fault of each set.")


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
                + f"; foretold {_shown(each.along)} (found / foretold {_shown(each.ratio)})",
                flush=True,
            )
    known = [r for each in rows if (r := each.ratio) is not None]
    if known:
        print(f"found / foretold: median {np.median(known):.3g} of {len(known)}")
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / "detectability.svg").write_text(scatter(rows).svg)
        text = json.dumps([each._asdict() for each in rows], indent=1)
        (given.out / "detectability.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
