"""Scenarios with faults of parameters and output gains, against SciPy with the constant changed."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.channels import every_channel, happening
from faultgauge.simulation.commands import Commands
from faultgauge.simulation.realtime import Session
from faultgauge.simulation.run_scenario import simulate
from faultgauge.simulation.scenario import parse_scenario
from faultgauge.simulation.schedules import Constant, Schedule

PLANT = """name = "cart"
[states.v]
unit = "m/s"
derivative = "(u - c*v*abs(v))/m"
[inputs.u]
unit = "N"
[outputs.v]
value = "v"
[outputs.force]
value = "c*v*abs(v)"
[parameters]
c = { value = 0.4 }
m = { value = 2 }
[faults.drag]
enters = "parameter"
target = "c"
relative = true
[faults.load]
enters = "parameter"
target = "m"
unit = "kg"
[faults.payload]
enters = "parameter"
target = "m"
relative = true
[faults.bridge]
enters = "output_gain"
target = "force"
"""
SCENARIO = """name = "drive"
plant = "plant.toml"
seconds = 20
step = 0.5
[inputs.u]
source = "constant"
size = 3
"""
DRAG = '[faults.drag]\nprofile = "constant"\nsize = 0.6\nstart = 5\n'


@pytest.fixture
def scenario(tmp_path):
    (tmp_path / "plant.toml").write_text(PLANT)
    return lambda more="": parse_scenario(SCENARIO + more, "s.toml", tmp_path)


def by_scipy(t, pieces):
    """v of the equation with the c of each of `pieces` (end [s], c), one after the other."""
    found, start, v = np.zeros_like(t), 0.0, np.array([0.0])
    for end, c in pieces:

        def rate(_, v, c=c):
            return (3 - c * v * abs(v)) / 2

        solved = solve_ivp(rate, (start, end), v, rtol=1e-10, atol=1e-12, dense_output=True)
        inside = (t >= start) & (t < end)
        found[inside], start, v = solved.sol(t[inside])[0], end, solved.y[:, -1]
    return found


# 20 RK4 steps of 0.025 s at rates of at most 2.2/s: an error below (0.055)^5 a step, 1e-6 in sum
CLOSE = {"rtol": 0, "atol": 1e-6}


def test_more_friction_is_the_equation_with_more_friction(scenario):
    run = simulate(scenario(DRAG))
    v = by_scipy(run.t, [(5.0, 0.4), (20.0, 0.64)])
    np.testing.assert_allclose(run.columns["v"], v, **CLOSE)
    c = np.where(run.t >= 5, 0.64, 0.4)
    np.testing.assert_allclose(run.columns["force"], c * v**2, rtol=0, atol=5e-6)  # 2 c v of it
    np.testing.assert_array_equal(run.columns["true_drag"], np.where(run.t >= 5, 0.6, 0.0))


def test_factors_of_one_parameter_multiply_and_then_the_rest_is_added(scenario):
    text = '[faults.load]\nprofile = "constant"\nsize = 1.5\n'
    text += '[faults.payload]\nprofile = "constant"\nsize = 0.25\n'
    run = simulate(scenario(text))
    # m = 1.25 * 2 + 1.5 = 4: closed form v = sqrt(u/c) tanh(sqrt(u c) t / m)
    v = np.sqrt(3 / 0.4) * np.tanh(np.sqrt(3 * 0.4) * run.t / 4)
    np.testing.assert_allclose(run.columns["v"], v, **CLOSE)


def test_a_disturbance_of_a_parameter_is_not_told(scenario):
    run = simulate(scenario(DRAG.replace("faults", "disturbances")))
    assert list(run.columns) == ["u", "v", "force"]
    np.testing.assert_array_equal(run.columns["v"], simulate(scenario(DRAG)).columns["v"])


@pytest.mark.parametrize(("effect", "share"), [("size = 0.25", 0.75), ('effect = "dropout"', 0.0)])
def test_an_output_loses_gain_in_part_or_whole(scenario, effect, share):
    run = simulate(scenario(f'[faults.bridge]\nprofile = "constant"\nstart = 10\n{effect}\n'))
    healthy = simulate(scenario()).columns["force"]
    late = run.t >= 10
    np.testing.assert_array_equal(run.columns["force"], np.where(late, share * healthy, healthy))
    np.testing.assert_array_equal(run.columns["true_bridge"], np.where(late, 1 - share, 0))


def test_undeclared_output_gains_need_no_declaration(scenario):
    text = '[faults.dim]\nenters = "output_gain"\ntarget = "v"\nprofile = "constant"\nsize = 0.5\n'
    run, healthy = simulate(scenario(text)), simulate(scenario())
    np.testing.assert_array_equal(run.columns["v"], 0.5 * healthy.columns["v"])


def test_a_fault_that_makes_the_plant_fast_gets_the_steps_for_it(tmp_path):
    """(u - x)/T with T from 1 s to 1 ms: 20 steps of 5 ms would explode."""
    (tmp_path / "lag.toml").write_text(
        'name = "lag"\n[states.x]\nderivative = "(u - x)/T"\n[inputs.u]\n[outputs.x]\nvalue = "x"\n'
        "[parameters]\nT = { value = 1 }\n"
        '[faults.fast]\nenters = "parameter"\ntarget = "T"\n'
    )
    text = SCENARIO.replace("plant.toml", "lag.toml").replace("step = 0.5", "step = 0.1")
    text += '[faults.fast]\nprofile = "constant"\nsize = -0.999\nstart = 1\n'
    run = simulate(parse_scenario(text, "s.toml", tmp_path))
    x = np.where(run.t < 1.05, 3 * (1 - np.exp(-run.t)), 3.0)
    np.testing.assert_allclose(run.columns["x"], x, **CLOSE)


def test_a_bench_gives_what_a_whole_run_gives(scenario):
    text = DRAG + DRAG.replace("faults", "disturbances").replace("0.6", "0.5")
    text += '[faults.load]\nprofile = "ramp"\nsize = 1\nstart = 2\nend = 8\n'
    text += '[faults.bridge]\nprofile = "constant"\nsize = 0.5\n'
    planned = scenario(text)
    session, rows = Session(planned, 1e9), []
    session.run(list, rows.append, pytest.fail)
    whole = simulate(planned)
    for name in whole.columns:
        # the same steps, compiled otherwise: rounding of some 1000 steps
        np.testing.assert_allclose([r[name] for r in rows], whole.columns[name], atol=1e-11)


def test_channels_that_stay_closed_change_nothing(scenario):
    signals = load_plant("reaction_wheel").signals
    assert {c.enters for c in every_channel(signals)}.isdisjoint({"parameter", "network"})
    own = [(c.enters, c.target, c.relative) for c in every_channel(scenario().plant.signals)][-3:]
    assert own == [("parameter", "c", True), ("parameter", "m", False), ("parameter", "m", True)]


@pytest.mark.parametrize(
    ("enters", "target", "relative", "expected"),
    [
        ("output_gain", "v", False, 1 - 0.5 * 0.8),
        ("parameter", "c", True, 1.5 * 1.2 - 1),
        ("parameter", "m", False, 0.7),
    ],
)
def test_two_on_one_channel(scenario, enters, target, relative, expected):
    signals = scenario().plant.signals
    pair = [
        Schedule(name, enters, target, Constant(size), relative=relative)
        for name, size in (("a", 0.5), ("b", 0.2))
    ]
    f = happening(pair, signals, np.zeros(1)).f[0]
    assert np.count_nonzero(f) == 1
    np.testing.assert_allclose(f.sum(), expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (DRAG + 'effect = "stuck"\n', "[faults.drag] what enters a parameter changes its value"),
        (DRAG + 'effect = "dropout"\n', "is neither stuck nor dropped out; remove `effect`"),
        (
            DRAG.replace("drag]", 'rub]\nenters = "parameter"\ntarget = "c"'),
            "[faults.rub] the plant declares no fault 'rub' of parameter 'c'; declare it in the "
            "plant file, or take one that it declares: drag, load, payload",
        ),
        (DRAG + 'target = "m"\n', "the plant declares no fault 'drag' of parameter 'm'"),
        (DRAG + "relative = true\n", "unknown key 'relative'"),
        (
            DRAG.replace("drag]", 'f]\nenters = "network"\ntarget = "N"'),
            "take one that it declares: none",
        ),
        (DRAG.replace("drag", "bridge") + 'effect = "stuck"\n', "a gain is not stuck but lost"),
        (
            DRAG.replace("drag]", 'f]\nenters = "output_gain"\ntarget = "u"'),
            "[faults.f] target: unknown output 'u'",
        ),
    ],
)
def test_refusals(scenario, text, said):
    with pytest.raises(InputError) as caught:
        scenario(text)
    message = str(caught.value)
    assert message.startswith("s.toml: ")
    assert said in message
    assert message.endswith(".")
    assert "\n" not in message


def test_commands_know_the_declared_faults(scenario):
    commands = Commands(scenario())
    drag = commands.obey("inject drag 0.6", 2.0).schedule
    assert drag == Schedule("drag", "parameter", "c", Constant(0.6, 2.0), relative=True)
    load = commands.obey("inject load 1 ramp 4", 2.0).schedule
    assert (load.enters, load.unit, load.relative) == ("parameter", "kg", False)
    with pytest.raises(InputError, match="neither stuck nor dropped out; write its SIZE alone"):
        commands.obey("inject drag stuck 1", 3.0)
    with pytest.raises(InputError, match="is no gain loss"):
        commands.obey("inject drag gain 1", 3.0)
    assert commands.obey("inject force gain 0.5", 3.0).schedule.enters == "output_gain"
