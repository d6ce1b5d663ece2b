"""A plant file beside Basilisk's reaction wheel: same law, same torque, two programs.

    python benchmarks/basilisk_wheel.py [--json]

One Honeywell HR16 (75 N*m*s) on a hub so heavy that it stands still, driven by a torque that is
held over each sample and partly beyond the limit of 0.2 N*m. Basilisk's law with w = |Omega|, not
less than omegaLimitCycle = 1e-4 rad/s (reactionWheelStateEffector.cpp, `updateContributions`):

    Js dOmega/dt  =  u - F,        F  =  law(w) * clip(Omega/omegaLimitCycle, -1, 1)
    "coulomb":    law  =  fCoulomb + cViscous w
    "stribeck":   law  =  sqrt(2e) (fStatic - fCoulomb) x exp(-x^2) + fCoulomb tanh(10 w/betaStatic)
                          + cViscous w,        x = w/(sqrt(2) betaStatic)

With betaStatic > 0 Basilisk uses the second from |Omega| < omegaLimitCycle/10 on, for as long as
the wheel speeds up, and the first otherwise. So "coulomb" (betaStatic < 0) runs through zero to
nearly 300 rad/s both ways, and "stribeck" is one start from rest. Js, the torque limit and
fCoulomb are the HR16's; cViscous, fStatic and betaStatic are assumed.

Why 1e-9: both sides take the same classical Runge-Kutta steps, so the error of integration, that
of the step over the jump at zero speed included, is the same on both and is not what is measured.
What is left is the hub's own motion, Js/1e12 of the speed (4e-11 rad/s), and rounding: 6e4 steps
of half a unit in the last place of 300, 3e-14 rad/s, at most 1.6e-9 if all fell on one side and
1e-11 as they do fall. A hundredth of the smallest term, fCoulomb, is 4e-5 rad/s after a second.
"""

import argparse
import json
import sys

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.free_run import free_run

SAMPLE, STEPS = 0.1, 4  # s; Runge-Kutta steps per sample, on both sides
HUB = 1e12  # kg*m^2
TOLERANCE = 1e-9  # rad/s; also N*m: friction's slope is 1.2e-3 N*m*s at most beyond the limit cycle
MOMENTUM, U_MAX = 75.0, 0.2  # N*m*s, N*m
FRICTION = {"fCoulomb": 5e-4, "cViscous": 1e-5}
STRIBECK = {"fStatic": 1e-3, "betaStatic": 5.0}
CASES = {"coulomb": FRICTION, "stribeck": FRICTION | STRIBECK}
LAWS = {
    "coulomb": "fCoulomb + cViscous*{w}",
    "stribeck": "sqrt(exp(1))*(fStatic - fCoulomb)*{w}/betaStatic*exp(-({w}/betaStatic)**2/2)"
    " + fCoulomb*tanh(10*{w}/betaStatic) + cViscous*{w}",
}
UNITS = {
    "speed_rms": "rad/s",
    "speed_max": "rad/s",
    "torque_rms": "N*m",
    "torque_max": "N*m",
    "speed_from": "rad/s",
    "speed_to": "rad/s",
    "zero_crossings": "",
    "beyond_limit": "",
    "sample_time": "s",
    "samples": "",
    "steps_per_sample": "",
}
PLANT = """
name = "HR16 with Basilisk's friction"
[states.h]
unit = "N*m*s"
derivative = "u - ({law})*clip(h/(Js*limit), -1, 1)"
[inputs.u]
unit = "N*m"
min = -{u_max}
max = {u_max}
[outputs.T]
unit = "N*m"
value = "d(h)"
[outputs.hm]
unit = "N*m*s"
value = "h"
[parameters]
{parameters}
"""


def torque(case: str) -> Float[np.ndarray, "samples"]:
    """The command [N*m]: noise in 0.02-0.5 Hz of 0.1 N*m and what a slow triangle of speed needs;
    from rest, always speeding up."""
    count = {"coulomb": 14_400, "stribeck": 600}[case]
    rng = np.random.default_rng(16)
    frequency = np.fft.rfftfreq(count, SAMPLE)
    spectrum = np.fft.rfft(rng.normal(size=count))
    noise = np.fft.irfft(spectrum * ((frequency > 0.02) & (frequency < 0.5)), count)
    noise *= 0.1 / np.std(noise)
    if case == "stribeck":
        return 0.02 + np.abs(noise)
    quarter = np.arange(count) * 4 // count
    return noise + 0.1 * np.array([1, -1, -1, 1])[quarter]


def ours(case: str, parameters: dict[str, float], u: np.ndarray) -> np.ndarray:
    """Speed [rad/s] and torque on the wheel [N*m], one row each, by the plant file."""
    law = LAWS[case].format(w="max(abs(h)/Js, limit)")
    stated = "\n".join(f"{k} = {{ value = {v!r}, fixed = true }}" for k, v in parameters.items())
    text = PLANT.format(law=law, u_max=U_MAX, parameters=stated)
    plant = GrayBoxPlant.untrained(parse_plant(text, "basilisk_wheel.py"))
    steps = jnp.full(len(u), SAMPLE)
    none = jnp.zeros((len(u), 0))
    run = free_run(plant, jnp.zeros(1), jnp.asarray(u)[:, None], steps, none, STEPS)
    return np.stack([run.x[:, 0] / parameters["Js"], run.y[:, 0]])


def basilisk(parameters: dict[str, float], u: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Js, omegaLimitCycle, and the same two rows by Basilisk."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import reactionWheelStateEffector, spacecraft
    from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW

    simulation = SimulationBaseClass.SimBaseClass()
    step = macros.sec2nano(SAMPLE / STEPS)
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", step))
    hub = spacecraft.Spacecraft()
    hub.hub.mHub = HUB
    hub.hub.IHubPntBc_B = (HUB * np.eye(3)).tolist()
    factory = simIncludeRW.rwFactory()
    wheel = factory.create(
        "Honeywell_HR16", [0, 0, 1], maxMomentum=MOMENTUM, useRWfriction=True, **parameters
    )
    effector = reactionWheelStateEffector.ReactionWheelStateEffector()
    factory.addToSpacecraft("wheels", effector, hub)
    command, message = messaging.ArrayMotorTorqueMsg(), messaging.ArrayMotorTorqueMsgPayload()
    effector.rwMotorCmdInMsg.subscribeTo(command)
    log = effector.rwOutMsgs[0].recorder()
    for priority, model in enumerate([log, hub, effector]):  # the highest runs first
        simulation.AddModelToTask("task", model, priority)
    simulation.InitializeSimulation()
    # An update at t takes the command, logs the state from before, then integrates up to t: a
    # sample and its command stand in the log one step late. The friction logged is that of the
    # last Runge-Kutta stage: 3e-12 N*m beside the state where Stribeck's law is steepest.
    simulation.ConfigureStopTime(0)
    simulation.ExecuteSimulation()
    for k, value in enumerate(u):
        message.motorTorque = [float(value)]
        command.write(message)
        simulation.ConfigureStopTime((k + 1) * STEPS * step)
        simulation.ExecuteSimulation()
    applied = log.u_current + log.frictionTorque
    return wheel.Js, wheel.omegaLimitCycle, np.stack([log.Omega, applied])[:, 1::STEPS]


def compare(case: str) -> dict[str, float]:
    """RMS and greatest differences in speed [rad/s] and torque [N*m], and what was covered."""
    u = torque(case)
    inertia, limit, theirs = basilisk(CASES[case], u)
    mine = ours(case, {"Js": inertia, "limit": limit, **CASES[case]}, u)
    speed, moment = np.abs(mine - theirs)
    return {
        "speed_rms": float(np.sqrt(np.mean(speed**2))),
        "speed_max": float(speed.max()),
        "torque_rms": float(np.sqrt(np.mean(moment**2))),
        "torque_max": float(moment.max()),
        "speed_from": float(theirs[0].min()),
        "speed_to": float(theirs[0].max()),
        "zero_crossings": int(np.count_nonzero(np.diff(np.sign(theirs[0, 1:])))),
        "beyond_limit": float(np.mean(np.abs(u) > U_MAX)),
        "sample_time": SAMPLE,
        "samples": len(u),
        "steps_per_sample": STEPS,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    json_wanted = parser.parse_args().json
    try:
        found = {case: compare(case) for case in CASES}
    except ModuleNotFoundError as error:
        if not str(error.name).startswith("Basilisk"):
            raise
        print("Basilisk is not installed: pip install faultgauge[peers].", file=sys.stderr)
        return 2
    rows = found.values()
    good = all(max(row["speed_max"], row["torque_max"]) <= TOLERANCE for row in rows)
    if json_wanted:
        print(json.dumps({"tolerance": TOLERANCE, "met": good, "cases": found}))
        return 0 if good else 1
    print(f"{'':23}", *(f"{case:>12}" for case in found))
    for name, unit in UNITS.items():
        print(f"{name:17}{unit:6}", *(f"{row[name]:>12.6g}" for row in rows))
    print(f"{'tolerance':23}", f"{TOLERANCE:12.6g}", "met" if good else "EXCEEDED")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
