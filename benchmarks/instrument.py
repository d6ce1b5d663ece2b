"""What an instrument is worth: bias of a fit from closed-loop logs, at three loop gains.

    python benchmarks/instrument.py [--seeds N]

A first-order plant x' = b u - a x + d under u = r - K x_measured: feed-forward r, sensor noise that
the loop feeds back, and a load d (AR(1), 0.3 s) that it fights. Medians over seeds 0..N-1 of the
relative errors of a and b, fitted by equation error with and without `instrument = "r"`.
"""

import argparse

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

__all__ = ["GAINS", "errors", "loop", "medians"]

PLANT = """
name = "first order"
[states.x]
derivative = "b*u - a*x"
[inputs.u]{key}
[outputs.x]
value = "x"
[parameters]
a = {{ value = 1.0 }}
b = {{ value = 1.0 }}
"""
A, B = 0.8, 2.5  # 1/s
STEP, COUNT = 0.05, 4000  # s, samples
NOISE, LOAD, LOAD_TIME = 0.02, 0.3, 0.3  # standard deviations of sensor and load (1/s), s
GAINS = (0.25, 1.0, 4.0)


def loop(gain: float, seed: int) -> Run:
    """A healthy log: held input, exact between samples; columns x (measured), u and r."""
    random = np.random.default_rng(seed)
    r = np.repeat(random.uniform(-2, 2, COUNT // 40), 40)
    noise = NOISE * random.standard_normal(COUNT)
    keep = np.exp(-STEP / LOAD_TIME)
    load = lfilter([LOAD * np.sqrt(1 - keep**2)], [1.0, -keep], random.standard_normal(COUNT))
    decay = np.exp(-A * STEP)
    x, u, state = np.zeros(COUNT), np.zeros(COUNT), 0.0
    for k in range(COUNT):
        x[k] = state + noise[k]
        u[k] = r[k] - gain * x[k]
        state = decay * state + (1 - decay) / A * (B * u[k] + load[k])
    return Run(f"seed {seed}", "loop", STEP * np.arange(COUNT), {"x": x, "u": u, "r": r})


def errors(gain: float, seed: int, *, instrument: bool) -> Float[np.ndarray, "2"]:
    """Relative errors of a and b."""
    text = PLANT.format(key='\ninstrument = "r"' if instrument else "")
    plant = GrayBoxPlant.untrained(parse_plant(text))
    model, _ = fit(plant, [loop(gain, seed)], seed=seed, restarts=1, refine=False)
    found = np.array([float(model.plant.parameters[name]) for name in "ab"])
    return found / [A, B] - 1.0


def medians(gain: float, seeds: int, *, instrument: bool) -> Float[np.ndarray, "3 2"]:
    """Median, lowest and highest error of a and b over seeds 0..N-1."""
    each = np.stack([errors(gain, seed, instrument=instrument) for seed in range(seeds)])
    return np.stack([np.median(each, axis=0), each.min(axis=0), each.max(axis=0)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    seeds = parser.parse_args().seeds
    print(f"relative error of a and b: median [lowest, highest] of {seeds} seeds")
    for gain in GAINS:
        for instrument in (False, True):
            found = medians(gain, seeds, instrument=instrument)
            row = "  ".join(
                f"{name} {middle:+8.2%} [{low:+8.2%}, {high:+8.2%}]"
                for name, (middle, low, high) in zip("ab", found.T, strict=True)
            )
            print(f"gain {gain:4.2f}  {'instrument' if instrument else 'plain     '}  {row}")


if __name__ == "__main__":
    main()
