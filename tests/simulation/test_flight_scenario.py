"""Scenarios whose plant is a wheel of a satellite in flight."""

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.run_scenario import simulate
from faultgauge.simulation.satellite.observatory import run
from faultgauge.simulation.scenario import parse_scenario

FLIGHT = """
name = "flight"
plant = "reaction_wheel"
seconds = 300
step = 0.25
seed = 3

[satellite]
axis = "roll"
angles = [1, 0, 0]
momenta = [10, 20, -10]
"""
FRICTION = """
[faults.friction]
profile = "constant"
size = 0.1
start = 200
"""
DROPOUT = """
[noise]
hm = 0.01
[faults.silence]
enters = "output"
target = "hm"
effect = "dropout"
profile = "constant"
start = 100
end = 150
"""


def test_the_log_is_the_flight():
    log = simulate(parse_scenario(FLIGHT))
    flown = run(
        load_plant("reaction_wheel"), 300.0, 3, angles=(1.0, 0.0, 0.0), momenta=(10.0, 20.0, -10.0)
    )
    assert list(log.columns) == ["u", "T", "hm", "roll", "pitch", "yaw"]
    np.testing.assert_array_equal(log.t, flown.t)
    np.testing.assert_array_equal(log.columns["u"], flown.u[:, 0])
    np.testing.assert_array_equal(log.columns["T"], flown.torque[:, 0])
    np.testing.assert_array_equal(log.columns["hm"], flown.momentum[:, 0])
    np.testing.assert_array_equal(log.columns["roll"], np.rad2deg(flown.estimated[:, 0]))


def test_friction_is_made_up_for_by_the_command():
    healthy, faulty = (simulate(parse_scenario(FLIGHT + f)) for f in ("", FRICTION))
    before, after = healthy.t < 200, healthy.t > 290
    np.testing.assert_array_equal(healthy.columns["u"][before], faulty.columns["u"][before])
    shift = (faulty.columns["u"] - healthy.columns["u"])[after].mean()
    # settled after 90 s of a loop of 0.1 rad/s; friction of another momentum is left
    assert shift == pytest.approx(-0.1, abs=1e-3)
    np.testing.assert_array_equal(faulty.columns["true_friction"], np.where(faulty.t < 200, 0, 0.1))


def test_noise_and_dropout_are_in_the_log_alone():
    clean, silent = (simulate(parse_scenario(FLIGHT + more)) for more in ("", DROPOUT))
    np.testing.assert_array_equal(clean.columns["u"], silent.columns["u"])
    gone = np.isnan(silent.columns["hm"])
    np.testing.assert_array_equal(gone, (silent.t >= 100) & (silent.t < 150))
    noise = (silent.columns["hm"] - clean.columns["hm"])[~gone]
    assert np.std(noise) == pytest.approx(0.01, rel=0.1)  # 1000 draws: 2 % standard deviation


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"reaction_wheel"', '"tank"', "is no reaction wheel"),
        ("step = 0.25", "step = 1.0", "write step = 0.25"),
        ("step = 0.25", "step = 0.25\nsubsteps = 7", "no substeps"),
        ("[satellite]", "[initial]\nh = 3\n[satellite]", r"\[initial\] has no use"),
        ('"roll"', '"rool"', "axis"),
        ("[1, 0, 0]", "[1, 0]", "angles"),
        ("[1, 0, 0]", '["a", 0, 0]', "angles"),
    ],
)
def test_what_makes_no_sense_is_refused(old, new, words):
    with pytest.raises(InputError, match=words) as refusal:
        parse_scenario(FLIGHT.replace(old, new))
    assert str(refusal.value).count("\n") == 0
