"""1000 s of a spacecraft on three reaction wheels: ours, many at once with sensors, attitude filter
and controller in the loop, beside Basilisk's spacecraft and wheels alone, and beside real time.

    python benchmarks/spacecraft.py

Both integrate by Runge-Kutta of order four in steps of 0.05 s, wheels with friction.
"""

import statistics
from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.satellite.flights import flights
from faultgauge.simulation.satellite.observatory import PERIOD, STEPS_PER_PERIOD, paper_satellite
from interleave import Absent, Times, interleaved

__all__ = ["compete"]

SECONDS, COUNT = 1000, 512
BY_BASILISK = 100  # s of one spacecraft
STEP = PERIOD / STEPS_PER_PERIOD  # s


def ours() -> Callable[[], int]:
    satellite = paper_satellite(load_plant("reaction_wheel"))

    def work() -> int:
        flights(satellite, COUNT, SECONDS)
        return COUNT * SECONDS

    return work


def basilisk() -> Callable[[], int] | Absent:
    """One spacecraft on three Honeywell HR16 that hold their torque; what it tells is not kept."""
    if not find_spec("Basilisk"):
        return Absent("not installed: pip install faultgauge[peers]")
    from Basilisk.architecture import messaging
    from Basilisk.simulation import reactionWheelStateEffector, spacecraft
    from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW

    def work() -> int:
        simulation = SimulationBaseClass.SimBaseClass()
        task = simulation.CreateNewTask("task", macros.sec2nano(STEP))
        simulation.CreateNewProcess("process").addTask(task)
        hub = spacecraft.Spacecraft()
        hub.hub.mHub = 1000.0
        hub.hub.IHubPntBc_B = np.diag([3000.0, 2800.0, 2500.0]).tolist()
        factory = simIncludeRW.rwFactory()
        for axis in np.eye(3).tolist():
            factory.create(
                "Honeywell_HR16", axis, maxMomentum=75.0, useRWfriction=True, fCoulomb=5e-4,
                cViscous=1e-5,
            )  # fmt: skip
        effector = reactionWheelStateEffector.ReactionWheelStateEffector()
        factory.addToSpacecraft("wheels", effector, hub)
        command, message = messaging.ArrayMotorTorqueMsg(), messaging.ArrayMotorTorqueMsgPayload()
        message.motorTorque = [0.05, -0.03, 0.02]
        command.write(message)
        effector.rwMotorCmdInMsg.subscribeTo(command)
        for priority, model in enumerate([hub, effector]):  # the highest runs first
            simulation.AddModelToTask("task", model, priority)
        simulation.InitializeSimulation()
        simulation.ConfigureStopTime(macros.sec2nano(float(BY_BASILISK)))
        simulation.ExecuteSimulation()
        return BY_BASILISK

    return work


def compete(rounds: int) -> tuple[Times, dict[str, str]]:
    """Seconds per second simulated; ours on all cores."""
    times, absent = interleaved({"faultgauge": ours(), "Basilisk": basilisk()}, rounds)
    return times | {"real time": [1.0] * rounds}, absent


def main() -> None:
    times, absent = compete(3)
    for name, each in times.items():
        print(f"{name}: {1 / statistics.median(each):,.0f} times real time")
    for name, why in absent.items():
        print(f"{name}: {why}")


if __name__ == "__main__":
    main()
