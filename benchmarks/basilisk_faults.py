"""A wheel's faults told on logs of Basilisk's spacecraft, beside the same on our own simulator's.

    python benchmarks/basilisk_faults.py [--trials N] [--json]

The plant is a Honeywell HR16 (Js 0.119 kg*m^2, 0.2 N*m), Omega its speed against the spacecraft:

    Js dOmega/dt  =  u - (fCoulomb + cViscous |Omega|) clip(Omega/1e-4, -1, 1)  -  Js dω/dt

On Basilisk's side the wheel stands aslant in a hub of 400 kg with products of inertia, whose rate
about the wheel's axis is ω. The spacecraft scans: it swings by 15 degrees every 150 s, and an
external torque, a PD law with a corner of 0.2 rad/s at every sample, makes it follow while the
wheel pushes it about. Nothing of this is logged. Our own simulator has the first two terms alone.
Torque limit and fCoulomb are the HR16's, cViscous is assumed. Both take the same Runge-Kutta steps.

The loop, in Python for Basilisk, sets every 0.5 s from the noisy tachometer

    u  =  noise in 0.005-0.4 Hz + kp (r - y) + z,    z  <-  z + 0.5 s ki (r - y)

inside the limit; r = 40 + 150 sin(2 pi t/900 s + a phase) rad/s goes through zero every some 450 s.
Gains, noises and the length of a log are those of `wheel_campaign/scenario.toml`: the gains times
this wheel's inertia, the noise of the command times this wheel's limit over that one's, that of the
tachometer the same share of the greatest speed.

Faults begin between 250 and 600 s and stay: Coulomb or viscous friction that is added (Basilisk's
own parameters, changed while it runs), a share of the torque that is lost between log and wheel,
and a bias of the tachometer, which log and loop see. Seeds are 0 to N - 1 for each kind of log; a
seed has the same phase, noises, onset and size on both simulators.

Compared are three judges: `Basilisk` and `own simulator` are fitted on one healthy log (Js,
fCoulomb and cViscous are free, and a constant Js is all that the file knows of the hub) and
calibrated on four others, each from its own simulator; `Basilisk, truth` has Basilisk's own
constants in place of fitted ones, is calibrated on the same four, and judges the same logs.
`exact`: the names told over the whole log are the fault's, and none was told before it. The delay
is that from the onset to the first event of this name, the size that of its last one. A fault that
is not named has an infinite delay and error; medians are over all logs.

Goals: Basilisk's median delay and median size error are at most 1.5 times our own simulator's, and
the fitted model's at most 1.1 times the truth's. A delay below one sample counts as one. Ratios
have 95 % intervals of drawing seeds, with both judges of a seed together.
"""

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, is_dataclass
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

import faultgauge as fg
from faultgauge.detection.decisions import Decision
from faultgauge.plants.model import Model
from faultgauge.simulation.run_scenario import INPUTS, REFERENCES, driven, noise
from faultgauge.simulation.scenario import Scenario, parse_scenario
from faultgauge.telemetry import Run
from faultgauge_studies import merit
from mismatch.case import Injected
from mismatch.scoring import Trial, scored

SECONDS, SAMPLE, STEPS = 1000.0, 0.5, 10  # s, s, Runge-Kutta steps per sample on both sides
JS, U_MAX, LIMIT_CYCLE = 75.0 / (2 * np.pi * 100), 0.2, 1e-4  # kg*m^2, N*m, rad/s: the HR16's
FRICTION = {"fCoulomb": 5e-4, "cViscous": 1e-5}  # N*m, N*m*s
KP, KI = 0.05 * JS, 0.001 * JS  # N*m*s, N*m: the campaign's gains are 1/s and 1/s^2
EXCITATION = 0.1 * U_MAX / 0.82  # N*m
TACHOMETER = 0.05 / 264 * 2 * np.pi * 100  # rad/s; the campaign's wheel holds 264 N*m*s
MIDDLE, SWING, PERIOD = 40.0, 150.0, 900.0  # rad/s, rad/s, s
ONSET = (250.0, 600.0)  # s

HUB_MASS = 400.0  # kg
HUB = np.array([[90.0, 6.0, -4.0], [6.0, 110.0, 5.0], [-4.0, 5.0, 75.0]])  # kg*m^2
AXIS = np.array([0.3, -0.2, 0.933]) / np.linalg.norm([0.3, -0.2, 0.933])
CORNER, DAMPING = 0.2, 0.7  # rad/s, 1: of the attitude's control
SCAN, SCAN_PERIOD = np.deg2rad(15.0), 150.0  # rad, s: the attitude that is wanted swings so
ABOUT = np.array([1.0, -1.0, 2.0]) / np.sqrt(6.0)
STILL = 1e12  # kg*m^2, of a hub that does not move

# Sizes in the fault's unit, drawn evenly in the logarithm: one to twenty times fCoulomb, half to
# ten times cViscous, 0.5 to 30 % of the torque, 4 to 170 standard deviations of the tachometer.
SIZES = {
    "coulomb": (5e-4, 1e-2),
    "viscous": (5e-6, 1e-4),
    "motor_gain": (0.005, 0.3),
    "tachometer": (0.5, 20.0),
}
BOTH_SIGNS = ("tachometer",)
PLANT = """
name = "HR16"
[states.w]
unit = "rad/s"
derivative = "(u - (fCoulomb + cViscous*max(abs(w), limit))*clip(w/limit, -1, 1))/Js"
[inputs.u]
unit = "N*m"
min = -{u_max!r}
max = {u_max!r}
hold = "zero"
[outputs.y]
unit = "rad/s"
value = "w"
[parameters]
limit = {{ value = {limit!r}, unit = "rad/s", fixed = true }}
Js = {{ value = {Js!r}, unit = "kg*m**2", {free} }}
fCoulomb = {{ value = {fCoulomb!r}, unit = "N*m", {free} }}
cViscous = {{ value = {cViscous!r}, unit = "N*m*s", {free} }}
[faults]
coulomb = {{ enters = "parameter", target = "fCoulomb", unit = "N*m", min = 0, max = 0.02 }}
viscous = {{ enters = "parameter", target = "cViscous", unit = "N*m*s", min = 0, max = 2e-4 }}
motor_gain = {{ enters = "gain", target = "u" }}
tachometer = {{ enters = "output", target = "y", unit = "rad/s" }}
[detection]
max_simultaneous = 1
"""
SCENARIO = """
name = "{name}"
plant = "HR16"
seconds = {seconds}
step = {sample}
substeps = {steps}
seed = {seed}
[initial]
w = {start!r}
[inputs.u]
source = "noise"
sigma = {excitation!r}
low = 0.005
high = 0.4
[inputs.u.feedback.y]
kp = {kp!r}
ki = {ki!r}
[references.y]
source = "sine"
size = {swing}
frequency = {frequency!r}
phase = {phase!r}
offset = {middle}
[noise]
y = {tachometer!r}
"""
FIT, CALIBRATE, HEALTHY = range(3)  # the first number of a seed; kinds of faults follow
CALIBRATIONS, PER_KIND = 4, 1000  # logs; seeds of the scenarios of one kind
GOAL_OWN, GOAL_TRUTH = 1.5, 1.1
DRAWS = 2000  # of seeds, for the interval of a ratio
JUDGES = ("Basilisk", "own simulator", "Basilisk, truth")
MEASURES = {"delay": "s", "size error": "%"}


class Plan(NamedTuple):
    """What a log holds: its scenario, and the fault in it, if any, with its size and onset."""

    scenario: Scenario
    seed: tuple[int, int]
    kind: str = ""
    size: float = 0.0
    onset: float = np.inf


def plant_file(free: bool) -> str:
    """What the user writes, from a data sheet that is not exact, or with the true constants."""
    guess = {"Js": 0.12, "fCoulomb": 1e-3, "cViscous": 2e-5}
    values = guess if free else {"Js": JS, **FRICTION}
    stated = "min = 0" if free else "fixed = true"
    return PLANT.format(u_max=U_MAX, limit=LIMIT_CYCLE, free=stated, **values)


def planned(stream: int, seed: int, kind: str = "") -> Plan:
    """The log of this kind and seed, on either simulator."""
    rng = np.random.default_rng([stream, seed])
    phase = float(rng.uniform(0.0, 2 * np.pi))
    text = SCENARIO.format(
        name=f"{kind or ('fit', 'calibrate', 'healthy')[stream]} {seed}",
        seconds=SECONDS,
        sample=SAMPLE,
        steps=STEPS,
        seed=PER_KIND * stream + seed,
        start=MIDDLE + SWING * float(np.sin(phase)),
        excitation=EXCITATION,
        kp=KP,
        ki=KI,
        swing=SWING,
        frequency=1 / PERIOD,
        phase=phase,
        middle=MIDDLE,
        tachometer=TACHOMETER,
    )
    size, onset = 0.0, np.inf
    if kind:
        low, high = SIZES[kind]
        size = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        size *= float(rng.choice([-1.0, 1.0])) if kind in BOTH_SIGNS else 1.0
        onset = SAMPLE * round(float(rng.uniform(*ONSET)) / SAMPLE)
        text += f'[faults.{kind}]\nprofile = "constant"\nsize = {size!r}\nstart = {onset}\n'
    true = fg.plant(plant_file(free=False))
    return Plan(parse_scenario(text, "scenario", plant=true), (stream, seed), kind, size, onset)


def ours(plan: Plan) -> Run:
    """The log by our own simulator."""
    return fg.simulate(plan.scenario).run


class Craft:
    """Basilisk's wheel in its hub, which scans from `phase` [rad] on; None: it stands still."""

    def __init__(self, speed: float, phase: float | None) -> None:
        from Basilisk.architecture import messaging
        from Basilisk.simulation import extForceTorque, reactionWheelStateEffector, spacecraft
        from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW

        self.simulation, self.hub = SimulationBaseClass.SimBaseClass(), spacecraft.Spacecraft()
        self.sample, self.phase = STEPS * macros.sec2nano(SAMPLE / STEPS), phase
        task = self.simulation.CreateNewTask("task", self.sample // STEPS)
        self.simulation.CreateNewProcess("process").addTask(task)
        self.hub.hub.mHub = HUB_MASS
        self.hub.hub.IHubPntBc_B = (STILL * np.eye(3) if phase is None else HUB).tolist()
        if phase is not None:
            angle, rate = self.wanted(0.0)
            self.hub.hub.sigma_BNInit = (np.tan(angle / 4) * ABOUT).tolist()
            self.hub.hub.omega_BN_BInit = (rate * ABOUT).tolist()
        factory = simIncludeRW.rwFactory()
        self.wheel = factory.create(
            "Honeywell_HR16", AXIS.tolist(), maxMomentum=75.0, useRWfriction=True, **FRICTION
        )
        self.wheel.Omega = speed
        self.effector = reactionWheelStateEffector.ReactionWheelStateEffector()
        factory.addToSpacecraft("wheels", self.effector, self.hub)
        self.control = extForceTorque.ExtForceTorque()
        self.hub.addDynamicEffector(self.control)
        self.command = messaging.ArrayMotorTorqueMsg()
        self.message = messaging.ArrayMotorTorqueMsgPayload()
        self.effector.rwMotorCmdInMsg.subscribeTo(self.command)
        for priority, model in enumerate([self.hub, self.effector, self.control]):  # highest first
            self.simulation.AddModelToTask("task", model, priority)
        self.simulation.InitializeSimulation()
        self.simulation.ConfigureStopTime(0)
        self.simulation.ExecuteSimulation()

    @property
    def speed(self) -> float:
        """Omega [rad/s] as it is now; the effector's message is one integration step older."""
        states = self.hub.dynManager.getStateObject(self.effector.nameOfReactionWheelOmegasState)
        return float(np.ravel(states.getState())[0])

    def wanted(self, t: float) -> tuple[float, float]:
        """The angle [rad] about `ABOUT` at `t` [s], and its rate."""
        assert self.phase is not None
        omega = 2 * np.pi / SCAN_PERIOD
        turned = omega * t + self.phase
        return float(SCAN * np.sin(turned)), float(SCAN * omega * np.cos(turned))

    def steer(self, t: float) -> None:
        """Set the torque on the hub that makes it follow, until the next sample."""
        from Basilisk.utilities import RigidBodyKinematics

        angle, rate = self.wanted(t)
        now = self.hub.scStateOutMsg.read()
        off = RigidBodyKinematics.subMRP(np.array(now.sigma_BN), np.tan(angle / 4) * ABOUT)
        turning = np.array(now.omega_BN_B) - rate * ABOUT
        torque = -HUB @ (CORNER**2 * 4 * off + 2 * DAMPING * CORNER * turning)
        self.control.extTorquePntB_B = torque.tolist()

    def advance(self, k: int, torque: float) -> None:
        """From sample k to the next, the motor giving `torque` [N*m]."""
        if self.phase is not None:
            self.steer(k * SAMPLE)
        self.message.motorTorque = [torque]
        self.command.write(self.message)
        self.simulation.ConfigureStopTime((k + 1) * self.sample)
        self.simulation.ExecuteSimulation()


def basilisk(plan: Plan, scans: bool = True) -> Run:
    """The log by Basilisk, with the loop's noises and reference as our own simulator draws them;
    of a hub that stands still, unless it `scans`."""
    scenario = plan.scenario
    t = SAMPLE * np.arange(scenario.samples)
    forward = driven(scenario, t, INPUTS, [False])[:, 0]
    reference = driven(scenario, t, REFERENCES, [False])[:, 0]
    error, summed = noise(scenario)[:, 0], 0.0
    phase = float(np.random.default_rng([*plan.seed, 1]).uniform(0.0, 2 * np.pi))
    craft = Craft(float(scenario.x0[0]), phase if scans else None)
    u, y = np.empty_like(t), np.empty_like(t)
    for k in range(len(t)):
        acting = plan.kind if t[k] >= plan.onset else ""
        if acting == "coulomb":
            craft.wheel.fCoulomb = FRICTION["fCoulomb"] + plan.size
        elif acting == "viscous":
            craft.wheel.cViscous = FRICTION["cViscous"] + plan.size
        y[k] = craft.speed + error[k] + (plan.size if acting == "tachometer" else 0.0)
        off = reference[k] - y[k]
        wanted = forward[k] + KP * off + summed
        u[k] = np.clip(wanted, -U_MAX, U_MAX)
        if abs(wanted) <= U_MAX or wanted * off < 0:  # does not wind up beyond the limit
            summed += SAMPLE * KI * off
        craft.advance(k, u[k] * (1 - plan.size if acting == "motor_gain" else 1.0))
    return Run(scenario.name, "Basilisk", t, {"u": u, "y": y})


def judge(plant: str, simulator: Callable[[Plan], Run]) -> tuple[Model, list[str]]:
    """A calibrated model, made as a user would, and what was said of it."""
    fit = fg.fit(plant, simulator(planned(FIT, 0)))
    healthy = [simulator(planned(CALIBRATE, k)) for k in range(CALIBRATIONS)]
    found = fg.calibrate(fit.model, healthy)
    return found.model, [*fit.lines, *found.lines, *fit.warnings, *found.warnings]


def judged(plant: str, simulator: Callable[[Plan], Run], trials: int, name: str) -> dict[str, Any]:
    """Every log of every kind told by one judge."""

    def said(text: str) -> None:
        print(f"{name}: {text}", file=sys.stderr, flush=True)

    said("healthy logs, fit, calibration")
    model, words = judge(plant, simulator)
    faults = model.plant.signals.fault_names
    found, answers = dict[str, list[Trial]](), dict[str, list[str]]()
    before = list[tuple[Decision, float]]()
    for stream, kind in enumerate(["", *SIZES], HEALTHY):
        said(kind or "healthy")
        plans = [planned(stream, k, kind) for k in range(trials)]
        answer = fg.estimate(model, [simulator(plan) for plan in plans])
        before += [(d, p.onset) for d, p in zip(answer.decisions, plans, strict=True)]
        if kind:
            found[kind] = [
                scored(decision, faults, {kind: Injected(plan.size, plan.onset)}, "drawn")
                for decision, plan in zip(answer.decisions, plans, strict=True)
            ]
        answers[kind or "healthy"] = answer.sentences
    false = [false_alarms(decision, onset) for decision, onset in before]
    return {
        "model": words,
        "trials": found,
        "answers": answers,
        "false_alarms": sum(false),
        "healthy_hours": sum(min(onset, SECONDS) for _, onset in before) / 3600,
        "healthy_logs_with_alarm": sum(count > 0 for count in false[:trials]),
    }


def false_alarms(decision: Decision, onset: float) -> int:
    """Alarms that began before the onset [s]."""
    status = np.array(decision.status)
    return merit.alarms(status[decision.run.t < onset].tolist())


def measured(trials: Sequence[Trial]) -> dict[str, Float[np.ndarray, "trials"]]:
    """Delay [s] and size error [%] of every log, infinite where the fault is not named."""
    found = [trial.found.get(kind) for trial in trials for kind in trial.truth]
    errors = [np.inf if f is None or f.error is None else 100 * abs(f.error) for f in found]
    delays = [np.inf if f is None else max(f.delay, SAMPLE) for f in found]
    return {"delay": np.array(delays), "size error": np.array(errors)}


def figures(trials: Sequence[Trial]) -> dict[str, Any]:
    """Of one judge and kind, as plain numbers."""
    sized = [f.sized for trial in trials for f in trial.found.values() if f.sized is not None]
    medians = {name: float(np.median(each)) for name, each in measured(trials).items()}
    exact = sum(trial.exact for trial in trials)
    return {"exact": exact, "of": len(trials), **medians, "inside": sum(sized), "named": len(sized)}


def ratio(
    above: Sequence[Trial], below: Sequence[Trial], name: str, goal: float
) -> dict[str, float | bool]:
    """Of two medians, with its interval; `met` where the ratio is at most the goal."""
    a, b = measured(above)[name], measured(below)[name]
    drawn = np.random.default_rng(0).integers(len(a), size=(DRAWS, len(a)))
    with np.errstate(invalid="ignore"):  # of infinite medians
        ratios = np.median(a[drawn], axis=1) / np.median(b[drawn], axis=1)
        value = float(np.median(a) / np.median(b))
    kept = ratios[~np.isnan(ratios)]
    ends = np.quantile(kept, [0.025, 0.975], method="nearest") if len(kept) else [np.nan] * 2
    return {"ratio": value, "lo": float(ends[0]), "hi": float(ends[1]), "met": value <= goal}


def compared(found: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """The figures of every judge by kind and in all, and the ratios with their goals."""
    trials = {
        name: {"all": [t for kind in SIZES for t in each["trials"][kind]], **each["trials"]}
        for name, each in found.items()
    }
    both = {"own": (JUDGES[1], GOAL_OWN), "truth": (JUDGES[2], GOAL_TRUTH)}
    return {
        "figures": {n: {k: figures(of) for k, of in each.items()} for n, each in trials.items()},
        "ratios": {
            other: {
                kind: {m: ratio(of, trials[name][kind], m, goal) for m in MEASURES}
                for kind, of in trials[JUDGES[0]].items()
            }
            for other, (name, goal) in both.items()
        },
    }


def show(found: Mapping[str, dict[str, Any]], outcome: Mapping[str, Any]) -> None:
    print(f"{'':12}{'judge':17}{'exact':>9}{'delay [s]':>11}{'size error [%]':>16}{'inside':>9}")
    for kind in ("all", *SIZES):
        for name in JUDGES:
            f = outcome["figures"][name][kind]
            exact, inside = f"{f['exact']}/{f['of']}", f"{f['inside']}/{f['named']}"
            error = f["size error"]
            print(f"{kind:12}{name:17}{exact:>9}{f['delay']:>11.4g}{error:>16.3g}{inside:>9}")
    titles = {
        "own": f"Basilisk over own simulator, goal <= {GOAL_OWN}",
        "truth": f"fitted over truth, goal <= {GOAL_TRUTH}",
    }
    for other, title in titles.items():
        print(f"\n{title}")
        for kind in ("all", *SIZES):
            for name, r in outcome["ratios"][other][kind].items():
                said = "met" if r["met"] else "MISSED"
                ends = f"({r['lo']:.2f} to {r['hi']:.2f})"
                print(f"{kind:12}{name:12}{r['ratio']:>7.2f} {ends:18}{said}")
    print()
    for name, each in found.items():
        hours, logs = each["healthy_hours"], each["healthy_logs_with_alarm"]
        print(
            f"{name}: {each['false_alarms']} false alarms in {hours:.1f} healthy hours; "
            f"{logs} healthy logs with one"
        )


def plain(value: Any) -> Any:
    """`value` as JSON holds it, with None for what is infinite or no number."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trials", type=int, default=10, help="logs of each kind")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    given = parser.parse_args()
    if given.trials < 1:
        parser.error("--trials is at least 1.")
    if not find_spec("Basilisk"):
        print("Basilisk is not installed: pip install faultgauge[peers].", file=sys.stderr)
        return 2
    makers = ((True, basilisk), (True, ours), (False, basilisk))
    found = {
        name: judged(plant_file(free), simulator, given.trials, name)
        for name, (free, simulator) in zip(JUDGES, makers, strict=True)
    }
    outcome = compared(found)
    if given.json:
        goals = {"own": GOAL_OWN, "truth": GOAL_TRUTH}
        print(json.dumps(plain({"goals": goals, **outcome, "judges": found})))
    else:
        show(found, outcome)
    return 0


if __name__ == "__main__":
    sys.exit(main())
