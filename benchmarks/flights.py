"""A campaign of closed-loop flights on whatever JAX sees: time, memory and cost of one.

    python benchmarks/flights.py [--count N ...] [--seconds S] [--float32] [--together N]
                                 [--batch rows|vmap] [--json FILE]

The paper's satellite slews and holds for S seconds (by default 1000, 4000 control periods), its
start, inertia, disturbances and wheels dispersed; a third of the flights has friction in a wheel, a
third a loss of its motor's gain, from an onset on. Compiling is told apart. Memory is the most that
the process (of an accelerator: the device) ever held, so let counts grow. With `--float32` the same
flights are flown in single precision, too, and what it changes is told: of each figure the median
and the largest change, as a share of the median of the figure. Of a processor, threads are as many
as the process may use cores: `taskset -c 0,1` for two.
"""

import argparse
import json
import os
import resource
import time
from pathlib import Path
from typing import Any

from faultgauge.settings import COMPILER

os.environ.setdefault("XLA_FLAGS", COMPILER)  # before JAX is loaded

import jax
import numpy as np

from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.satellite.flights import Chance, Flown, Spread, flights
from faultgauge.simulation.satellite.observatory import paper_satellite

SPREAD = Spread(angles=2.0, momenta=5.0, inertia=0.02, disturbance=0.2, constants=0.1)
CHANCES = (Chance("state", "h", 0.02, 0.2), Chance("gain", "u", 0.05, 0.5))
SETTLED = 0.4  # share of a flight
FIGURES = ("pointing_rms", "knowledge_rms", "momentum_peak", "residual_after")


def flown(
    count: int, seconds: float, together: int | None, single: bool, apart: bool | None
) -> Flown:
    return flights(
        paper_satellite(load_plant("reaction_wheel")),
        count,
        seconds,
        spread=SPREAD,
        chances=CHANCES,
        settled=SETTLED * seconds,
        together=together,
        single=single,
        apart=apart,
    )


def measured(
    count: int, seconds: float, together: int | None, single: bool, apart: bool | None
) -> dict[str, Any]:
    """A row, and under "flown" what the flights were."""
    device = jax.devices()[0]
    start = time.perf_counter()
    flown(
        count, 0.25, together, single, apart
    )  # a step: it compiles, and flies as little as it can
    compiled = time.perf_counter() - start
    start, began = time.perf_counter(), time.process_time()
    found = flown(count, seconds, together, single, apart)
    wall, busy = time.perf_counter() - start, time.process_time() - began
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    if device.platform != "cpu":
        held = (device.memory_stats() or {}).get("peak_bytes_in_use", 0)
    return {
        "device": f"{device.device_kind}, {device.platform}",
        "cores": len(os.sched_getaffinity(0)),
        "precision": "float32" if single else "float64",
        "flights": count,
        "seconds": seconds,
        "first_call_s": compiled,
        "wall_s": wall,
        "processor_s": busy,
        "ms_a_flight": 1e3 * wall / count,
        "times_real_time": count * seconds / wall,
        "peak_bytes": held,
        "flown": found,
    }


def changes(exact: Flown, single: Flown) -> dict[str, tuple[float, float]]:
    """(median, largest) of each figure's change, as a share of the figure's median."""
    told = {}
    for name in FIGURES:
        a, b = (np.asarray(getattr(each, name), float) for each in (exact, single))
        apart = np.abs(a - b)[np.isfinite(a)] / np.nanmedian(a)
        told[name] = float(np.median(apart)), float(apart.max())
    return told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, nargs="+", default=[256, 1000])
    parser.add_argument("--seconds", type=float, default=1000.0)
    parser.add_argument("--together", type=int, help="flights at once; by default what suits")
    parser.add_argument("--float32", action="store_true", help="single precision beside double")
    parser.add_argument("--batch", choices=("rows", "vmap"), help="by default what suits")
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    apart = None if arguments.batch is None else arguments.batch == "rows"
    if all(device.platform == "cpu" for device in jax.devices()):
        print("JAX sees no GPU here: this is the processor.")
    print(f"{', '.join(map(str, jax.devices()))}; jax {jax.__version__}; {os.cpu_count()} CPUs")
    rows = []
    for count in arguments.count:
        found = []
        for single in (False, True)[: 1 + arguments.float32]:
            row = measured(count, arguments.seconds, arguments.together, single, apart)
            found.append(row.pop("flown"))
            rows.append(row)
            print(
                f"{row['flights']:>8,} flights of {row['seconds']:g} s, {row['precision']}: "
                f"{row['wall_s']:.2f} s ({row['processor_s']:.2f} s of the processor), "
                f"{row['ms_a_flight']:.4f} ms a flight, "
                f"{row['times_real_time']:,.0f} times real time; first call "
                f"{row['first_call_s']:.1f} s; {row['peak_bytes'] / 2**20:,.0f} MiB; "
                f"{row['device']}, {row['cores']} cores",
                flush=True,
            )
        if arguments.float32:
            rows[-1]["changes"] = told = changes(*found)
            for name, (median, largest) in told.items():
                print(f"         float32 changes {name}: {median:.1e} (at most {largest:.1e})")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
