"""Policies for the paper's wheels, and flights under them."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from faultgauge.accommodation.alarm import Alarm
from faultgauge.accommodation.estimator import JointFaults, SingleFault
from faultgauge.accommodation.feed_forward import Limits
from faultgauge.accommodation.policy import Accommodation, accommodation
from faultgauge.accommodation.wheels import EachWheel
from faultgauge.observers.joint import design_joint
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.gray_box import load_plant
from faultgauge.plants.signals import Fault
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.policy import Policy
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.satellite.observatory import PERIOD, STEPS_PER_PERIOD, run
from faultgauge.simulation.schedules import Schedule
from faultgauge_studies.paper import estimating
from faultgauge_studies.paper.bench import Bench
from faultgauge_studies.paper.cases import SECONDS
from faultgauge_studies.paper.learning import Learned

__all__ = ["FLOOR", "IDEAL", "PERSISTENCE", "TACHOMETER", "beneath", "fly", "joint", "single"]

IDEAL = "ideal_wheel"
TACHOMETER = 0.002  # N*m*s, noise of the measured momentum
# The estimate closes a loop of its own, so its speed is bought with margin: these gains bear 6 dB
# and 30 degrees at the actuators. The study's own observer (0.2 rad/s, zeta 1.01) is as quick, but
# at half the gain it leaves the linear loop's slowest pole at 0.999 instead of 0.996. Chosen on
# that linear loop and on seed 0.
BANDWIDTH, ZETA = 0.33, 1.75  # rad/s, 1
LIMIT, LOSS_LIMIT = 0.01, 0.2  # N*m and 1: a tenth of the paper's least fault, a fifth of a wheel
PERSISTENCE, SETTLING = 2.0, 3.0  # s
AUTHORITY, SLEW = 0.41, 0.05  # N*m, half of the wheel's; N*m/s
FLOOR = 0.2
FRICTION = Fault("friction", "state", "h", "N*m")
LOSS = Fault("loss", "gain", "u", "", -0.5, 1.0)


def single(bench: Bench, name: str, reference: str = "learned") -> Accommodation:
    """The policy `name` with the paper's observer: IESONN over the "learned" plant, ESO over the
    "physics"; "adrc" knows the ideal wheel alone."""
    ideal = load_plant(IDEAL)
    plant = {"learned": bench.learned.model.plant, "physics": bench.wheel}[reference]
    samples = bench.learned.account.training
    observer = estimating.design(
        ideal if name == "adrc" else plant, OperatingPoints(samples.x, samples.u), BANDWIDTH, ZETA
    )
    return _policy(name, SingleFault(observer), [LIMIT])


def joint(learned: Learned, name: str) -> Accommodation:
    """The policy `name` with friction and loss of effectiveness estimated together."""
    samples = learned.account.training
    observer = design_joint(
        with_faults(learned.model.plant, (FRICTION, LOSS)),
        OperatingPoints(samples.x, samples.u),
        PERIOD,
        BANDWIDTH,
        np.array([np.inf, TACHOMETER]),
        PERIOD / STEPS_PER_PERIOD,
    )
    return _policy(name, JointFaults(observer), [LIMIT, LOSS_LIMIT])


def _policy(
    name: str, estimator: SingleFault | JointFaults, limits: Sequence[float]
) -> Accommodation:
    alarm = Alarm(jnp.array(limits), PERSISTENCE, SETTLING)
    bounds = Limits(jnp.array([AUTHORITY]), jnp.array([SLEW]))
    return accommodation(name, estimator, alarm, load_plant(IDEAL), bounds, jnp.eye(1), FLOOR)


def beneath(policy: Policy) -> EachWheel:
    """The same policy for each of the three wheels."""
    return EachWheel(policy, jnp.eye(3))


def fly(bench: Bench, policy: Policy, *faults: Schedule, seconds: float = SECONDS) -> Telemetry:
    """`Bench.fly` under a policy."""
    return run(
        bench.wheel,
        seconds,
        bench.seed,
        bench.inner,
        {"pitch": faults},
        policy=policy,
        tachometer=TACHOMETER,
    )
