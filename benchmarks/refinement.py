"""What simulation error is worth beside equation error, where a plant is not its model.

    python benchmarks/refinement.py [--case NAME]...

Each case of `mismatch_rig.py` is fitted to its healthy logs both ways (`fit --no-refine`, `fit
--refine`). Free runs through healthy logs that no fit has seen are off by a share of each output's
standard deviation, root mean square over the outputs. A case that only simulation error can fit has
no first figure.
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from faultgauge.errors import InputError
from faultgauge.identification.fit import fit
from faultgauge.identification.validation.evaluation import evaluate
from mismatch.case import Case
from mismatch.harness import healthy_logs
from mismatch_rig import CASES

WAYS = {"equation error": False, "simulation error": True}
ALIKE = 1.05  # times: as good


def measured(case: Case, refine: bool) -> tuple[float, float] | None:
    """(what free runs are off by, seconds of the fit); None where equation error cannot fit the
    file."""
    logs, unseen = healthy_logs(case)
    begun = time.perf_counter()
    try:
        model, _ = fit(case.plant, logs, refine=refine)
    except InputError:
        return None
    seconds = time.perf_counter() - begun
    found, _ = evaluate(model.plant, unseen, model.max_step, between=model.record.between)
    shares = [each["nrmse"] for each in found["outputs"].values() if each["nrmse"] is not None]
    return float(np.sqrt(np.mean(np.square(shares)))), seconds


def both_ways(name: str) -> list[tuple[float, float] | None]:
    return [measured(CASES[name](), refine) for refine in WAYS.values()]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", action="append", choices=list(CASES))
    both, better, worse = 0, 0, 0
    names = parser.parse_args().case or list(CASES)
    # a process for each case: compiled programs of all of them take several GB
    pool = ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1)
    for name, found in zip(names, pool.map(both_ways, names), strict=True):
        told = [
            f"{way} -" if each is None else f"{way} {each[0]:.3g} ({each[1]:.1f} s)"
            for way, each in zip(WAYS, found, strict=True)
        ]
        print(f"{name}: {', '.join(told)}", flush=True)
        plain, refined = found
        if plain is not None and refined is not None:
            both += 1
            better += refined[0] < plain[0] / ALIKE
            worse += refined[0] > plain[0] * ALIKE
    print(f"simulation error is better in {better} of {both} cases, worse in {worse}")


if __name__ == "__main__":
    main()
