"""From signals to excitation, and what the large wheel does under it."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal

from faultgauge.errors import InputError
from faultgauge.excitation import Experiment, Sweep, coverage, design
from faultgauge.plants.gray_box import load_plant
from faultgauge.plants.signals import Input, Output, Signals, State
from faultgauge.simulation.closed_loop import Conditions, Controller, closed_loop, with_faults
from faultgauge.simulation.schedules import inject

WHEEL = Signals(
    states=(State("h"),),
    inputs=(Input("u", "N*m", -0.82, 0.82),),
    outputs=(Output("T"), Output("hm", measures="h")),
)
TANK = Signals(  # a pump with two limits, a heater with one, a valve with none
    states=(State("level", "m", 0.0, 2.0), State("heat", "K", min=0.0)),
    inputs=(Input("pump", "V", 0.0, 10.0), Input("heater", "kW", min=0.0), Input("valve")),
    outputs=(Output("level", "m", measures="level"), Output("t", "K", measures="heat")),
)
SIGMA = {"heater": 0.5, "valve": 2.0}


def experiment(kind="noise", seconds=1000.0, dt=1.0, **more):
    return Experiment(kind, seconds, dt, **more)


def swept(kind="noise_with_sweep", sigma=SIGMA, **sweep):
    wanted = {"output": "level", "gain": 3.0, "input": "pump", **sweep}
    return experiment(kind, sigma=sigma, sweep=Sweep(**wanted))


def test_the_wheel_of_the_paper():
    sweep = Sweep("hm", 0.01, amplitude=150.0)
    found = design(experiment("noise_with_sweep", sigma={"u": 0.4}, sweep=sweep), WHEEL, 0)
    np.testing.assert_array_equal(found.t, np.arange(1000.0))
    np.testing.assert_array_equal(found.kp, [[0.0, 0.01]])
    # two triangles: a quarter of 500 samples up, two down, one back
    assert found.reference[[0, 125, 250, 375, 500, 625], 1].tolist() == [0, 150, 0, -150, 0, 150]
    assert not found.reference[:, 0].any()
    assert np.abs(found.feedforward).max() == 0.82  # 4 % of Gaussian samples are beyond 2.05 sigma
    # clipping at 2.05 sigma leaves 96 % of a deviation; 790 free samples scatter by 2.5 %
    assert found.feedforward.std() == pytest.approx(0.96 * 0.4, rel=0.1)


@pytest.mark.parametrize("kind", ["noise", "multisine"])
def test_without_a_sweep_nothing_is_fed_back(kind):
    found = design(experiment(kind), WHEEL, 0)
    assert found.feedforward.shape == (1000, 1)
    assert not found.reference.any()
    assert not found.kp.any()


def test_a_multisine_passes_the_actuator_whole():
    """Its peaks stay inside the limits by default, so that its lines stay the only ones."""
    u = design(experiment("multisine"), WHEEL, 0).feedforward[:, 0]
    assert np.abs(u).max() < 0.82
    f, power = signal.periodogram(u, detrend=False)
    assert power[(f < 0.0045) | (f > 0.4005)].max() < 1e-20  # rounding
    assert u.std() == pytest.approx(0.41, rel=1e-9)


def test_each_input_has_its_own_size_and_place():
    found = design(experiment(seconds=20_000.0, sigma=SIGMA), TANK, 0).feedforward
    # 0.79 free samples in each of 20,000: means scatter by 0.8 % of sigma, deviations by 0.6 %;
    # clipping at 2 sigma takes 4 % of a deviation, at one side 2 %
    np.testing.assert_allclose(found.mean(axis=0), [5.0, 1.0, 0.0], atol=0.1)
    np.testing.assert_allclose(found.std(axis=0), [2.5, 0.5, 2.0], rtol=0.06)
    assert found[:, :2].min() == 0.0
    assert found[:, 0].max() == 10.0


def test_an_offset_moves_an_input():
    found = design(experiment(offset={"u": -0.5}, sigma={"u": 0.01}), WHEEL, 0).feedforward
    assert found.mean() == pytest.approx(-0.5, abs=0.002)  # 5 of 0.01/sqrt(790)


def test_inputs_are_independent_and_seeds_reproduce():
    wanted = experiment(seconds=20_000.0, sigma=SIGMA)
    found = design(wanted, TANK, 3).feedforward
    np.testing.assert_array_equal(found, design(wanted, TANK, 3).feedforward)
    together = np.corrcoef(found.T, design(wanted, TANK, 4).feedforward.T)
    assert np.abs(together - np.eye(6)).max() < 5 / np.sqrt(0.79 * 20_000)


@pytest.mark.parametrize(
    ("sweep", "centre", "top"),
    [
        ({}, 1.0, 1.9),  # limits [0, 2]: 90 % of the half-range around the middle
        ({"centre": 0.5}, 0.5, 0.95),
        ({"amplitude": 0.3}, 1.0, 1.3),
        ({"output": "t", "centre": 300.0}, 300.0, 570.0),  # one limit, at 0
    ],
)
def test_the_range_of_a_sweep_follows_from_the_state(sweep, centre, top):
    found = design(swept(**sweep), TANK, 0)
    output = 1 if "output" in sweep else 0
    reference = found.reference[:, output]
    # rounding of 570
    np.testing.assert_allclose(reference[[0, 125, 375]], [centre, top, 2 * centre - top], atol=1e-9)
    assert found.kp[0, output] == 3.0
    assert np.count_nonzero(found.kp) == 1


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (experiment(), r"'heater' has the limits \[0, inf\].*\[inputs.heater\].*in kW"),
        (experiment(sigma={"heater": 0.0}), "'heater' has sigma = 0"),
        (experiment(sigma={"heatr": 1.0}), "unknown input 'heatr' .did you mean 'heater'"),
        (experiment(offset={"pump": 11.0}), r"'pump' has offset = 11, outside its limits \[0, 10"),
        (experiment(seconds=0.3), "seconds = 0.3 with dt = 1"),
        (experiment(seconds=float("nan")), "seconds = nan"),
        (experiment(seconds=1e300), "at most 10000000"),
        (experiment("noise_with_sweep", sigma=SIGMA), "'noise_with_sweep' needs a sweep"),
        (swept("noise"), "'noise' does not take a sweep"),
        (swept(output="lvl"), "sweep names an unknown output 'lvl'"),
        (swept(amplitude=1.1), r"'level' goes to 1 \+- 1.1.*limits \[0, 2\] of state 'level'"),
        (swept(amplitude=0.5, centre=1.8), r"'level' goes to 1.8 \+- 0.5"),
        (swept(output="t"), "'t' around 0 has no amplitude.*in K"),
        (swept(gain=0.0), "'level' has gain = 0"),
        (swept(input=None), "'level' does not say which input.*pump, heater, valve"),
        (swept(input="pomp"), "sweep names an unknown input 'pomp'"),
    ],
)
def test_refusals_name_what_to_change(wanted, words):
    with pytest.raises(InputError, match=words):
        design(wanted, TANK, 0)


@pytest.mark.parametrize(
    ("sweep", "words"),
    [
        (Sweep("T", 0.01, 150.0), "cannot drive output 'T', .*outputs that are: hm"),
        (Sweep("hm", 0.01), r"'hm' around 0 has no amplitude.*\[-inf, inf\] of state 'h'"),
    ],
)
def test_refusals_of_the_wheel(sweep, words):
    with pytest.raises(InputError, match=words):
        design(experiment("noise_with_sweep", sweep=sweep), WHEEL, 0)


@pytest.mark.parametrize("hold", ["linear", "band-limited"])
def test_a_sweep_needs_an_input_that_is_held(hold):
    signals = Signals(WHEEL.states, (Input("u", "", -1.0, 1.0, hold),), WHEEL.outputs)
    assert design(experiment(), signals, 0).kp.shape == (1, 2)
    with pytest.raises(InputError, match="cannot act on input 'u'"):
        design(experiment("noise_with_sweep", sweep=Sweep("hm", 0.1, 1.0)), signals, 0)


def test_a_plant_without_inputs():
    with pytest.raises(InputError, match="no input"):
        design(experiment(), Signals(WHEEL.states, (), WHEEL.outputs), 0)


def run(wanted):
    """Input and state of the large wheel, from rest, under an experiment."""
    plant = with_faults(load_plant("reaction_wheel"), ())
    found = design(wanted, plant.signals, 0)
    injection = inject((), plant.signals, found.t[:, None] + wanted.dt * np.array([0.0, 0.5]))
    conditions = Conditions(
        jnp.asarray(found.feedforward),
        jnp.asarray(found.reference),
        jnp.zeros(found.reference.shape),
        jnp.asarray(injection.f),
        type(injection.stuck)(*map(jnp.asarray, injection.stuck)),
        jnp.asarray(injection.dropped[:, 0]),
    )
    controller = Controller(jnp.asarray(found.kp), jnp.zeros(found.kp.shape))
    record = closed_loop(plant, controller, jnp.zeros(1), conditions, wanted.dt)
    return np.concatenate([record.u, record.x], axis=1)


def test_noise_alone_leaves_the_wheel_near_rest_and_a_sweep_takes_it_through_its_range():
    """One triangle of 1000 s to 150 N*m*s needs 0.6 N*m and up to 0.11 N*m of friction: less than
    0.82. A gain of 0.1 1/s follows it some 10 s, or 6 N*m*s, behind."""
    sweep = Sweep("hm", 0.1, amplitude=150.0, cycles=1)
    kinds = {"noise": None, "noise_with_sweep": sweep, "multisine_with_sweep": sweep}
    found = {
        kind: coverage(
            run(experiment(kind, sigma={"u": 0.4}, sweep=sweep)),
            np.array([-0.82, -150.0]),
            np.array([0.82, 150.0]),
            limits=np.array([[-0.82, 0.82], [-np.inf, np.inf]]),
        )
        for kind, sweep in kinds.items()
    }
    alone = found.pop("noise")
    assert np.abs(alone.reached[1]).max() < 20
    for each in found.values():
        assert each.reached[1, 0] < -140
        assert each.reached[1, 1] > 140
        assert (np.abs(each.reached[0]) == 0.82).all()
        assert each.share[1] > 7 * alone.share[1]
        assert each.occupied > 4 * alone.occupied
