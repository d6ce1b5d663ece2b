"""`[accommodation]` in scenario files: what it does to a run, and what is said of mistakes."""

import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.accommodation.simulate import simulate
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.watch import Watch
from faultgauge.errors import InputError
from faultgauge.plants.gray_box import load_plant
from faultgauge.plants.model import load_model, save_model
from faultgauge.plants.settings import with_settings
from faultgauge.simulation.scenario import parse_scenario
from models import as_stated

LEAK, START = -0.002, 2000.0  # m/s, s
SIGMA, STEP = 0.001, 5.0  # m, s
SCENARIO = f"""name = "leaking tank"
plant = "tank"
seconds = 4000
step = 5
[initial]
level = 1.0
[inputs.u]
offset = 1.0
[inputs.u.feedback.level]
kp = 4.0
[references.level]
source = "constant"
size = 1.0
[noise]
level = 0.001
[faults.leak]
profile = "constant"
size = {LEAK}
start = {START}
end = 3000
[accommodation]
policy = "estimate"
model = "tank.fgm"
[accommodation.authority]
u = 0.5
[accommodation.slew]
u = 0.01
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the model is that the scenario names, uncalibrated beside it."""
    home = tmp_path_factory.mktemp("accommodation")
    points = np.random.default_rng(0).uniform([0.2, 0.0], [2.0, 2.5], (80, 2))
    columns = [("level", 0)], ("level",)
    model = as_stated(load_plant("tank").spec.text, points, *columns)
    levels = [SIGMA], [1e-5], [], [1e-6], [50.0], [1e-3], [5.0]
    constants = [1e-4] * 2, [0.0] * 2, [0.0] * 2
    noise = Noise(*(np.array(each) for each in (*levels, *constants)))
    save_model(model, home / "raw.fgm")
    save_model(for_bank(model, noise), home / "tank.fgm")
    return home


@pytest.fixture(scope="module")
def run(folder):
    return lambda text: simulate(parse_scenario(text, folder=folder))


@pytest.fixture(scope="module")
def accommodated(run):
    return run(SCENARIO)


@pytest.fixture(scope="module")
def estimated(run):
    return run(SCENARIO.replace('"estimate"', '"none"'))


def test_the_level_is_back_while_the_tank_leaks(accommodated, estimated):
    late = (accommodated.t > 2600) & (accommodated.t < 3000)
    # without: 0.01 (1 - 4 e) - 0.01 sqrt(1 + e) = -leak gives e = -0.002/0.045 by first order
    alone = estimated.columns["level"][late].mean() - 1.0
    assert alone == pytest.approx(LEAK / 0.045, rel=0.03)
    # with: the estimate's own error, a twentieth of the leak
    assert abs(accommodated.columns["level"][late].mean() - 1.0) < 0.05 * abs(alone)


def test_the_compensation_is_the_leak_in_volts(accommodated):
    late = (accommodated.t > 2600) & (accommodated.t < 3000)
    assert accommodated.columns["added_u"][late].mean() == pytest.approx(-LEAK / 0.01, rel=0.02)
    assert np.all(accommodated.columns["acted_leak"][late] == 1.0)


def test_nothing_is_added_before_the_leak_nor_long_after(accommodated):
    t, added = accommodated.t, accommodated.columns["added_u"]
    # V: the difference of two commands near 1 V, to rounding
    assert np.abs(added[(t < START) | (t > 3500)]).max() < 1e-14
    assert np.all(accommodated.columns["acted_leak"][(t < START) | (t > 3500)] == 0.0)


def test_it_comes_and_goes_no_faster_than_its_slew(accommodated):
    steps = np.abs(np.diff(accommodated.columns["added_u"]))
    assert steps.max() <= 0.01 * 5 * (1 + 1e-9)


def test_authority_bounds_it(run):
    weak = run(SCENARIO.replace("u = 0.5", "u = 0.1"))
    assert np.abs(weak.columns["added_u"]).max() == pytest.approx(0.1)


def test_policy_none_leaves_the_log_as_it_was(run, estimated):
    without = run(SCENARIO[: SCENARIO.index("[accommodation]")])
    for name in ("u", "level", "true_leak"):
        assert np.array_equal(without.columns[name], estimated.columns[name])
    assert not any(name.startswith("fhat") for name in without.columns)


def test_the_same_file_gives_the_same_log(run, accommodated):
    again = run(SCENARIO)
    for name, column in accommodated.columns.items():
        assert np.array_equal(column, again.columns[name]), name


def test_what_is_acted_upon_is_what_the_log_says(folder, accommodated):
    """The walk along the log that was written, apart from the loop that it was in: one posterior.
    Row by row the loop is another program, so that figures differ by rounding; of a row in which
    the command has just moved, its rules see the new one and the loop's saw the old."""
    watch = Watch(load_model(folder / "tank.fgm"), ("u", "level"), STEP)
    row = watch.along(watch.init(), prepared(watch.signals, accommodated))[1]
    acted = accommodated.columns["acted_leak"] == 1.0
    assert np.mean(row.verdict.named[:, 0] == acted) > 0.999
    judged = row.verdict.named[:, 0] & acted
    told = accommodated.columns["fhat_leak"][judged]
    assert told == pytest.approx(row.posterior.f[judged, 0], rel=1e-6)


@pytest.mark.study
def test_a_passive_fault_is_estimated_and_not_acted_upon(folder):
    model = load_model(folder / "tank.fgm")
    text = model.plant.spec.text + 'monitor = "passive"\n'
    (folder / "passive.toml").write_text(text)
    save_model(with_settings(model, folder / "passive.toml"), folder / "passive.fgm")
    passive = simulate(parse_scenario(SCENARIO.replace("tank.fgm", "passive.fgm"), folder=folder))
    late = (passive.t > 2600) & (passive.t < 3000)
    assert passive.columns["fhat_leak"][late].mean() == pytest.approx(LEAK, rel=0.05)
    assert not passive.columns["acted_leak"].any()
    assert np.abs(passive.columns["added_u"]).max() < 1e-14


def test_adrc_decides_nothing_and_holds_the_level_too(run):
    text = '"adrc"\ndesired = "tank"\nbandwidth = 0.05'
    adrc = run(SCENARIO.replace('"estimate"\nmodel = "tank.fgm"', text))
    late = (adrc.t > 2600) & (adrc.t < 3000)
    assert abs(adrc.columns["level"][late].mean() - 1.0) < 0.003
    assert np.all(adrc.columns["acted_leak"] == 1.0)


ADRC = '"adrc"\ndesired = "tank"\n'
GIVEN = '"estimate"\nmodel = "tank.fgm"'
MISTAKES = {
    "policy": ('"estimate"', '"cure"', "policy"),
    "key": ("model =", "modl =", "modl"),
    "an alarm of its own": (GIVEN, GIVEN + "\npersistence = 3", "persistence"),
    "no input": ("u = 0.5", "v = 0.5", "v"),
    "no authority": ("[accommodation.authority]\nu = 0.5", "", "authority"),
    "no model": ('model = "tank.fgm"\n', "", "`faultgauge calibrate`"),
    "no file": ("tank.fgm", "x.fgm", "x.fgm"),
    "a plant file": ('"tank.fgm"', '"tank"', "no model file (.fgm)"),
    "not calibrated": ("tank.fgm", "raw.fgm", "not calibrated"),
    "another plant": (GIVEN, ADRC.replace('"tank"', '"four_tanks"'), "same order"),
    "no desired": ('"estimate"', '"adrc"', "desired"),
    "useless desired": ('"estimate"', '"estimate"\ndesired = "tank"', "desired"),
    "useless bandwidth": ('"estimate"', '"estimate"\nbandwidth = 0.1', "bandwidth"),
    "no bandwidth": (GIVEN, ADRC, "bandwidth"),
    "no such fault": (GIVEN, ADRC + 'fault = "lek"', "lek"),
    "adrc with a model": ('"estimate"', ADRC, "remove `model`"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_answered_by_their_key(run, name):
    old, new, words = MISTAKES[name]
    assert old in SCENARIO
    with pytest.raises(InputError) as caught:
        run(SCENARIO.replace(old, new))
    assert words in str(caught.value)
    if name != "no file":  # a file that cannot be read is named itself
        assert "[accommodation]" in str(caught.value)
