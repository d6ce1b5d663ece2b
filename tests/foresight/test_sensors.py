"""One sensor more: what it would tell of two leaks, by least squares over both tanks.

a' = u - a/5 + f_a,  b' = a/5 - b/5 + f_b, b measured: long after its onset a constant leak of
either tank moves b by as much, and only its first minute differs.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from calibrations import for_bank
from faultgauge.detection.answer.smallest import apart_size, around
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.posterior.unit_faults import effects_of, information
from faultgauge.detection.rows.prepared import as_it_acts
from faultgauge.foresight.problems import Problem, size_told
from faultgauge.foresight.sensors import sensors_for
from faultgauge.foresight.structure import structure_of
from faultgauge.plants.record import BetweenRuns
from faultgauge.telemetry import Run
from models import as_stated

TEXT = """
name = "two tanks"
[states.a]
unit = "m"
derivative = "u - 0.2*a"
[states.b]
unit = "m"
derivative = "0.2*a - 0.2*b"
[inputs.u]
hold = "zero"
[outputs.y]
value = "b"
[faults.first]
enters = "state"
target = "a"
max = 2
min = -2
[faults.second]
enters = "state"
target = "b"
max = 2
min = -2
"""
VARYING = (
    TEXT.replace("u - 0.2*a", "feed*u - 0.2*a")
    + """
[parameters.feed]
value = 1.0
vary = "run"
"""
)
STEP, SIGMA, COUNT = 1.0, 0.05, 400


def responses():
    """b and a after a unit leak of each tank from rest, at the ends of the steps."""
    A = np.array([[-0.2, 0.0], [0.2, -0.2]])
    t = STEP * np.arange(1, COUNT // 2 + 1)
    x = np.array([np.linalg.solve(A, expm(A * each) - np.eye(2)) for each in t])
    return x[:, 1], x[:, 0]  # [time, fault]


def left(responses, size):
    """About the second fault beside the first one of `size`."""
    first, second = responses[:, 0], responses[:, 1]
    J11, J12, J22 = second @ second, first @ second, first @ first
    return J11 - J12**2 / (J22 + size**-2.0)


def bank_of(text):
    points = np.random.default_rng(0).uniform(0, 10, (40, 3))
    small = {"a": 1e-9, "b": 1e-9}
    noise = {
        "sigma": {"y": SIGMA}, "process": small, "drift": {}, "size": small,
        "lasting": {"a": 50.0, "b": 50.0}, "share": {"u": 1e-9}, "settling": {"u": 5.0},
        "spread": {}, "shift": {}, "renewed": {},
    }  # fmt: skip
    model = as_stated(text, points, [("a", 0), ("b", 0)], ["y"])
    between = BetweenRuns(apart={"feed": 0.1}, off={"y": SIGMA}, lasting=50.0)
    model = replace(model, record=model.record.but(between=between if "feed" in text else None))
    model = for_bank(model, noise, healthy_s=1000.0, mtbfa_s=100.0)
    t = STEP * np.arange(COUNT)
    run = Run("r", "r.csv", t, {"u": np.ones(COUNT), "y": np.full(COUNT, 5.0)})
    return build_fault_bank(model, [run], noise_of(model)), run


@pytest.fixture(scope="module")
def bank():
    return bank_of(TEXT)


def test_a_sensor_in_between_tells_two_leaks_apart(bank):
    bank, run = bank
    effects = effects_of(bank, as_it_acts(bank.model.plant.signals, run))
    signals = bank.model.plant.signals
    structure = structure_of(bank.model.plant.spec, bank.outputs, signals.faults)
    assert not structure.isolable("second", "first")
    problem = Problem(1, 0, 0.02)
    found = information(effects, COUNT // 2, around(COUNT // 2, COUNT), [COUNT - 1])
    alone = size_told(bank, found, 1, 0, STEP * COUNT)
    b, a = responses()
    # at its own onset alone: others leave less, so the size is larger than that
    at_once = apart_size(left(b / SIGMA, 1.0) ** -0.5)
    assert alone > at_once
    (sensor, *_) = sensors_for(bank, run, effects, structure, [problem])
    assert sensor.value == "a"
    assert sensor.unit == "m"
    assert sensor.structural == (True,)
    points = np.asarray(bank.model.record.envelope_points)
    # as good, against its range in training, as the sensor of b
    assert sensor.sigma == pytest.approx(SIGMA * np.ptp(points[:, 0]) / np.ptp(points[:, 1]))
    both = np.concatenate([b / SIGMA, a / sensor.sigma])
    # the second leak leaves nothing in a, the first one does, from whatever onset
    expected = apart_size(left(both, 1.0) ** -0.5)
    assert sensor.sizes[0] == pytest.approx(expected, rel=0.1)
    assert sensor.sizes[0] < alone / 2


@pytest.mark.study
def test_a_sensor_is_proposed_where_a_constant_differs_from_run_to_run():
    bank, run = bank_of(VARYING)
    effects = effects_of(bank, as_it_acts(bank.model.plant.signals, run))
    structure = structure_of(bank.model.plant.spec, bank.outputs, bank.model.plant.signals.faults)
    (sensor, *_) = sensors_for(bank, run, effects, structure, [Problem(1, 0, 0.02)])
    assert sensor.value == "a"
    assert np.isfinite(sensor.sizes[0])
