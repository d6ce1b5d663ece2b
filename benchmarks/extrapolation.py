"""Does it help to keep networks from what parameters can do? On training records alone.

    python benchmarks/extrapolation.py [--seeds N]

Silverbox' training record is cut into windows of 512 samples. Fits take the calm ones (peak of |y|
among the lowest 40 %; every sixth of them is left out), free runs are scored on the calm ones left
out and on the wildest 15 %, with what networks leave to the physics and without. RMSE of free runs,
starts from 50 samples.
"""

import argparse

import numpy as np

import left_out
from faultgauge.identification.fit import fit
from faultgauge.identification.simulation_error import networks
from faultgauge.identification.validation.evaluation import predict
from faultgauge.telemetry import Run, cut
from faultgauge_studies.published.benchmark import benchmark, plant_of, records
from faultgauge_studies.published.run import error_of, mean_of

LENGTH, CALM, WILD, EVERY = 512, 0.4, 0.85, 6
VARIANTS = {"with": 0, "without": np.inf}  # from how many samples on


def windows() -> tuple[list[Run], dict[str, list[Run]]]:
    """(runs to fit, runs to score by name) of Silverbox."""
    (run,) = records(benchmark("silverbox")).train
    starts = np.arange(0, len(run.t) - LENGTH, LENGTH)
    peaks = np.array([np.max(np.abs(run.columns["y"][k : k + LENGTH])) for k in starts])
    pieces = [cut(run, slice(int(k), int(k) + LENGTH)) for k in starts]
    low, high = np.quantile(peaks, (CALM, WILD))
    calm = [piece for piece, peak in zip(pieces, peaks, strict=True) if peak < low]
    wild = [piece for piece, peak in zip(pieces, peaks, strict=True) if peak > high]
    fitted = [piece for k, piece in enumerate(calm) if k % EVERY]
    return fitted, {"calm": calm[::EVERY], "wild": wild}


def silverbox(seed: int) -> dict[str, float]:
    chosen = benchmark("silverbox")
    fitted, scored = windows()
    model, _ = fit(plant_of(chosen), fitted, seed=seed, refine=True, ensemble=True)
    found = {}
    for name, runs in scored.items():
        members = [
            predict(m, runs, model.max_step, left_out.WARMUP) for m in (model.plant, *model.members)
        ]
        found[name] = error_of(chosen, mean_of(members))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    seeds = range(parser.parse_args().seeds)
    for name, samples in VARIANTS.items():
        networks.TELLING = samples
        boxes = [silverbox(seed) for seed in seeds]
        for split in ("calm", "wild"):
            errors = [box[split] for box in boxes]
            print(
                f"{name}: silverbox, {split}: {np.median(errors):.3g} "
                f"[{min(errors):.3g}, {max(errors):.3g}] mV",
                flush=True,
            )


if __name__ == "__main__":
    main()
