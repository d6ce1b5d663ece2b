"""The wheel whose sine disturbance stands in its plant file, under eq (17): RMSE of the fault.

python benchmarks/harmonic_wheel.py [--flights N] [--out FOLDER]

Seeds 0 to N - 1, by default 20; beside it the same by the plant file without the sine. With
`--out` a figure of seed 0.
"""

import argparse
from pathlib import Path

import numpy as np

from decision_studies.harmonic import PRESETS, Flown, harmonic_bank, intermittent
from faultgauge.reporting.time_figures import Panel, panels
from faultgauge_studies import merit


def measured(preset: str, flights: int) -> Flown:
    """All flights, printed; the first one."""
    bank = harmonic_bank(preset)
    found = [intermittent(bank, seed) for seed in range(flights)]
    for name, unit in (("rmse", "N*m"), ("settling_s", "s"), ("overshoot", "of the jump")):
        values = [getattr(each.quality, name) for each in found]
        spread = f"{np.median(values):.3g} [{min(values):.3g}, {max(values):.3g}]"
        print(f"{preset}: {name} {spread} {unit}, {flights} flights")
    return found[0]


def draw(found: dict[str, Flown], path: Path) -> None:
    first = found[PRESETS[0]]
    t, truth = first.decision.run.t, first.truth
    near = t >= 450.0
    estimates = {name: each.estimate[near] for name, each in found.items()}
    scored = merit.settled(t, merit.edges_of(truth), 50.0)[near]
    errors = {
        name: np.where(scored, each.estimate[near] - truth[near], np.nan)
        for name, each in found.items()
    }
    stack = [
        Panel("friction fault", "N*m", {"true": truth[near], **estimates}),
        Panel("error, scored", "N*m", errors),
    ]
    picture = panels(t[near], stack, title="Eq (17) beside a sine of unknown amplitude", caption="")
    path.write_text(picture.svg)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=20)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    flown = {preset: measured(preset, given.flights) for preset in PRESETS}
    if given.out:
        draw(flown, given.out / "harmonic_wheel.svg")
