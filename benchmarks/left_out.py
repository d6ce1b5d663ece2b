"""Plant files of a public benchmark compared without its test data: each training run left out in
turn, fitted on the others, and simulated.

    python benchmarks/left_out.py NAME [PLANT.toml ...] [--seeds N] [--parts K]

Where there is only one training run it is cut into K parts. Without PLANT.toml the benchmark's own
file is scored. Prints the error (RMSE of the free run in the benchmark's unit, its start from 50
samples) per part and seed, and the geometric mean per plant file.
"""

import argparse
from dataclasses import replace
from itertools import pairwise

import numpy as np

from faultgauge.identification.fit import fit
from faultgauge.identification.validation.evaluation import predict
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.telemetry import Run, cut
from faultgauge_studies.published.benchmark import Benchmark, benchmark, plant_of, records
from faultgauge_studies.published.run import error_of, mean_of

__all__ = ["error", "splits"]

WARMUP = 50  # samples


def splits(runs: list[Run], parts: int) -> list[tuple[list[Run], Run]]:
    """(runs to fit, the one left out) for every run, or for every part of a single one."""
    if len(runs) == 1:
        edges = np.linspace(0, len(runs[0].t), parts + 1).astype(int)
        runs = [
            replace(cut(runs[0], slice(a, b)), name=f"part {k}")
            for k, (a, b) in enumerate(pairwise(edges.tolist()))
        ]
    return [([each for each in runs if each is not left], left) for left in runs]


def error(chosen: Benchmark, plant: GrayBoxPlant, fitted: list[Run], left: Run, seed: int) -> float:
    """RMSE of the ensemble's mean on the run `left` out, in the benchmark's unit."""
    model, _ = fit(plant, fitted, seed=seed, refine=True, ensemble=True)
    members = [predict(m, [left], model.max_step, WARMUP) for m in (model.plant, *model.members)]
    return error_of(chosen, mean_of(members))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name")
    parser.add_argument("plants", nargs="*", metavar="PLANT.toml")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--parts", type=int, default=4)
    given = parser.parse_args()
    chosen = benchmark(given.name)
    tried = splits(list(records(chosen).train), given.parts)
    for plant in given.plants or [""]:
        found = []
        for fitted, left in tried:
            for seed in range(given.seeds):
                body = load_plant(plant) if plant else plant_of(chosen)
                found.append(error(chosen, body, fitted, left, seed))
                print(
                    f"{plant or 'own'}: {left.name}, seed {seed}: {found[-1]:.4g} {chosen.unit}",
                    flush=True,
                )
        print(f"{plant or 'own'}: geometric mean {np.exp(np.mean(np.log(found))):.4g}", flush=True)


if __name__ == "__main__":
    main()
