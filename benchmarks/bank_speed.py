"""Throughput of the bank: a million samples with 8 and with 37 hypotheses, each in one process.

python benchmarks/bank_speed.py [SAMPLES]

Beside the sets of faults that are counted here run an agile mode per fault and three unknown ones.
"""

import sys
import time
from dataclasses import replace

from decision_studies.rig import rig, true_model, window
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.calibration.noise_estimation import estimate_noise
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.watch import Watch
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.signals import Fault

COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
MORE = (
    Fault("gain_p", "gain", "p"),
    Fault("gain_q", "gain", "q"),
    Fault("leak_a", "state", "a"),
    Fault("leak_b", "state", "b"),
)

runs = [window(10_000 + k, seconds=4000.0).run for k in range(2)]
base = rig()
noise = estimate_noise(true_model(base, runs), runs)
long = window(10_002, seconds=float(COUNT)).run
for faults in (base.signals.faults[:3], (*base.signals.faults, *MORE)):
    signals = replace(base.signals, faults=faults)
    plant = GrayBoxPlant(signals, base.spec, base.networks, base.parameters)
    bank = build_fault_bank(true_model(plant, runs), runs, noise)
    watch = Watch(bank.model, tuple(long.columns), long.step, bank=bank)
    watch.along(watch.init(), prepared(watch.signals, runs[0]))  # compiles
    rows = prepared(watch.signals, long)
    wall, cpu = time.perf_counter(), time.process_time()
    watch.along(watch.init(), rows)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    sets = len(set(bank.sets))
    print(
        f"{sets} sets of faults ({len(bank.sets) + 3} modes), {len(long.t)} samples: {wall:.1f} s, "
        f"of the processor {cpu:.1f} s ({1e6 * cpu / len(long.t):.0f} us a sample)"
    )
