"""Scenario files: what they mean, and how they are refused."""

import re
from pathlib import Path

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.excitation.multisine import multisine
from faultgauge.excitation.noise import band_limited_noise
from faultgauge.simulation.run_scenario import simulate
from faultgauge.simulation.scenario import parse_scenario, read_scenario

DOCS = Path(__file__).parents[2] / "docs" / "scenario.md"
EXAMPLES = re.findall(r"^```toml\n(.*?)^```$", DOCS.read_text(), re.MULTILINE | re.DOTALL)
PLANT = """name = "integrator"
[states.x]
unit = "m"
derivative = "k*u"
min = -50
[inputs.u]
unit = "m/s"
max = 3
hold = "HOLD"
[outputs.y]
value = "x"
sigma = 0.5
[outputs.z]
value = "2*x"
[parameters]
k = { value = 1, min = 0, max = 9 }
[faults.leak]
enters = "state"
target = "x"
unit = "m/s"
"""
BASE = """name = "s"
plant = "plant.toml"
seconds = 4
step = 0.5
[noise]
y = 0
[inputs.u]
"""
CONSTANT = BASE + 'source = "constant"\nsize = 1\n'
LEAK = '[faults.leak]\nprofile = "constant"\nsize = -1\nstart = 1\n'


@pytest.fixture
def made(tmp_path):
    """Simulate a scenario text beside the plant above: `made(text, hold) -> Run`."""

    def making(text, hold="zero"):
        (tmp_path / "plant.toml").write_text(PLANT.replace("HOLD", hold))
        path = tmp_path / "scenario.toml"
        path.write_text(text)
        return simulate(path)

    return making


@pytest.mark.parametrize("text", EXAMPLES)
def test_the_examples_of_the_page_run(text):
    run = simulate(parse_scenario(text))
    (truth,) = (name for name in run.columns if name.startswith("true_"))
    assert np.ptp(run.columns[truth]) > 0
    assert np.isfinite(list(run.columns.values())).all()


def test_the_leaking_tank_keeps_its_level_and_the_pump_gives_what_leaks():
    run = simulate(parse_scenario(EXAMPLES[0]))
    u, level = run.columns["u"], run.columns["level"]
    before, after = (run.t > 2000) & (run.t < 2500), run.t > 3500
    for part in (before, after):  # 100 samples of noise 0.002: their mean is good to 2e-4
        assert level[part].mean() == pytest.approx(1.2, abs=1e-3)
    # k_in = 0.01: a leak of 0.002 m/s asks for 0.2 V more; the PI's noise on u is 4*0.002/10
    assert u[after].mean() - u[before].mean() == pytest.approx(0.2, abs=0.004)


def test_what_a_log_holds(made):
    run = made(CONSTANT + LEAK)
    assert list(run.columns) == ["u", "y", "z", "true_leak"]
    np.testing.assert_array_equal(run.t, np.arange(8) * 0.5)
    np.testing.assert_array_equal(run.columns["u"], 1.0)
    np.testing.assert_allclose(run.columns["y"], [0, 0.5, 1, 1, 1, 1, 1, 1], atol=1e-12)  # sums
    np.testing.assert_array_equal(run.columns["true_leak"], [0, 0, -1, -1, -1, -1, -1, -1])


def test_a_disturbance_acts_and_is_not_told(made):
    run = made(CONSTANT + LEAK.replace("faults.leak", "disturbances.leak"))
    assert list(run.columns) == ["u", "y", "z"]
    assert run.columns["y"][-1] == pytest.approx(1.0, abs=1e-12)


def test_stuck_and_dropped_channels_in_the_log(made):
    text = (
        CONSTANT
        + '[faults.s]\nenters = "output"\ntarget = "y"\neffect = "stuck"\n'
        + 'profile = "constant"\nsize = 9\nstart = 1\nend = 2\n'
        + '[faults.d]\nenters = "output"\ntarget = "z"\neffect = "dropout"\n'
        + 'profile = "intermittent"\nperiod = 2\n'
    )
    run = made(text)
    nan = np.nan
    np.testing.assert_allclose(run.columns["y"], [0, 0.5, 9, 9, 2, 2.5, 3, 3.5], atol=1e-12)
    np.testing.assert_array_equal(run.columns["true_s"], [nan, nan, 9, 9, nan, nan, nan, nan])
    np.testing.assert_allclose(run.columns["z"], [nan, nan, 2, 3, nan, nan, 6, 7], atol=1e-12)
    np.testing.assert_array_equal(run.columns["true_d"], [1, 1, 0, 0, 1, 1, 0, 0])


def test_parameters_initial_values_limits_and_thinning(made):
    head = "log_every = 2\n[parameters]\nk = 2\n[initial]\nx = 5\n"
    text = BASE.replace("[noise]", head + "[noise]") + 'source = "constant"\nsize = 7\n'
    run = made(text)
    np.testing.assert_array_equal(run.t, [0, 1, 2, 3])
    np.testing.assert_array_equal(run.columns["u"], 3.0)  # its limit
    np.testing.assert_allclose(run.columns["y"], [5, 11, 17, 23], atol=1e-12)


def test_feedback_and_reference(made):
    text = BASE.replace("seconds = 4", "seconds = 40") + (
        "[inputs.u.feedback.z]\nkp = 0.5\n"
        '[references.z]\nsource = "steps"\ntimes = [10]\nvalues = [3]\noffset = 1\n'
    )
    z = made(text).columns["z"]
    # z' = 2 u with u = (r - z)/2 held for 0.5 s: half of the error is left after each sample
    np.testing.assert_allclose(z[:21], 1 - 0.5 ** np.arange(21), atol=1e-12)
    assert z[-1] == pytest.approx(4.0, abs=1e-12)


@pytest.mark.parametrize(
    ("kind", "made_by"), [("noise", band_limited_noise), ("multisine", multisine)]
)
def test_exciting_inputs_are_the_experiments_own(made, kind, made_by):
    text = BASE.replace("seconds = 4", "seed = 3\nseconds = 100")
    text += f'source = "{kind}"\nsigma = 0.2\nlow = 0.05\nhigh = 0.5\noffset = 1\n'
    u = made(text).columns["u"]
    expected = 1 + made_by(np.random.default_rng([3, 0, 0]), 200, 0.5, 0.05, 0.5, 0.2)
    np.testing.assert_array_equal(u, np.minimum(expected, 3.0))


def test_triangles(made):
    u = made(BASE + 'source = "triangles"\namplitude = 2\ncycles = 1\n').columns["u"]
    np.testing.assert_allclose(u, [0, 1, 2, 1, 0, -1, -2, -1], atol=1e-15)  # rounding


def test_noise_has_its_deviation_and_no_fault_moves_it(made):
    text = CONSTANT.replace("seconds = 4", "seconds = 2000").replace("y = 0", "z = 0.1")
    healthy = made(text)
    faulty = made(text + LEAK)
    rest = healthy.columns["z"] - healthy.t * 2
    # 4000 samples: a standard deviation is good to 1.1 %, four times that
    assert rest.std() == pytest.approx(0.1, rel=0.045)
    # the plant file's sigma where the scenario says nothing
    assert (healthy.columns["y"] - healthy.t).std() == pytest.approx(0.5, rel=0.045)
    shift = healthy.columns["z"] - faulty.columns["z"]
    np.testing.assert_allclose(shift, 2 * np.maximum(healthy.t - 1, 0), atol=1e-8)  # 4000 sums
    other = made(text.replace("seconds", "seed = 1\nseconds"))
    assert np.corrcoef(other.columns["y"] - other.t, healthy.columns["y"] - other.t)[0, 1] < 0.1


@pytest.mark.parametrize(("hold", "u"), [("zero", [1, 1, 2, 2, 2, 2, 0, 0]),
                                         ("linear", [1, 1.5, 2, 2, 2, 1, 0, 0])])  # fmt: skip
def test_a_recorded_input_is_replayed(made, tmp_path, hold, u):
    (tmp_path / "old.csv").write_text("clock,volt\n100,1\n101,2\n102,2\n103,0\n104,0\n")
    text = BASE + 'source = "log"\npath = "old.csv"\ncolumn = "volt"\ntime = "clock"\n'
    np.testing.assert_allclose(made(text, hold).columns["u"], u, atol=1e-12)


STIFF = """name = "stiff"
plant = "stiff.toml"
seconds = 2
step = 0.1
[inputs.u]
source = "constant"
size = 1
"""


def test_a_fast_plant_gets_more_steps_than_the_default(tmp_path):
    """Rate 1000/s and samples of 0.1 s: with 20 steps RK4 would explode (rate*h = 5)."""
    (tmp_path / "stiff.toml").write_text(
        'name = "stiff"\n[states.x]\nderivative = "1000*(u - x)"\n[inputs.u]\n'
        '[outputs.x]\nvalue = "x"\n'
    )
    x = simulate(parse_scenario(STIFF, folder=tmp_path)).columns["x"]
    np.testing.assert_allclose(x, [0, *np.ones(19)], atol=1e-12)  # exp(-100) is gone
    with pytest.raises(InputError, match=r"leaves all bounds at t = .* raise `substeps`"):
        simulate(parse_scenario("substeps = 20\n" + STIFF.replace("seconds = 2", "seconds = 20"),
                                folder=tmp_path))  # fmt: skip


def add(text):
    return lambda base: base + text


def swap(old, new):
    def change(base):
        assert old in base
        return base.replace(old, new)

    return change


FAULT = '[faults.f]\nenters = "input"\ntarget = "u"\nprofile = "constant"\nsize = 1\n'
WRONG = {  # what is done to a good scenario, and what the refusal says
    "toml": (add("[x"), "not valid TOML"),
    "unknown key": (swap("seconds", "secnds"), "unknown key 'secnds' (did you mean 'seconds'?)"),
    "unknown table": (add("[fault.f]\n"), "unknown key 'fault'"),
    "missing key": (swap("step = 0.5\n", ""), "key 'step' is missing"),
    "text for a number": (swap("step = 0.5", 'step = "x"'), "step = 'x': should be a number"),
    "negative time": (swap("step = 0.5", "step = -1"), "step = -1: should be greater than 0"),
    "infinite": (swap("seconds = 4", "seconds = inf"), "seconds = inf"),
    "one sample": (swap("seconds = 4", "seconds = 0.5"), "give more than 0.5 s"),
    "one row": (swap("seconds = 4", "seconds = 4\nlog_every = 8"), "fewer than two rows"),
    "too long": (swap("seconds = 4", "seconds = 1e12"), "more than 20000000 integration steps"),
    "seed": (swap("seconds = 4", "seconds = 4\nseed = -1"), "seed = -1: should be greater"),
    "no plant": (swap("plant.toml", "plont.toml"), "plant = 'plont.toml'"),
    "no preset": (swap("plant.toml", "tonk"), "presets dc_motor"),
    "parameter": (add("[parameters]\nkk = 1\n"), "[parameters] unknown parameter 'kk'"),
    "parameter's limits": (add("[parameters]\nk = 10\n"), "k = 10 lies outside [0, 9]"),
    "state": (add("[initial]\ny = 1\n"), "[initial] unknown state 'y'"),
    "state's limits": (add("[initial]\nx = -51\n"), "x = -51 lies outside [-50, inf]"),
    "noise's name": (swap("y = 0", "yy = 0"), "[noise] unknown output 'yy'"),
    "negative noise": (swap("y = 0", "y = -1"), "[noise] y = -1"),
    "no input": (swap('[inputs.u]\nsource = "constant"\nsize = 1\n', ""), "no table for 'u'"),
    "other input": (add('[inputs.w]\nsource = "constant"\nsize = 1\n'), "unknown input 'w'"),
    "no source": (swap('source = "constant"\n', ""), "[inputs.u] key 'source' is missing"),
    "unknown source": (swap('"constant"', '"const"'), "[inputs.u] source: unknown source 'const'"),
    "source's key": (swap("size = 1", "sise = 1"), "[inputs.u]: unknown key 'sise'"),
    "key of another source": (add("period = 1\n"), "[inputs.u]: unknown key 'period'"),
    "backwards": (swap("size = 1", "size = 1\nstart = 2\nend = 1"), "end = 1 must be later than"),
    "band": (
        swap('"constant"\nsize = 1', '"noise"\nsigma = 1\nlow = 0.1\nhigh = 2'),
        "[inputs.u] The band 0.1 to 2 Hz",
    ),
    "steps, lengths": (
        swap('"constant"\nsize = 1', '"steps"\ntimes = [1, 2]\nvalues = [1]'), "2 times but 1"
    ),
    "steps, order": (
        swap('"constant"\nsize = 1', '"steps"\ntimes = [2, 1]\nvalues = [1, 2]'), "must increase"
    ),
    "steps, cell": (
        swap('"constant"\nsize = 1', '"steps"\ntimes = [1, "a"]\nvalues = [1, 2]'), "times[1] = 'a'"
    ),
    "no log": (
        swap('"constant"\nsize = 1', '"log"\npath = "no.csv"\ncolumn = "u"'), "no.csv does not"
    ),
    "feedback of nothing": (
        add("[inputs.u.feedback.x]\nkp = 1\n"), "[inputs.u.feedback] unknown output 'x'"
    ),
    "feedback's key": (
        add("[inputs.u.feedback.y]\nkd = 1\n"), "[inputs.u.feedback.y]: unknown key 'kd'"
    ),
    "feedback is no table": (add("[inputs.u.feedback]\nkp = 1\n"), "[inputs.u.feedback.NAME]"),
    "idle reference": (
        add('[references.y]\nsource = "constant"\nsize = 1\n'), "no input has feedback of 'y'"
    ),
    "fault's target": (add(FAULT.replace('"u"', '"x"')), "[faults.f] target: unknown input 'x'"),
    "fault's entry": (add(FAULT.replace('"input"', '"imput"')), "[faults.f]: enters = 'imput'"),
    "fault's profile": (add(FAULT.replace('"constant"', '"step"')), "unknown profile 'step'"),
    "fault without entry": (add(FAULT.replace('enters = "input"\n', "")), "'enters' is missing"),
    "fault's key": (add(FAULT + "begin = 1\n"), "[faults.f]: unknown key 'begin'"),
    "fault's name": (add(FAULT.replace("faults.f", "faults.'a b'")), "'a b' is not a name"),
    "stuck gain": (
        add(FAULT.replace('"input"', '"gain"') + 'effect = "stuck"\n'), "a gain is not stuck"
    ),
    "dropout with a size": (add(FAULT + 'effect = "dropout"\n'), "a dropout has no size"),
    "dropout by ramp": (
        add(FAULT.replace("constant", "ramp") + 'effect = "dropout"\n'), "constant or intermittent"
    ),
    "late fault": (add(FAULT + "start = 4\n"), "[faults.f] acts in no row of the log"),
    "no sample at all": (
        add('[faults.f]\nenters = "output"\ntarget = "z"\neffect = "dropout"\n'
            'profile = "constant"\n'), "output 'z' gives no sample"
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_refusals_name_file_and_key(made, tmp_path, case):
    change, said = WRONG[case]
    with pytest.raises(InputError) as caught:
        made(change(CONSTANT))
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'scenario.toml'}: ")
    assert said in message
    assert message.endswith(".")
    assert "\n" not in message


@pytest.mark.parametrize("hold", ["linear", "band-limited"])
def test_feedback_needs_an_input_that_is_held(made, hold):
    words = rf'\[inputs.u.feedback\] needs an input that is held, .* hold = "{hold}"'
    with pytest.raises(InputError, match=words):
        made(CONSTANT + "[inputs.u.feedback.y]\nkp = 1\n", hold)


def test_a_log_that_is_too_short_has_holes_or_several_runs_is_refused(made, tmp_path):
    text = BASE + 'source = "log"\npath = "old.csv"\ncolumn = "v"\n'
    for cells, said in [
        ("t,v\n0,1\n1,2\n3,2\n", "ends after 3 s, but the scenario's last sample is at 3.5 s"),
        ("t,v\n0,1\n1,\n4,2\n", "has empty cells"),
        ("t,v,run\n0,1,a\n4,2,a\n0,1,b\n4,2,b\n", "holds 2 runs"),
        ("t,w\n0,1\n4,2\n", "no column 'v'"),
    ]:
        (tmp_path / "old.csv").write_text(cells)
        with pytest.raises(InputError, match=re.escape("[inputs.u] ")) as caught:
            made(text)
        assert said in str(caught.value)


def test_an_untrained_network_is_no_plant_to_simulate():
    text = CONSTANT.replace("plant.toml", "reaction_wheel_network")
    with pytest.raises(InputError, match=r"networks \(NN1, NN2\) are untrained.*faultgauge fit"):
        parse_scenario(text)


def test_a_true_column_must_not_hide_a_signal(made, tmp_path):
    scenario = CONSTANT.replace("plant.toml", "other.toml") + LEAK.replace(
        "size", 'enters = "input"\ntarget = "u"\nsize'
    )
    plant = PLANT.replace("HOLD", "zero").replace("outputs.z", "outputs.true_leak")
    (tmp_path / "other.toml").write_text(plant)
    with pytest.raises(InputError, match="true_leak, is a signal of the plant"):
        made(scenario)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"absent.toml: cannot be read \(No such file"):
        read_scenario(tmp_path / "absent.toml")
