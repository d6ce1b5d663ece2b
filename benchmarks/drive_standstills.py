"""Which friction the EMPS benchmark's plant file has, decided on its training record.

    python benchmarks/drive_standstills.py [own] [network] [smooth] [--seeds N] [--parts K]

First friction as measured: voltage's force minus mass times acceleration, both low-pass filtered,
the mass by least squares, in bins of speed. Then each part of the training record is left out in
turn, the plant fitted without and simulated: the benchmark's own file, the one before with an odd
network of speed, and a smooth curve with friction of place. By default all three.

    RMSE       of the free run [mm], the mean of the ensemble, its start from 50 samples
    missed     standstills over which its error changes by more than 1 mm
    fall       of the friction curve [N]: from the highest value down to the lowest above it in
               speed, up to the fastest cruise, the worse direction of the two
    parted     pairs of free runs, one 20 mm/s slower at the start, under one measured input, that
               are farther apart in speed 0.25 s later. Where friction never falls with speed there
               can be none; where it falls, one carriage may stick and the other go on.

Set FAULTGAUGE_DATA to the folder that holds emps/.
"""

import argparse
from collections.abc import Sequence
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.signal import argrelmin, filtfilt, firwin, savgol_filter

from faultgauge.identification.fit import fit
from faultgauge.identification.validation.evaluation import predict
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.free_run import free_run, substeps_for
from faultgauge.telemetry import Run
from faultgauge_studies.published.benchmark import benchmark, plant_of, records
from faultgauge_studies.published.run import error_of, mean_of
from left_out import WARMUP, splits

FORCE = 35.15065188248547  # N/V
CUTOFF, TAPS = 40.0, 41  # Hz, and samples of its filter
SPEEDS = 1e-3 * np.array([2, 4, 7, 10, 15, 20, 30, 40, 50, 60, 80, 100, 120, 130])  # m/s
MOVING = 0.012  # m/s: the mass is fitted where the sign of the speed is sure
STILL, APART = 0.006, 50  # m/s; samples between standstills
BEFORE, AFTER, OFF = 150, 250, 1.0  # samples; mm
SLOWER, EVERY = 0.02, 250  # m/s; samples
FASTEST = 0.12465  # m/s, the fastest cruise


HEAD = """
inputs.u = { unit = "V" }
outputs.q = { unit = "m", value = "q" }
states.q = { unit = "m", derivative = "v" }
parameters.gtau = { value = 35.15065188248547, unit = "N/V", fixed = true }
parameters.width = { value = 0.002, unit = "m/s", fixed = true }
parameters.offset = { value = 0, unit = "N" }
"""
RIVALS = {
    "network": """
name = "EMPS, an odd network of speed"
networks.extra = { hidden = 6, odd = true }
states.v.derivative = "(gtau*u - Fv*v - Fc*tanh(v/width) - offset)/M + extra(v)"
parameters.M = { value = 100, unit = "kg", min = 10, max = 1000 }
parameters.Fv = { value = 200, unit = "N*s/m", min = 0 }
parameters.Fc = { value = 20, unit = "N", min = 0 }
""",
    "smooth": """
name = "EMPS, a smooth rise, and friction of place"
states.v.derivative = """
    """"(gtau*u - (Fv + asym*tanh(v/slow))*v - (Fc + c1*(q-mid) + c2*(q-mid)**2)*tanh(v/width)"""
    """ - Fb*tanh(v/slow) - offset - k1*(q-mid) - k2*(q-mid)**2)/M"
parameters.M = { value = 95, unit = "kg", min = 10, max = 1000 }
parameters.Fv = { value = 150, unit = "N*s/m", min = 0 }
parameters.Fc = { value = 15, unit = "N", min = 0 }
parameters.Fb = { value = 5, unit = "N", min = 0 }
parameters.asym = { value = -30, unit = "N*s/m" }
parameters.slow = { value = 0.02, unit = "m/s", fixed = true }
parameters.mid = { value = 0.12, unit = "m", fixed = true }
parameters.c1 = { value = 1, unit = "N/m" }
parameters.c2 = { value = 1, unit = "N/m**2" }
parameters.k1 = { value = 1, unit = "N/m" }
parameters.k2 = { value = 1, unit = "N/m**2" }
""",
}


def plant_called(name: str) -> GrayBoxPlant:
    if name in RIVALS:
        return GrayBoxPlant.untrained(parse_plant(HEAD + RIVALS[name], name))
    return plant_of(benchmark("emps"))


def speed(q: Float[np.ndarray, "samples"], step: float) -> Float[np.ndarray, "samples"]:
    return np.asarray(savgol_filter(q, 31, 2, deriv=1, delta=step))


def measured_friction(run: Run) -> list[tuple[float, float, float]]:
    """(highest speed of the bin, friction forwards, backwards) [N], the offset in both."""
    low = firwin(TAPS, CUTOFF, fs=1 / run.step)
    q, u = (filtfilt(low, 1.0, run.columns[name]) for name in ("q", "u"))
    v = np.gradient(q, run.step)
    a, force = np.gradient(v, run.step), FORCE * u
    inside = slice(TAPS * 3, -TAPS * 3)
    v, a, force = v[inside], a[inside], force[inside]
    terms = np.stack([a, np.maximum(v, 0), np.minimum(v, 0), np.sign(v), np.ones_like(v)], axis=1)
    sure = np.abs(v) > MOVING
    friction = force - np.linalg.lstsq(terms[sure], force[sure])[0][0] * a
    found = []
    for low_edge, high in pairwise(SPEEDS):
        means = [
            float(np.mean(friction[(sign * v > low_edge) & (sign * v <= high)])) for sign in (1, -1)
        ]
        found.append((float(high), means[0], means[1]))
    return found


def fall(plant: GrayBoxPlant) -> float:
    """How far friction falls with speed [N], at most: 0 where it only rises."""
    v = np.linspace(0.0, FASTEST, 500)
    worst = 0.0
    for sign in (1, -1):
        x = jnp.stack([jnp.zeros(len(v)), sign * jnp.asarray(v)], axis=1)
        dx = jax.vmap(lambda at: plant.derivative(at, jnp.zeros(1)))(x)
        friction = -sign * float(plant.parameters["M"]) * np.asarray(dx[:, 1])
        worst = max(worst, float(np.max(np.maximum.accumulate(friction) - friction)))
    return worst


def parted(plant: GrayBoxPlant, run: Run, max_step: float) -> tuple[int, int]:
    """(pairs that part, pairs), one pair from every `EVERY`th sample."""
    q, v = run.columns["q"], speed(run.columns["q"], run.step)
    starts = range(EVERY, len(q) - EVERY, EVERY)
    substeps = substeps_for(run.step, max_step)
    dt, f = jnp.full(EVERY, run.step), jnp.zeros((EVERY, len(plant.signals.faults)))

    def end(k: int, slower: float) -> float:
        x0 = jnp.array([q[k], v[k] - slower])
        u: Float[Array, "samples inputs"] = jnp.asarray(run.columns["u"][k : k + EVERY, None])
        return float(free_run(plant, x0, u, dt, f, substeps).x[-1, 1])

    gaps = [abs(end(k, 0.0) - end(k, np.sign(v[k]) * SLOWER)) for k in starts]
    return sum(gap > SLOWER for gap in gaps), len(starts)


def missed(run: Run, off: Float[np.ndarray, "samples"]) -> tuple[int, int]:
    """(standstills over which `off` [mm] changes by more than 1 mm, standstills)."""
    v = np.abs(speed(run.columns["q"], run.step))
    ends = WARMUP + BEFORE, len(v) - AFTER
    at = [k for k in argrelmin(v, order=APART)[0] if v[k] < STILL and ends[0] <= k < ends[1]]
    return sum(abs(off[k + AFTER] - off[k - BEFORE]) > OFF for k in at), len(at)


def report(name: str, runs: list[Run], parts: int, seeds: Sequence[int]) -> None:
    chosen = benchmark("emps")
    errors, counts = [], np.zeros(4, int)
    falls = []
    for fitted, left in splits(runs, parts):
        for seed in seeds:
            model, _ = fit(plant_called(name), fitted, seed=seed, refine=True, ensemble=True)
            members = [model.plant, *model.members]
            mean = mean_of([predict(each, [left], model.max_step, WARMUP) for each in members])
            errors.append(error_of(chosen, mean))
            off = chosen.scale * (mean[0].predicted - mean[0].measured)[:, 0]
            row = *missed(left, off), *parted(model.plant, left, model.max_step)
            counts += row
            falls.append(fall(model.plant))
            print(
                f"  {left.name}, seed {seed}: {errors[-1]:.3f} mm, missed {row[0]} of {row[1]}, "
                f"fall {falls[-1]:.1f} N, parted {row[2]} of {row[3]}",
                flush=True,
            )
    print(
        f"{name}: geometric mean {np.exp(np.mean(np.log(errors))):.3f} "
        f"[{min(errors):.3f}, {max(errors):.3f}] mm, missed {counts[0]} of {counts[1]}, fall "
        f"{np.median(falls):.1f} [{min(falls):.1f}, {max(falls):.1f}] N, parted {counts[2]} of "
        f"{counts[3]}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plants", nargs="*", metavar="PLANT", help="own, network or smooth")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--parts", type=int, default=3)
    given = parser.parse_args()
    runs = list(records(benchmark("emps")).train)
    print("friction as measured, forwards and backwards:")
    for high, forwards, backwards in measured_friction(runs[0]):
        print(f"  up to {1e3 * high:.0f} mm/s: {forwards:.1f}, {backwards:.1f} N")
    for name in given.plants or ["own", *RIVALS]:
        report(name, runs, given.parts, range(given.seeds))


if __name__ == "__main__":
    main()
