"""The paper's faults on the pitch wheel, eqs (16) to (19), and when each run is judged."""

from dataclasses import dataclass

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.simulation.schedules import Constant, Schedule, Sine, Steps

__all__ = [
    "CASES",
    "MODE_1",
    "ONSET",
    "PHYSICAL",
    "SECONDS",
    "SUSTAINED",
    "Case",
    "inner_disturbance",
]

SECONDS = 1000.0
ONSET = 500.0
UNBALANCE, RIPPLE = 0.02, 0.2  # rad and rad/s: theta_a and omega_a of the disturbance f(t)
OBSERVED = 700.0  # s: the end of what the paper shows of mode 2, whose loop is broken


@dataclass(frozen=True)
class Case:
    """A fault on pitch; residuals are judged from 0 to `until` [s]; it jumps at `jumps` [s]."""

    title: str
    fault: Schedule
    until: float
    jumps: tuple[float, ...]


def inner_disturbance(wheel: GrayBoxPlant) -> Schedule:
    """f(t) = theta_a J omega_a^2 sin(omega_a t), N*m: inside the wheel, known to no model."""
    size = UNBALANCE * float(wheel.parameters["J"]) * RIPPLE**2
    return Schedule("f", "state", "h", Sine(size, RIPPLE), unit="N*m")


def _friction(profile: Constant | Steps) -> Schedule:
    return Schedule("d1", "state", "h", profile, "add", "N*m")


def _output(profile: Constant | Steps) -> Schedule:
    return Schedule("d2", "output", "T", profile, "stuck", "N*m")


def _speed(profile: Constant | Steps) -> Schedule:
    return Schedule("d2", "state", "h", profile, "stuck", "N*m")


EQ_17 = Steps((500.0, 600.0, 700.0, 800.0), (0.1, 0.15, 0.2, 0.0))
EQ_19 = Steps((500.0, 550.0, 600.0, 650.0), (0.05, 0.08, 0.1, 0.0))
SUSTAINED = Constant(0.1, ONSET)

CASES: dict[str, Case] = {
    "mode1_sustained": Case("mode 1, sustained", _friction(SUSTAINED), SECONDS, (ONSET,)),
    "mode1_intermittent": Case(
        "mode 1, intermittent (eq 17)", _friction(EQ_17), SECONDS, EQ_17.times
    ),
    "mode2_sustained": Case("mode 2, sustained", _output(SUSTAINED), OBSERVED, (ONSET,)),
    "mode2_intermittent": Case(
        "mode 2, intermittent (eq 19)", _output(EQ_19), OBSERVED, EQ_19.times
    ),
}
MODE_1 = ("mode1_sustained", "mode1_intermittent")
# What the text says of mode 2: the speed changes steadily, so d(h)/dt itself is stuck.
PHYSICAL = Case("mode 2 as d(h)/dt = d2", _speed(SUSTAINED), OBSERVED, (ONSET,))
