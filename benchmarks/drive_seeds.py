"""The demonstration's figures over seeds 0..N-1: median and range of each.

python benchmarks/drive_seeds.py [N]
"""

import sys

import numpy as np

from faultgauge_studies.drive import BODIES, measured_logs, run_drive

logs = measured_logs()
if logs is None:
    sys.exit("set FAULTGAUGE_DATA to the folder that holds emps/")
seeds = range(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
for body in BODIES:
    figures = [run_drive(logs, body, seed=seed).figures for seed in seeds]
    for key in figures[0]:
        values = [row[key] for row in figures]
        print(f"{body}: {key}: {np.median(values):.4g} [{min(values):.4g}, {max(values):.4g}]")
