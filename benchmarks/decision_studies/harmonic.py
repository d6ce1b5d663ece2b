"""The wheel whose sine disturbance stands in its plant file as two hidden states, under eq (17).

    dh = sat(u) - xi(h) + s + d1,   ds = w c,   dc = -w s,   w = 0.2 rad/s

The amplitude and the phase of s are drawn for every seed and known to no one; the momentum is
measured without noise.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from decision_studies.stated import as_stated
from decision_studies.wheel import base_flight
from faultgauge.detection.bank.bank import FaultBank, build_fault_bank
from faultgauge.detection.calibration.noise_estimation import estimate_noise
from faultgauge.detection.decisions import Decision, decide
from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.run_scenario import simulate
from faultgauge.simulation.schedules import Sine
from faultgauge.telemetry import Run
from faultgauge_studies.paper.cases import CASES, UNBALANCE, inner_disturbance
from faultgauge_studies.paper.estimating import Quality, quality

__all__ = ["PRESETS", "Flown", "harmonic_bank", "harmonic_flight", "intermittent"]

PRESETS = ("reaction_wheel_harmonic", "reaction_wheel")  # with the disturbance's states, without
CALIBRATION = (10_000, 10_001, 10_002)  # seeds of the healthy flights
AMPLITUDES = (0.5, 2.0)  # of the paper's disturbance


@dataclass(frozen=True)
class Flown:
    """One flight under eq (17), judged; `truth` is the fault [N*m]."""

    decision: Decision
    truth: Float[np.ndarray, "samples"]
    quality: Quality

    @property
    def estimate(self) -> Float[np.ndarray, "samples"]:
        return self.decision.posterior.f[:, 0]


def harmonic_flight(seed: int, faulty: bool) -> tuple[Run, Float[np.ndarray, "samples"]]:
    """(command and momentum of the pitch wheel, the fault); the sine is that of the seed."""
    base = replace(base_flight(), sigma=np.zeros(2))
    rng = np.random.default_rng([seed, 17])
    nominal = inner_disturbance(base.plant)
    assert isinstance(nominal.profile, Sine)
    size = nominal.profile.size * rng.uniform(*AMPLITUDES)
    sine = replace(nominal.profile, size=size, phase=float(rng.uniform(0, 2 * np.pi)))
    fault = replace(CASES["mode1_intermittent"].fault, name="friction")
    scenario = replace(
        base,
        seed=seed,
        faults=(fault,) if faulty else (),
        disturbances=(replace(nominal, profile=sine),),
    )
    run = simulate(scenario)
    columns = {name: run.columns[name] for name in ("u", "hm")}
    truth = run.columns["true_friction"] if faulty else np.zeros(len(run.t))
    return Run(f"{seed}", "flight", run.t, columns), truth


def harmonic_bank(preset: str, flights: int = len(CALIBRATION)) -> FaultBank:
    """The bank over the equations of `preset`, calibrated on so many healthy flights."""
    plant = load_plant(preset)
    runs = [harmonic_flight(seed, faulty=False)[0] for seed in CALIBRATION[:flights]]
    points = np.concatenate([np.stack([r.columns["hm"], r.columns["u"]], axis=1) for r in runs])
    points = points[::20]
    hidden = len(plant.signals.states) - 1
    if hidden:
        largest = AMPLITUDES[1] * UNBALANCE * float(plant.parameters["J"]) * 0.2**2
        angle = np.linspace(0, 2 * np.pi, len(points))
        circle = largest * np.stack([np.sin(angle), np.cos(angle)], axis=1)
        points = np.concatenate([points[:, :1], circle, points[:, 1:]], axis=1)
    states = ["hm", *plant.signals.state_names[1:]]
    model = as_stated(plant, points, states, ["hm"], 0.25)
    return build_fault_bank(model, runs, estimate_noise(model, runs))


def intermittent(bank: FaultBank, seed: int) -> Flown:
    """One flight under eq (17), scored from 50 s after each jump."""
    run, truth = harmonic_flight(seed, faulty=True)
    decision = decide(bank, run)
    found = quality(CASES["mode1_intermittent"], run.t, decision.posterior.f[:, 0], truth)
    return Flown(decision, truth, found)
