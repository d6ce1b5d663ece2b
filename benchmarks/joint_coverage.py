"""What the joint training envelope of a network is worth: a drive whose friction depends on place
and speed, learned on one trajectory by a network of both, and judged on others. All logs are
healthy.

python benchmarks/joint_coverage.py [--seeds N]

For each of seeds 0 to N - 1 (noise, network starts): the shares of samples that are healthy, under
a false alarm, and not judged for what of the envelope, with the regions of the networks and
without them. Then what the regions cost: the share of fresh healthy samples of the same
kind as training that lie in the box and in no region, for a network of level and pump on the
README's tank, the networks of the paper's wheel on its experiment, and, where FAULTGAUGE_DATA holds
the records, friction of speed and place on EMPS, on its last fifth and on its pulses.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from decision_studies.drive_pulses import SHARES, bodies, trained
from decision_studies.tank import tank_log
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.coverage import MARGIN, regions_of
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.decisions import decide
from faultgauge.detection.rows.judged import operating_points
from faultgauge.detection.rows.prepared import prepared
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from faultgauge.verbs.checkup import black_box, parts
from faultgauge_studies.drive import measured_logs
from faultgauge_studies.paper.cases import inner_disturbance
from faultgauge_studies.paper.excited import SWEEP, records
from faultgauge_studies.paper.learning import learn

PLANT = """
name = "drive"
[states.q]
unit = "m"
derivative = "v"
[states.v]
unit = "m/s"
derivative = "u - friction(q, v)"
[inputs.u]
unit = "m/s**2"
[outputs.q]
value = "q"
[networks.friction]
hidden = 8
[faults.push]
enters = "input"
target = "u"
[observer]
bandwidth = 30
"""
STEP, COUNT, SUBSTEPS = 0.01, 9000, 5
ENCODER = 1e-4  # m
DISTURBANCE = 0.02  # m/s^2 per root hertz
Reference = Callable[[float], tuple[float, float]]


def swing(amplitude: float, period: float, phase: float = 0.0) -> Reference:
    """Place and speed of a swing around the middle of a metre."""
    omega = 2 * np.pi / period

    def at(t: float) -> tuple[float, float]:
        angle = omega * t + phase
        return amplitude * np.sin(angle), amplitude * omega * np.cos(angle)

    return at


def friction(q: float, v: float) -> float:
    """m/s^2; a slide that is dry at one end and oiled at the other."""
    return (1.0 + 0.8 * np.tanh(4 * q)) * np.tanh(v / 0.05) + 0.3 * v


def log(name: str, seed: int, reference: Reference) -> Run:
    """The drive under its position controller, sampled."""
    rng = np.random.default_rng([seed, sum(map(ord, name))])
    (q, v), h = reference(0.0), STEP / SUBSTEPS
    places, forces = np.empty(COUNT), np.empty(COUNT)
    for k in range(COUNT):
        place, speed = reference(k * STEP)
        u = 60.0 * (place - q) + 15.0 * (speed - v)
        places[k], forces[k] = q, u
        for _ in range(SUBSTEPS):
            v += h * (u - friction(q, v) + DISTURBANCE * rng.standard_normal() / np.sqrt(h))
            q += h * v
    measured = places + ENCODER * rng.standard_normal(COUNT)
    return Run(name, "simulated drive", STEP * np.arange(COUNT), {"q": measured, "u": forces})


LOGS: dict[str, Reference] = {
    "the same trajectory": swing(0.4, 4.0),
    "half as far, twice as fast": swing(0.2, 2.0),
    "half as far": swing(0.2, 4.0),
    "a tenth further": swing(0.44, 4.0),
}


def shares(found: list[tuple[str, str]]) -> dict[str, float]:
    status = np.array([s for s, _ in found])
    reason = np.array([r for _, r in found])
    outside = np.char.startswith(reason, "outside")
    joint = np.char.startswith(reason, "outside the training envelope of")
    return {
        "healthy": float(np.mean(status == "HEALTHY")),
        "false alarm": float(np.mean(status == "FAULT")),
        "out of a range": float(np.mean(outside & ~joint)),
        "out of a region": float(np.mean(joint)),
    }


def inside(points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Whether each row of `values` is within the ranges of `points` and a margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = MARGIN * (high - low)
    return np.all((values >= low - room) & (values <= high + room), axis=1)


def cost(model: Model, run: Run) -> list[float]:
    """Shares of the samples of `run` that the box holds and a region does not."""
    signals, points = model.plant.signals, operating_points(model)
    columns = [run.columns[column] for column, _ in model.record.columns.states]
    slopes = [order for _, order in model.record.columns.states]
    x = np.stack(
        [
            np.gradient(each, run.t) if order else each
            for each, order in zip(columns, slopes, strict=True)
        ],
        axis=1,
    )
    u = prepared(signals, run).u
    box = inside(points.x, x) & inside(points.u, u)
    given = [jnp.asarray(each) for each in (x, u, np.zeros_like(x))]
    return [
        float(np.mean(box & ~np.asarray(jax.vmap(region.holds)(*given))))
        for region in regions_of(model, signals.output_names)
    ]


def tank(seed: int) -> list[float]:
    rng = np.random.default_rng(seed)
    training, fresh = tank_log(rng, 0.0), tank_log(rng, 0.0)
    return cost(fit(black_box([training], "tank"), [training], seed=seed)[0], fresh)


def wheel(seed: int) -> list[float]:
    plant = load_plant("reaction_wheel")
    inner = (inner_disturbance(plant),)
    training, validation = records(plant, SWEEP, seed, inner)
    model = learn([training], [validation], seed).model
    return cost(model, records(plant, SWEEP, 100 + seed, inner).training)


def emps(seed: int) -> list[float]:
    logs = measured_logs()
    if logs is None:
        return []
    name, plant = list(bodies().items())[-1]
    body = trained(name, plant, logs, seed)
    rest = parts([logs.healthy], *SHARES)[-1][0]
    return [*cost(body.model, rest), *cost(body.model, logs.faulty)]


def main(seeds: int) -> None:
    every: dict[tuple[str, str], list[dict[str, float]]] = {}
    for seed in range(seeds):
        healthy = log("training", seed, swing(0.4, 4.0))
        first, stop, third = parts([healthy], 0.5, 0.6)
        model, _ = fit(GrayBoxPlant.untrained(parse_plant(PLANT)), first, stop, seed=seed)
        model = calibrate(model, third).model
        for name, reference in LOGS.items():
            run = log(name, seed, reference)
            bank = build_fault_bank(model, [run], noise_of(model))
            for how, each in (("nothing", replace(bank, regions=())), ("regions", bank)):
                said = decide(each, run)
                pairs = list(zip(said.status, said.reason, strict=True))
                every.setdefault((name, how), []).append(shares(pairs))
        print(f"seed {seed}: reach {[round(r.reach, 3) for r in bank.regions]}")
    for (name, how), found in every.items():
        text = ", ".join(
            f"{key} {np.median([f[key] for f in found]):.1%} "
            f"[{min(f[key] for f in found):.1%}, {max(f[key] for f in found):.1%}]"
            for key in found[0]
        )
        print(f"{name}, {how}: {text}")
    for each in (tank, wheel, emps):
        found = np.array([each(seed) for seed in range(seeds)])
        said = [f"{np.median(c):.2%} [{c.min():.2%}, {c.max():.2%}]" for c in found.T]
        print(f"fresh healthy samples in the box and in no region, {each.__name__}: {said}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    main(parser.parse_args().seeds)
