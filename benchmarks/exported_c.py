"""The exported step beside Python's own walk and filterpy's EKF: time of a sample as a ratio.

python benchmarks/exported_c.py [SAMPLES]

The rig of `decision_studies` with three faults: 8 sets, the unknown one included. All run over the
same samples in one thread, turn by turn, and the median of the ratios counts, by the clock of the
process. The engine is what `estimate --engine c` runs: all that events are found from, for this
processor. Where filterpy is installed (`pip install faultgauge[peers]`) its EKF of the rig's states
alone, without any fault, runs beside. The engine is also timed over a window with two faults, where
all branches of the bank live. Where arm-none-eabi-gcc is installed, the size of the float build for
a Cortex-M4 is told. Last an ESO over the wheel with two networks (IESONN).
"""

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from faultgauge.detection.rows.prepared import prepared
from faultgauge.settings import COMPILER

os.environ["XLA_FLAGS"] = COMPILER  # before JAX is loaded

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from decision_studies.rig import rig, true_model, window
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.calibration.noise_estimation import estimate_noise
from faultgauge.detection.watch import Watch
from faultgauge.export.compile import ExportedStep, Printed, print_step
from faultgauge.export.engine import Engine
from faultgauge.export.entry import step_of
from faultgauge.export.native import FASTER, Native
from faultgauge.export.sources import header, step_source, table_source
from faultgauge.observers.eso import ExtendedStateObserver
from faultgauge.observers.observer import ObserverState
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant

COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
ROUNDS = 5

runs = [window(10_000 + k, seconds=4000.0).run for k in range(2)]
base = rig()
noise = estimate_noise(true_model(base, runs), runs)
signals = replace(base.signals, faults=base.signals.faults[:3])
plant = GrayBoxPlant(signals, base.spec, base.networks, base.parameters)
model = true_model(plant, runs)
bank = build_fault_bank(model, runs, noise)
log = window(10_002, seconds=float(COUNT)).run
faulted = window(20_003, ("heater_p", "sensor_a"), seconds=float(COUNT)).run
watch = Watch(model, tuple(log.columns), log.step, bank=bank)
step = step_of(bank)
samples = {name: log.t if name == "t" else log.columns[name] for name in step.sample}


def timed(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def python() -> None:
    watch.along(watch.init(), prepared(watch.signals, log))


def python_faulted() -> None:
    watch.along(watch.init(), prepared(watch.signals, faulted))


def measure(title: str, work: Callable[[], object], other: str, beside: Callable[[], object]):
    ratios, seconds = [], []
    for _ in range(ROUNDS):
        seconds.append(timed(work))
        ratios.append(timed(beside) / seconds[-1])
    each = 1e6 * np.median(seconds) / len(log.t)
    ratio, low, high = np.median(ratios), min(ratios), max(ratios)
    print(
        f"{title}: {each:.1f} us a sample, {other} {ratio:.2f} [{low:.2f}, {high:.2f}] times that"
    )


def told_size(printed: Printed) -> None:
    """Of what a linker keeps of the step and the C library for a Cortex-M4."""
    if shutil.which("arm-none-eabi-gcc") is None:
        print("Cortex-M4: arm-none-eabi-gcc is not installed (make emulators)")
        return
    cpu = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
    flags = ["-std=c99", "-ffunction-sections", "-fdata-sections", "-nostartfiles"]
    kept = ["-Wl,--gc-sections", f"-Wl,-e,{printed.name}_step", f"-Wl,-u,{printed.name}_init"]
    with tempfile.TemporaryDirectory() as name:
        files = {".h": header, ".c": step_source, "_tables.c": table_source}
        for end, text in files.items():
            (Path(name) / f"{printed.name}{end}").write_text(text(printed, ""))
        sources = [f"{printed.name}.c", f"{printed.name}_tables.c"]
        for level in ("-Os", "-O2"):
            command = ["arm-none-eabi-gcc", *cpu, *flags, level, "--specs=nosys.specs", *kept]
            subprocess.run([*command, *sources, "-lm"], cwd=name, check=True, capture_output=True)
            size = ["arm-none-eabi-size", "a.out"]
            said = subprocess.run(size, cwd=name, check=True, capture_output=True, text=True)
            text, data, bss = (int(n) for n in re.findall(r"\d+", said.stdout)[:3])
            print(f"Cortex-M4, float, {level}: {text:,} bytes of text, {data + bss:,} of data")


def ekf() -> Callable[[], object]:
    """filterpy's EKF of the two temperatures, over the same samples."""
    from filterpy.kalman import ExtendedKalmanFilter  # pyright: ignore[reportMissingImports]

    u = np.stack([log.columns[name] for name in signals.input_names], 1)
    y = np.stack([log.columns[name] for name in signals.output_names], 1)
    zero = jnp.zeros(2)
    slope = np.array(
        [plant.derivative(jnp.asarray(e), zero) - plant.derivative(zero, zero) for e in np.eye(2)]
    ).T
    drive = np.array(
        [plant.derivative(zero, jnp.asarray(e)) - plant.derivative(zero, zero) for e in np.eye(2)]
    ).T
    bias = np.asarray(plant.derivative(zero, zero))

    def walk() -> None:
        filter = ExtendedKalmanFilter(dim_x=2, dim_z=2)
        filter.x, filter.P, filter.F = y[0].copy(), np.eye(2), np.eye(2) + slope * log.step
        filter.Q, filter.R = 1e-4 * np.eye(2), 1e-2 * np.eye(2)
        for now, seen in zip(u, y, strict=True):
            filter.x = filter.x + (slope @ filter.x + drive @ now + bias) * log.step
            filter.P = filter.F @ filter.P @ filter.F.T + filter.Q
            filter.update(seen, lambda x: np.eye(2), lambda x: x)

    return walk


python()  # compiles
python_faulted()
with tempfile.TemporaryDirectory() as folder:
    engine = Engine(Path(folder))
    took = timed(lambda: engine(watch, watch.init(), prepared(watch.signals, log)))

    def run() -> None:
        engine(watch, watch.init(), prepared(watch.signals, log))

    def run_faulted() -> None:
        engine(watch, watch.init(), prepared(watch.signals, faulted))

    measure("engine", run, "Python", python)
    measure("engine, two faults", run_faulted, "Python", python_faulted)
    if find_spec("filterpy"):
        measure("engine", run, "filterpy's EKF", ekf())
    start = time.perf_counter()
    Engine(Path(folder))(watch, watch.init(), prepared(watch.signals, log))
    again = time.perf_counter() - start
    print(f"engine: {took:.1f} s of this process the first time, {again:.1f} s the second")
for precision in ("double", "single"):
    printed = print_step(step, "rig", single=precision == "single")
    for flags in (["-O2"], [*FASTER, "-march=native"]):
        with Native(printed, flags) as native:

            def run_plain() -> None:
                native.begin()
                native.run(samples)

            measure(f"{precision} {' '.join(flags)}", run_plain, "Python", python)
    counted = ", ".join(f"{n:,} {kind}" for kind, n in printed.operations.items())
    work = printed.bytes_of(printed.work)
    print(f"{precision}: {printed.saved_bytes:,} bytes of state and {work:,} of work; {counted}")
    if precision == "single":
        told_size(printed)

rng = np.random.default_rng(0)
wheel = jax.tree.map(  # its networks as if they were trained
    lambda a: a + 0.3 * rng.standard_normal(a.shape) if eqx.is_array(a) and a.ndim else a,
    load_plant("reaction_wheel_network"),
)
outputs = len(wheel.signals.outputs)
eso = ExtendedStateObserver(
    wheel, 0, 1, jnp.full((1, outputs), 0.2), jnp.full(outputs, 0.1), 0.5, jnp.asarray(0.1)
)


def observed(state: ObserverState, sample: dict) -> tuple:
    after, said = eso.step(state, sample["u"], sample["y"], jnp.asarray(0.1))
    return after, {"x": said.x, "f": said.f}


start = ObserverState(jnp.zeros(1), jnp.zeros(()), jnp.zeros(1))
given = {"u": jnp.zeros(1), "y": jnp.zeros(outputs)}
many = {name: rng.standard_normal((1_000_000, *a.shape)) for name, a in given.items()}
# ten hidden units are few for vectors of 64 bytes
short = ["-mprefer-vector-width=256"] if platform.machine() == "x86_64" else []
for fast in (False, True):
    printed = print_step(
        ExportedStep(observed, start, given, {}), "eso", fast_tanh=fast, inline=True
    )
    with Native(printed, [*FASTER, "-march=native", *short]) as native:
        native.run(many)
        least = min(timed(lambda: native.run(many)) for _ in range(ROUNDS))
    print(f"IESONN, tanh {'fast' if fast else 'exact'}: {1e3 * least:.0f} ns a step, at the best")
