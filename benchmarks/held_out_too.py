"""Does it pay to fit short logs' held-out samples, too, once they have chosen? On training records.

    python benchmarks/held_out_too.py [NAME [PLANT.toml]] [--seeds N] [--parts K]

The training record is cut into K parts, each left out in turn (see left_out.py): the model as
judged on held-out samples of the others, and as fitted to those as well. Where a log is not short
by `search.SHORT` the latter is done all the same. RMSE of free runs, starts from 50 samples.
"""

import argparse

import numpy as np

import left_out
from faultgauge.identification.simulation_error import search
from faultgauge.plants.gray_box import load_plant
from faultgauge_studies.published.benchmark import benchmark, plant_of, records

VARIANTS = {"as judged": 0.0, "held-out samples too": np.inf}  # short: fewer samples than that


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="?", default="cascaded_tanks")
    parser.add_argument("plant", nargs="?", metavar="PLANT.toml")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--parts", type=int, default=4)
    given = parser.parse_args()
    chosen = benchmark(given.name)
    plant = load_plant(given.plant) if given.plant else plant_of(chosen)
    parts = left_out.splits(list(records(chosen).train), given.parts)
    for variant, short in VARIANTS.items():
        search.SHORT = short
        found = [
            left_out.error(chosen, plant, fitted, left, seed)
            for fitted, left in parts
            for seed in range(given.seeds)
        ]
        print(
            f"{variant}: geometric mean {np.exp(np.mean(np.log(found))):.3g} "
            f"[{min(found):.3g}, {max(found):.3g}] {chosen.unit}",
            flush=True,
        )


if __name__ == "__main__":
    main()
