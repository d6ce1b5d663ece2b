"""The exported step beside Python's own walk: time of a sample as a ratio, operations, memory.

python benchmarks/exported_c.py [SAMPLES]

The rig of `studies/decisions` with 7 sets of faults; both run over the same samples in one thread,
turn by turn, and the median of the ratios counts. The engine is what `estimate --engine c`
runs: all that events are found from, for this processor.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"  # before JAX is loaded

import numpy as np

from faultgauge.detection.bank import build_fault_bank
from faultgauge.detection.noise_estimation import estimate_noise
from faultgauge.detection.watch import Watch
from faultgauge.export.compile import print_step
from faultgauge.export.engine import Engine
from faultgauge.export.entry import step_of
from faultgauge.export.native import Native
from faultgauge.studies.decisions.rig import rig, true_model, window

COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
ROUNDS = 5

runs = [window(10_000 + k, seconds=4000.0).run for k in range(2)]
plant = rig()
model = true_model(plant, runs)
bank = build_fault_bank(model, runs, estimate_noise(model, runs))
log = window(10_002, seconds=float(COUNT)).run
watch = Watch(model, tuple(log.columns), log.step, bank=bank)
step = step_of(bank)
samples = {name: log.t if name == "t" else log.columns[name] for name in step.sample}


def timed(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def measure(title: str, work: Callable[[], object]) -> None:
    ratios, seconds = [], []
    for _ in range(ROUNDS):
        seconds.append(timed(work))
        ratios.append(timed(lambda: watch.along(watch.init(), log)) / seconds[-1])
    each = 1e6 * np.median(seconds) / len(log.t)
    ratio, low, high = np.median(ratios), min(ratios), max(ratios)
    print(f"{title}: {each:.0f} us a sample, Python {ratio:.2f} [{low:.2f}, {high:.2f}] times that")


watch.along(watch.init(), log)  # compiles
with tempfile.TemporaryDirectory() as folder:
    engine = Engine(Path(folder))
    took = timed(lambda: engine(watch, watch.init(), log))
    measure("engine", lambda: engine(watch, watch.init(), log))
    print(f"engine: {took:.0f} s with printing and compiling, the first time")
for precision in ("double", "single"):
    printed = print_step(step, "rig", single=precision == "single")
    for flags in (["-O2"], ["-O3"], ["-O3", "-march=native"]):
        with Native(printed, flags) as native:
            measure(f"{precision} {' '.join(flags)}", lambda: native.run(samples))
    counted = ", ".join(f"{n:,} {kind}" for kind, n in printed.operations.items())
    work = printed.bytes_of(printed.work)
    print(f"{precision}: {printed.saved_bytes:,} bytes of state and {work:,} of work; {counted}")
