"""How good the whole log's answer is: error of the size over the Cramer-Rao bound, and coverage.

python benchmarks/retrospective.py [--records N] [--flights N] [--svg FILE]

Seeds 0 to N - 1, by default 100 linear records and 100 flights. `--svg` draws the errors.
"""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from decision_studies.hindsight import Hindsight, linear_hindsight, wheel_hindsight
from decision_studies.optimal import linear_bank
from decision_studies.wheel import wheel_bank
from faultgauge_studies import merit


def rms(values: Sequence[float]) -> float:
    return merit.rms(np.array(values))


def told(name: str, measure: Callable[[int], Hindsight], count: int) -> list[Hindsight]:
    every = [measure(seed) for seed in range(count)]
    found = [each for each in every if each.named]
    print(f"{name}: named {len(found)} of {count}")
    error = [each.error for each in found]
    half = 1.96 * rms(error) / np.sqrt(2 * len(error))
    print(f"  RMSE of the size over the bound, onset unknown: {rms(error):.2f} +- {half:.2f}")
    print(f"  over the bound, onset known: {rms([each.told_onset for each in found]):.2f}")
    print(f"  the bank's last estimate, over the first: {rms([e.online for e in found]):.2f}")
    print(f"  RMSE of the onset: {rms([each.onset_error for each in found]):.3g} s")
    print(
        f"  coverage of 95 % intervals: size {np.mean([e.size_covered for e in found]):.3f}, ",
        end="",
    )
    print(f"onset {np.mean([e.onset_covered for e in found]):.3f}")
    delay = [each.delay for each in found]
    print(f"  told online after {np.median(delay):.3g} s [{min(delay):.3g}, {max(delay):.3g}]")
    return found


def draw(path: Path, parts: dict[str, list[Hindsight]]) -> None:
    from faultgauge.reporting.relations import relation

    ordered = {name: np.sort([e.error for e in part]) for name, part in parts.items()}
    count = max(len(each) for each in ordered.values())
    x = np.linspace(0, 1, count)
    curves = {n: np.interp(x, np.linspace(0, 1, len(e)), e) for n, e in ordered.items()}
    picture = relation(
        x,
        curves,
        title="Size in hindsight",
        x_name="share of seeds",
        x_unit="",
        y_name="error over the bound",
        y_unit="sd",
    )
    path.write_text(picture.svg)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=100)
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--svg", type=Path)
    given = parser.parse_args()
    parts = dict[str, list[Hindsight]]()
    if given.records:
        lag = linear_bank(walk=None)
        parts["linear"] = told("linear", lambda seed: linear_hindsight(lag, seed), given.records)
    if given.flights:
        wheel = wheel_bank()
        parts["wheel"] = told("wheel", lambda seed: wheel_hindsight(wheel, seed), given.flights)
    if given.svg:
        draw(given.svg, parts)
