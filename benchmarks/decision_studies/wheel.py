"""The paper's wheel on its flight, momentum measured with 0.05 N*m*s of noise, under friction."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from decision_studies.stated import as_stated
from faultgauge.detection.bank.bank import FaultBank, build_fault_bank
from faultgauge.detection.calibration.bank_calibration import calibrate_bank, calibrated
from faultgauge.detection.calibration.noise_estimation import estimate_noise
from faultgauge.detection.decisions import Decision, decide
from faultgauge.detection.posterior.verdicts import FAULT
from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.run_scenario import simulate
from faultgauge.simulation.scenario import Scenario, parse_scenario
from faultgauge.simulation.schedules import Constant, Schedule
from faultgauge.telemetry import Run
from faultgauge_studies import merit
from faultgauge_studies.paper.cases import ONSET, SECONDS, inner_disturbance

__all__ = [
    "FRICTION",
    "STEP",
    "Alarm",
    "base_flight",
    "false_alarms",
    "flight",
    "friction_found",
    "wheel_bank",
]

FLIGHT = """
name = "flight"
plant = "reaction_wheel"
seconds = 1000
step = 0.25
[satellite]
[noise]
hm = 0.05
"""
FRICTION = 0.03  # N*m: the nominal Coulomb friction
SETTLED = 60.0  # s
CALIBRATION = 10_000  # seed of the first healthy flight
TELLING = 3  # flights that tell the noise, and the level where no rate is asked for
STEP = 0.25  # s
PER_ALARM = 1e6  # samples: the rate that is asked for


@dataclass(frozen=True)
class Alarm:
    """One flight with the fault: `delay` [s] until it is named, the run mean after 60 s over the
    truth less one, the shares of samples under alarm (all, and settled) whose interval holds it,
    how many samples those are, and how the onset was told; None where the fault was not named."""

    delay: float
    bias: float
    covered: float
    covered_settled: float
    samples: int
    samples_settled: int
    dated: merit.Dated | None


def flight(seed: int, size: float = 0.0) -> Run:
    """Command and measured momentum of the pitch wheel; friction of `size` [N*m] from 500 s on."""
    base = base_flight()
    faults = (Schedule("friction", "state", "h", Constant(size, ONSET)),) if size else ()
    run = simulate(replace(base, seed=seed, faults=faults))
    return Run(f"{seed}", "flight", run.t, {name: run.columns[name] for name in ("u", "hm")})


@cache
def base_flight() -> Scenario:
    """The healthy flight of seed 0."""
    scenario = parse_scenario(FLIGHT)
    disturbance = (inner_disturbance(scenario.plant),)
    assert scenario.samples * scenario.step == SECONDS
    return replace(scenario, disturbances=disturbance)


def wheel_bank(flights: int = TELLING) -> FaultBank:
    """The bank over the wheel's equations, its noise from three healthy flights, its alarm level
    from `flights`; of those it takes more than three million samples to support one false alarm
    in 10^6, which is then asked for."""
    plant = load_plant("reaction_wheel")
    runs = [flight(CALIBRATION + k) for k in range(TELLING)]
    points = np.concatenate([np.stack([r.columns["hm"], r.columns["u"]], axis=1) for r in runs])
    model = as_stated(plant, points[::20], ["hm"], ["hm"], 0.25)
    noise = estimate_noise(model, runs)
    more = [flight(CALIBRATION + k) for k in range(TELLING, flights)]
    asked = PER_ALARM * STEP if flights > TELLING else None
    found = calibrate_bank(model, [*runs, *more], noise, asked)
    return build_fault_bank(calibrated(model, found), runs, found.noise)


def friction_found(bank: FaultBank, seed: int) -> Alarm:
    """One flight with friction from 500 s on."""
    run = flight(seed, FRICTION)
    decision = decide(bank, run)
    found = decision.posterior
    alarm = (np.array(decision.status) == FAULT) & (run.t >= ONSET)
    settled = alarm & (run.t >= ONSET + SETTLED)
    events = [e for e in decision.events if e.fault == "friction" and e.end >= ONSET]
    late = run.t >= ONSET + SETTLED
    return Alarm(
        delay=merit.found_after([e.start for e in events], ONSET),
        bias=float(found.f[late, 0].mean() / FRICTION - 1),
        covered=merit.coverage(found.lo[:, 0], found.hi[:, 0], FRICTION, alarm),
        covered_settled=merit.coverage(found.lo[:, 0], found.hi[:, 0], FRICTION, settled),
        samples=int(alarm.sum()),
        samples_settled=int(settled.sum()),
        dated=merit.dated(decision.events, "friction", ONSET),
    )


def false_alarms(bank: FaultBank, seed: int) -> tuple[int, int]:
    """(alarms, samples) of one healthy flight; an alarm is a stretch of FAULT."""
    decision: Decision = decide(bank, flight(seed))
    return merit.alarms(decision.status), len(decision.status)
