"""Logs and plant files that cannot do: a plain sentence or a warning that names what is wrong."""

import re

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultgauge.errors import InputError
from faultgauge.identification.fit import fit
from faultgauge.identification.simulation_error.uncertainty import information
from faultgauge.identification.simulation_error.window_fit import Fitted, WindowBatch
from faultgauge.identification.unknowns import unknowns_of
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

HEATER = """
name = "heater"
[states.T]
derivative = "b*u - a*T"
[inputs.u]
hold = "zero"
[outputs.y]
value = "2*T"
[parameters]
a = { value = 0.5, min = 0 }
b = { value = 1.0, min = 0 }
"""
STEP, COUNT, NOISE = 0.1, 300, 0.04
STARTS = 4
TIMES = STEP * np.arange(COUNT)


def plant(text):
    return GrayBoxPlant.untrained(parse_plant(text, "plant.toml"))


def response(u, start):
    T, decay = np.full(COUNT, start), np.exp(-0.8 * STEP)
    for k in range(COUNT - 1):
        T[k + 1] = decay * T[k] + (1 - decay) / 0.8 * 2.0 * u[k]
    return 2 * T


def run(seed=0, count=COUNT, u=None, empty=0):
    """y = 2 T, T' = 2 u - 0.8 T under a zero-order hold: closed form; `empty` cells of y."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, COUNT // 10), 10) if u is None else u
    y = response(u, 1.0) + NOISE * rng.standard_normal(COUNT)
    y[rng.permutation(COUNT)[:empty]] = np.nan
    return Run(f"heat{seed}", "heat.csv", TIMES[:count], {"u": u[:count], "y": y[:count]})


def said(text, *logs, validate=()):
    """What the user reads: the refusal, or all warnings."""
    try:
        _, report = fit(plant(text), logs, validate, restarts=STARTS)
    except InputError as error:
        return str(error)
    return "; ".join(report.warnings)


def values(report):
    rows = report.refinement.information.constants
    return np.array([[c.value, c.standard_error] for c in rows], float).T


def test_a_good_log_needs_no_warning():
    assert said(HEATER, run()) == ""


def test_a_run_of_a_dozen_samples():
    assert re.search(r"heat\.csv: no 16 samples in a row", said(HEATER, run(count=12)))


def test_a_run_too_short_for_a_window():
    assert re.search(
        r"'heat0': 1\d samples are left .* needs 25 in a row", said(HEATER, run(count=20))
    )
    text = said(HEATER, run(), validate=[run(1, count=20)])
    assert re.search(r"'heat1' has 20 samples in a row, too few .* needs 25", text)


@pytest.mark.study
def test_a_run_shorter_than_the_warm_up():
    """It is fitted, or selects; a free run from a hidden start has nothing left to score."""
    sentence = (
        r"run 'heat{}' of heat\.csv has at most 4[05] samples .* takes 50 .* cannot be validated"
    )
    assert re.search(sentence.format(0), said(HEATER, run(count=45)))
    assert re.search(sentence.format(1), said(HEATER, run(), validate=[run(1, count=40)]))
    text = said(HEATER, run(), run(1, count=40))
    assert "'heat1'" in text
    assert "'heat0'" not in text
    assert "cannot be validated" not in said(HEATER, run(count=55))


def test_missing_outputs_cost_samples_only():
    _, report = fit(plant(HEATER), [run(empty=30)], restarts=STARTS)
    _, whole = fit(plant(HEATER), [run()], restarts=STARTS)
    found, errors = values(report)
    assert np.all(np.abs(found - [0.8, 2.0]) < 4 * errors)  # beyond with 1e-4, either of two
    # a tenth fewer samples, 5 % more error; the noise is estimated anew, from 200: 5 %, twice
    np.testing.assert_allclose(errors, 1.05 * values(whole)[1], rtol=0.15)


def test_an_input_that_stays_zero():
    """T decays and tells a; nothing tells b."""
    text = said(HEATER, run(u=np.zeros(COUNT)))
    assert "'u'" in text or "'b'" in text


@pytest.mark.parametrize(
    ("limits", "end"),
    [
        # test_fit.py has an upper bound with and without the refinement
        pytest.param("max = 1.5", "max", marks=pytest.mark.study),
        ("value = 3.0, min = 2.5", "min"),
    ],
)
def test_a_parameter_at_its_bound(limits, end):
    limits = limits if "value" in limits else f"value = 1.0, min = 0, {limits}"
    text = HEATER.replace("value = 1.0, min = 0", limits)
    _, report = fit(plant(text), [run()], restarts=STARTS)
    assert report.refinement is not None
    b = next(c for c in report.refinement.information.constants if c.name == "b")
    limit = 1.5 if end == "max" else 2.5
    assert b.value == pytest.approx(limit, rel=1e-12)  # rounding of its scale
    assert b.standard_error is None
    assert b.bound == f"{end} = {limit}"
    assert any(f"parameter 'b' is at its {end} = {limit}" in each for each in report.warnings)


def test_a_plant_that_blows_up():
    """T' = u + T^3 / 2 + 1 from 0 by SciPy: it passes the millions at the time that is named."""
    text = HEATER.replace("b*u - a*T", "b*u + a*T**3 + 1")
    log = run()
    t, state = 0.0, np.zeros(1)
    for k in range(COUNT):
        found = solve_ivp(
            lambda t, x, u: u + 0.5 * x**3 + 1,
            (0, STEP),
            state,
            args=(log.columns["u"][k],),
            rtol=1e-8,
        )
        t, state = k * STEP + found.t[-1], found.y[:, -1]
        if not found.success or abs(state[0]) > 1e6:  # at a pole SciPy's step goes to nothing
            break
    sentence = said(text, log)
    named = re.search(
        r"'heater' blows up: state 'T' .* at t = ([0-9.]+) s of run 'heat0'", sentence
    )
    assert named is not None
    # the next sample, and one more for the Runge-Kutta steps that jump over the pole
    assert t <= float(named[1]) + STEP
    assert float(named[1]) <= t + 2 * STEP


def test_a_plant_that_grows_without_end():
    text = HEATER.replace("b*u - a*T", "b*u + (5 + a)*T")
    assert re.search(r"'heater' blows up: state 'T'", said(text, run()))


def test_a_root_of_what_falls_below_zero():
    """T' = -1 from 0: the root of its negative value is no number after one step."""
    text = HEATER.replace("b*u - a*T", "b*0*u - a*0 - 1 - sqrt(T)")
    sentence = said(text, run())
    assert f"state 'T' is no longer a number at t = {STEP:g} s of run 'heat0'" in sentence
    assert "sqrt" in sentence
    assert "protect it with max()" in sentence


def known(text, weights=None):
    """The information at parameters as the file has them, over one window of 120 samples."""
    model = plant(text)
    if weights is not None:
        name, net = next(iter(model.networks.items()))
        net = type(net)(**{**vars(net), **{k: jnp.asarray(v) for k, v in weights.items()}})
        model = GrayBoxPlant(model.signals, model.spec, {name: net}, model.parameters)
    unknowns, states = unknowns_of(model), len(model.signals.states)
    u, count = run().columns["u"][:120], 120
    dt = np.full(count, STEP)
    dt[-1] = 0.0
    windows = WindowBatch(
        center=np.full((1, states), 0.3),
        sd=np.ones((1, states)),
        stages=np.broadcast_to(u[None, :, None, None], (1, count, 3, 1)).copy(),
        dt=dt[None],
        y=NOISE * np.random.default_rng(1).standard_normal((1, count, 1)),
        weight=np.ones((1, count, 1)),
        walk=np.zeros((1, count, 0, 0)),
    )
    theta, start = unknowns.vector(model), np.zeros((1, states))
    fitted = Fitted(theta, start, np.zeros((1, count, states)), NOISE**2, 0, 1)
    return information(model, unknowns, fitted, windows, 1, 1.0)


def test_a_state_that_no_output_shows():
    text = HEATER.replace("[inputs.u]", '[states.z]\nderivative = "u - 0.2*z"\n[inputs.u]')
    found = known(text)
    assert found.unseen == ("z",)
    assert any("do not show z" in each for each in found.warnings())


def test_a_combination_of_states_that_no_output_shows():
    """y = 2 T + 2 w of two equal heaters: their difference decays unseen."""
    text = HEATER.replace("[inputs.u]", '[states.w]\nderivative = "b*u - a*w"\n[inputs.u]')
    (direction,) = known(text.replace('"2*T"', '"2*T + 2*w"')).unseen
    assert direction == "T -w"
    assert known(text.replace('"2*T"', '"2*T + 1*w + 0.3*w**2"')).unseen == ()


def test_two_parameters_that_do_the_same():
    text = HEATER.replace("a*T", "a*T - c*T") + "c = { value = 0.3, min = 0 }\n"
    found = known(text)
    assert any("'a' and 'c' cannot be told apart" in each for each in found.warnings())
    assert found.correlation[0, 2] < -0.99
    assert known(HEATER).warnings() == []


def test_a_parameter_that_a_network_imitates():
    """a T beside NN(T) is part of it; beside NN(u) it is not, while b u is."""
    weights = {
        "weights_out": np.array([0.2, -0.1, 0.15]),
        "weights_in": np.array([[0.8], [1.7], [-1.1]]),
        "bias": np.array([0.1, -0.4, 0.6]),
        "input_scale": np.array([12.0]),
    }
    text = HEATER + "[networks.NN]\nhidden = 3\n"
    for argument, name in (("T", "a"), ("u", "b")):
        found = known(text.replace("- a*T", f"- a*T - NN({argument})"), weights=weights)
        imitated = {c.name: c.imitated_by for c in found.constants}
        assert imitated == {"a": None, "b": None, name: "NN"}
        assert any(
            f"'{name}' is not identifiable: network 'NN'" in each for each in found.warnings()
        )
