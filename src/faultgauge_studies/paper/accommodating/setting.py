"""Policies for the paper's wheels, and flights under them."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from faultgauge.accommodation.estimator import ByPosterior, Estimator, TotalDisturbance
from faultgauge.accommodation.feed_forward import Limits
from faultgauge.accommodation.policy import Accommodation, accommodation
from faultgauge.accommodation.wheels import EachWheel
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.watch import Watch
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.plants.model import Model
from faultgauge.plants.signals import Fault
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.policy import Policy
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.satellite.observatory import PERIOD, run
from faultgauge.simulation.schedules import Schedule
from faultgauge.telemetry import Run
from faultgauge_studies.paper import estimating
from faultgauge_studies.paper.bench import Bench
from faultgauge_studies.paper.cases import SECONDS, inner_disturbance
from faultgauge_studies.paper.learning import PITCH

__all__ = [
    "COLUMNS",
    "FLOOR",
    "IDEAL",
    "PERSISTENCE",
    "TACHOMETER",
    "adrc",
    "beneath",
    "by_posterior",
    "calibrated",
    "calibrated_like",
    "fly",
]

IDEAL = "ideal_wheel"
TACHOMETER = 0.002  # N*m*s, noise of the measured momentum
# ADRC's estimate closes a loop of its own, so its speed is bought with margin: these gains bear
# 6 dB and 30 degrees at the actuators. The study's own observer (0.2 rad/s, zeta 1.01) is as quick,
# but at half the gain it leaves the linear loop's slowest pole at 0.999 instead of 0.996. Chosen on
# that linear loop and on seed 0.
BANDWIDTH, ZETA = 0.33, 1.75  # rad/s, 1
PERSISTENCE = 2.0  # s
AUTHORITY, SLEW = 0.41, 0.05  # N*m, half of the wheel's; N*m/s
FLOOR = 0.2
COLUMNS = ("u", "hm")  # what a policy reads of a wheel
FRICTION = Fault("friction", "state", "h", "N*m")
LOSS = Fault("loss", "gain", "u", "", -0.5, 1.0)
HEALTHY = 10_000  # added to a seed: that of a flight to calibrate on


def calibrated(model: Model, wheel: GrayBoxPlant, seed: int) -> Model:
    """`model` with the faults friction and loss of effectiveness, calibrated on the pitch wheel of
    a healthy flight under no policy."""
    flown = run(wheel, SECONDS, HEALTHY + seed, (inner_disturbance(wheel),))
    u, h = np.asarray(flown.u[:, PITCH]), np.asarray(flown.momentum[:, PITCH])
    noise = TACHOMETER * np.random.default_rng([HEALTHY + seed, 0]).standard_normal(len(h))
    log = Run("healthy", "healthy flight", np.asarray(flown.t), {"u": u, "hm": h + noise})
    return calibrate(_declared(model), [log]).model


def calibrated_like(other: Model, model: Model) -> Model:
    """`model` of another wheel of the kind, fitted by the same means, with the calibration of
    `other`."""
    return _declared(model).with_calibration(other.calibration)


def _declared(model: Model) -> Model:
    return replace(model, plant=with_faults(model.plant, (FRICTION, LOSS)))


def by_posterior(model: Model, name: str) -> Accommodation:
    """The policy `name`, which acts on what a calibrated `model` names."""
    return _policy(name, ByPosterior(Watch(model, COLUMNS, PERIOD)))


def adrc(bench: Bench) -> Accommodation:
    """The policy "adrc" by the paper's observer, which knows the ideal wheel alone."""
    samples = bench.learned.account.training
    points = OperatingPoints(samples.x, samples.u)
    observer = estimating.design(load_plant(IDEAL), points, BANDWIDTH, ZETA)
    return _policy("adrc", TotalDisturbance(observer))


def _policy(name: str, estimator: Estimator) -> Accommodation:
    bounds = Limits(jnp.array([AUTHORITY]), jnp.array([SLEW]))
    return accommodation(name, estimator, load_plant(IDEAL), bounds, jnp.eye(1), FLOOR)


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
