"""How far fitted constants are off where the plant is not its model, in standard errors.

    python benchmarks/constants.py [--case NAME]... [--seeds N]

Default fits of the cases of `mismatch_rig.py` whose files have constants with a true counterpart,
to three healthy logs a seed. For each constant: by how many standard errors it is off, by chance
alone and by those that are printed, which hold the model's errors, too; and how much larger these
are. Last the shares that are off by no more than two and three, and of `equal`, whose plant is its
model, the median by which standard errors grow.
"""

import argparse

import numpy as np

from faultgauge.identification.fit import fit
from mismatch.harness import FIT
from mismatch_rig import CASES

TRUE = {
    "equal": {"k": 0.005, "c": 0.001, "a1": 0.005, "a2": 0.00375, "Ta": 23.0},
    "heaters": {"a1": 0.005, "a2": 0.00375, "Ta": 23.0},
    "tanks2_2": {"k": 0.1, "c1": 0.09, "c2": 0.085},
    "tanks2_5": {"k": 0.1, "c1": 0.09, "c2": 0.085},
    "lag": {"g": 2.0, "tau": 10.0},
    "meter": {"k": 0.01, "c": 0.04},
    "slow_sensor": {"g": 0.02, "c": 1 / 40, "e": 1 / 80, "k": 1 / 200, "room": 23.0},
    "servo": {"K": 20.0, "b": 1.5, "Fc": 6.0},
    "bench_heaters": {"heat1": 0.032 / 6.5, "heat2": 0.02 / 6.5, "cross": 0.02 / 6.5},
    "reaction_wheel": {"gain": 0.97, "Fc": 1.5e-3},
    "satellite": {"a": 1 / 0.9, "drag": 0.004},
    "battery": {"R0": 0.025, "k": 0.2, "C": 67.2},
    "pump_loop": {"head": 18.0, "k": 2.5**-0.5, "c": 0.9, "lag": 2.5},
    "cylinder": {
        "push": 0.2,
        "b": 5.0,
        "spring": 40.0,
        "weight": 1.0,
        "Fc": 1.2,
        "flow": 950.0,
        "squeeze": 19000.0,
        "leak": 15.2,
    },
    "conveyor": {"a": 9.0, "b": 1.5, "Fc": 25.0, "F0": 250.0, "roll": 0.35},
    "dc_motor": {"R": 1.6, "L": 0.012, "k": 0.12, "b": 1.5e-4, "Fc": 0.03, "J": 2.2e-4},
    "two_mass": {
        "Jm": 4e-4,
        "Jl": 1.2e-3,
        "K": 2.0,
        "bm": 1.5e-3,
        "bl": 1e-3,
        "Fm": 0.04,
        "Fl": 0.03,
    },
}
LOGS = 3


def offs(name: str, seed: int) -> list[tuple[float, float, float]]:
    """(off by chance's errors, off by those printed, their ratio) of each constant."""
    case, found = CASES[name](), []
    logs = [
        case.log(f"fit {k}", np.random.default_rng([FIT, k]))
        for k in range(LOGS * seed, LOGS * (seed + 1))
    ]
    account = fit(case.plant, logs)[1]
    known = account.refinement.information if account.refinement else account.information
    assert known is not None
    print(f"{name}, seed {seed}{' (refined)' if account.refinement else ''}:")
    for each in known.constants:
        true = TRUE[name].get(each.name)
        if true is None or not each.standard_error or not each.by_chance:
            continue
        off = abs(each.value - true)
        found.append(
            (
                off / each.by_chance,
                off / each.standard_error,
                each.standard_error / each.by_chance,
            )
        )
        print(
            f"  {each.name} {each.value:.4g} +- {each.standard_error:.2g} for {true:.4g}: "
            f"{found[-1][0]:.1f} by chance, {found[-1][1]:.1f} as printed"
        )
    for each in known.late:
        print(f"  {each}")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", action="append", choices=list(TRUE))
    parser.add_argument("--seeds", type=int, default=1)
    given = parser.parse_args()
    every = {
        name: np.array([row for seed in range(given.seeds) for row in offs(name, seed)])
        for name in given.case or TRUE
    }
    unlike = [rows for name, rows in every.items() if name != "equal"]
    if unlike:
        rows = np.concatenate(unlike)
        for k, what in enumerate(("by chance", "as printed")):
            print(
                f"{what}, of {len(rows)} constants: median {np.median(rows[:, k]):.1f}, "
                + ", ".join(f"within {n}: {np.mean(rows[:, k] <= n):.0%}" for n in (2, 3))
            )
    if "equal" in every:
        print(f"equal: {np.median(every['equal'][:, 2]):.2f} times as large in the median")


if __name__ == "__main__":
    main()
