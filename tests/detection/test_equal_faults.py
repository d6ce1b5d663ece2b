"""Faults that look the same are named; faults that do not are left alone."""

import numpy as np
import pytest

from faultgauge.detection.calibration.equal_faults import equal_faults, signatures
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from models import record_of

PLANT = """
name = "two masses"
[states.x]
derivative = "u - 0.2*x"
[states.z]
derivative = "0.5*x - 0.4*z"
[inputs.u]
min = 0
max = 2
[outputs.x]
value = "x"
[outputs.z]
value = "z"
[detection]
max_simultaneous = {most}
"""
FAULTS = {
    "pump": ("input", "u"),
    "leak": ("state", "x"),
    "loss": ("gain", "u"),
    "drip": ("state", "z"),
    "gauge": ("output", "x"),
    "level": ("output", "z"),
}
RUN = Run("h", "h.csv", 0.1 * np.arange(50), dict.fromkeys("uxz", np.zeros(50)))


def model(names, most=2, more=""):
    text = PLANT.format(most=most)
    for name in names:
        enters, target = FAULTS[name]
        text += f'\n[faults.{name}]\nenters = "{enters}"\ntarget = "{target}"\n{more}'
    points = np.random.default_rng(0).uniform(0.1, 1.9, (30, 3))
    record = record_of(max_step=0.1, envelope_points=points.tolist())
    return Model(GrayBoxPlant.untrained(parse_plant(text)), record)


def test_signatures_are_the_step_answers_of_the_linear_plant():
    """x(n) = (1 - exp(-a n h)) / a for a push on x; RK4 errs by 1.3e-9 of a step."""
    h = signatures(model(["leak", "gauge"]), [RUN]).reshape(30, 100, 2, 2)
    n = np.arange(100)
    wanted = (1 - np.exp(-0.2 * 0.1 * n)) / 0.2
    np.testing.assert_allclose(h[3, :, 0, 0], wanted, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(h[3, :, 0, 1], 1.0)


@pytest.mark.parametrize(
    ("names", "most", "said"),
    [
        (["pump", "leak"], 2, ["'pump' and 'leak' act on the measured outputs in the same way"]),
        (["pump", "loss"], 2, []),  # as u varies, a share of it is no constant
        (["leak", "drip", "gauge"], 2, []),
        (["drip", "level"], 1, []),  # a drift and a jump
        (["pump", "leak", "drip"], 1, ["'pump' and 'leak'"]),
    ],
)
def test_which_faults_are_the_same(names, most, said):
    found = equal_faults(model(names, most), [RUN]).warnings
    assert len(found) == len(said)
    assert all(part in sentence for part, sentence in zip(said, found, strict=True))


def test_three_faults_of_which_any_two_look_like_the_others():
    """What pushes x alone, z alone and both alike spans a plane."""
    base = model(["leak", "drip"]).plant.spec.text
    both = base.replace('"u - 0.2*x"', '"u + v - 0.2*x"').replace('0.4*z"', '0.4*z + v"')
    both += '\n[inputs.v]\n[faults.vent]\nenters = "input"\ntarget = "v"\n'
    plant = GrayBoxPlant.untrained(parse_plant(both))
    record = record_of(max_step=0.1, envelope_points=np.ones((3, 4)).tolist())
    columns = dict.fromkeys("uvxz", np.zeros(50))
    (sentence,) = equal_faults(Model(plant, record), [Run("h", "h.csv", RUN.t, columns)]).warnings
    assert "'leak', 'drip' and 'vent' any two together look like any other two" in sentence


def test_a_disabled_fault_is_not_compared():
    assert equal_faults(model(["pump", "leak"], more='monitor = "disabled"\n'), [RUN]) == ([], [])


def test_a_plant_too_stiff_for_steps_of_runge_kutta_has_faults_of_its_own():
    """Where a step grows, all that acts on it looks like what grows; the plant itself settles."""
    text = """
name = "drive"
[states.v]
derivative = "u - 500*v"
[states.x]
derivative = "v"
[inputs.u]
[outputs.x]
value = "x"
[faults.load]
enters = "input"
target = "u"
[faults.loss]
enters = "gain"
target = "u"
"""
    points = np.random.default_rng(0).uniform(-1, 1, (30, 3))
    record = record_of(max_step=0.1, envelope_points=points.tolist())
    stiff = Model(GrayBoxPlant.untrained(parse_plant(text)), record)
    assert equal_faults(stiff, [RUN]) == ([], [])
    # v settles at 1/500 within a sample, so x goes up by dt / 500 less what that took: 1 / 500^2
    h = signatures(stiff, [RUN]).reshape(30, 100, 1, 2)
    np.testing.assert_allclose(h[0, 99, 0, 0], (9.9 - 1 / 500) / 500, rtol=1e-9)
