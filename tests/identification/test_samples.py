"""Training samples: where states and their derivatives come from."""

from dataclasses import replace

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.identification.samples import (
    channels,
    collect,
    column_names,
    in_effect,
    state_column,
)
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

STEP = 0.02


def plant(*lines, inputs="[inputs.u]"):
    return parse_plant("\n".join(['name = "p"', *lines, inputs]), "p.toml")


def state(name, derivative):
    return f"[states.{name}]\nderivative = '{derivative}'"


def output(name, value):
    return f"[outputs.{name}]\nvalue = '{value}'"


DRIVE = plant(state("q", "v"), state("v", "u - 0.1*v"), output("pos", "q"))
WHEEL = plant(state("h", "u"), output("h", "h"), output("T", "d(h)"))


def run(count=400, t=None, name="a", **columns):
    t = STEP * np.arange(count) if t is None else t
    return Run(name, "a.csv", t, columns)


def gather(spec, *runs):
    how = channels(spec, runs)
    return how, *collect(spec, runs, how)


def test_required_and_optional_columns():
    assert column_names(WHEEL.signals) == (["u"], ["h", "T", "d_h"])
    assert column_names(DRIVE.signals) == (["u"], ["q", "v", "pos", "d_q", "d_v"])


def test_state_has_its_own_column_or_an_outputs():
    assert state_column(DRIVE.signals, "q", ["q", "pos"]) == "q"
    assert state_column(DRIVE.signals, "q", ["pos"]) == "pos"
    assert state_column(DRIVE.signals, "v", ["pos"]) is None


def test_state_that_no_column_gives_is_hidden():
    spec = plant(state("q", "2*v"), state("v", "u"), output("q", "q"))
    how = channels(spec, [run(q=np.zeros(400), u=np.zeros(400))])
    assert how.states == (("q", 0), None)
    assert how.hidden == ("v",)
    assert how.sources == (("q", 0),)


def test_inputs_in_effect():
    """By hand: two steps of 0.1 s late under a hold, one and a half on a straight line."""
    late = replace(DRIVE.signals.inputs[0], delay=0.2)
    signals = replace(DRIVE.signals, inputs=(late,))
    log = run(t=0.1 * np.arange(5), u=np.array([1.0, 2.0, 4.0, 8.0, 16.0]), pos=np.zeros(5))
    found = in_effect(signals, log)
    np.testing.assert_array_equal(found.columns["u"], [np.nan, np.nan, 1.0, 2.0, 4.0])
    assert log.columns["u"][0] == 1.0, "the log itself stays"
    straight = replace(signals, inputs=(replace(late, hold="linear", delay=0.15),))
    between = in_effect(straight, log).columns["u"]
    # rounding of 0.1 k - 0.15
    np.testing.assert_allclose(between, [np.nan, np.nan, 1.5, 3.0, 6.0], rtol=1e-12)
    assert in_effect(DRIVE.signals, log) is log
    with pytest.raises(InputError, match="no longer than the delay of input 'u'"):
        in_effect(replace(signals, inputs=(replace(late, delay=9.0),)), log)


def test_column_counts_only_where_every_run_has_it():
    """One run without q's column: q comes from the output that all runs have."""
    rows = np.zeros(400)
    how = channels(DRIVE, [run(q=rows, pos=rows, u=rows), run(pos=rows, u=rows)])
    assert how.states == (("pos", 0), ("pos", 1))
    how = channels(DRIVE, [run(q=rows, u=rows), run(pos=rows, u=rows)])
    assert how.hidden == ("q", "v")


def test_hidden_speed_through_smoothing():
    """q = 1 + 3 t + t^2: speed 3 + 2 t and acceleration 2 at every kernel's centre."""
    t = STEP * np.arange(400)
    u = 2 + 0.1 * (3 + 2 * t)
    how, stretches, noise = gather(DRIVE, run(pos=1 + 3 * t + t**2, u=u))
    assert how.states == (("pos", 0), ("pos", 1))
    (stretch,) = stretches
    np.testing.assert_array_equal(stretch.t, t[stretch.reach : 400 - stretch.reach])
    # rounding of q (80) divided by the step once and twice, times a few
    np.testing.assert_allclose(stretch.samples.x[:, 1], 3 + 2 * stretch.t, rtol=0, atol=1e-11)
    np.testing.assert_allclose(stretch.samples.dx[:, 0], 3 + 2 * stretch.t, rtol=0, atol=1e-11)
    np.testing.assert_allclose(stretch.samples.dx[:, 1], 2.0, rtol=0, atol=1e-9)
    assert set(noise) == {"q", "v"}


def test_chain_of_derivatives():
    """Jerk in, position out: v and a are the first and second derivative of q."""
    spec = plant(state("a", "u"), state("q", "v"), state("v", "a"), output("q", "q"))
    t = STEP * np.arange(400)
    how, (stretch,), _ = gather(spec, run(q=t**3, u=np.full(400, 6.0)))
    assert how.states == (("q", 2), ("q", 0), ("q", 1))
    # a kernel of width W gives t^2 a constant of at most W^2 / 4 on top
    slack = 3 * (2 * stretch.reach * STEP) ** 2 / 4
    np.testing.assert_allclose(stretch.samples.x[:, 2], 3 * stretch.t**2, rtol=0, atol=slack)
    # rounding of 500 over STEP^2
    np.testing.assert_allclose(stretch.samples.x[:, 0], 6 * stretch.t, rtol=0, atol=1e-8)
    # third difference of 500 with rounding 1e-13 over STEP^3 = 8e-6
    np.testing.assert_allclose(stretch.samples.dx[:, 0], 6.0, rtol=0, atol=1e-6)


def test_derivative_column_is_taken_as_it_is():
    rng = np.random.default_rng(0)
    h, u, rate, torque = rng.normal(size=(4, 400))
    how, (stretch,), noise = gather(WHEEL, run(h=h, u=u, d_h=rate, T=torque))
    assert how.rates == ("d_h",)
    assert stretch.reach == 0
    assert noise == {}
    np.testing.assert_array_equal(stretch.samples.x[:, 0], h)
    np.testing.assert_array_equal(stretch.samples.u[:, 0], u)
    np.testing.assert_array_equal(stretch.samples.dx[:, 0], rate)
    np.testing.assert_array_equal(stretch.samples.y, np.stack([h, torque], axis=1))


def staircase(count=400, scale=1.0):
    return scale * np.repeat(np.random.default_rng(1).uniform(-1, 1, count // 5), 5)


def integrate(u):
    return STEP * np.concatenate([[0.0], np.cumsum(u[:-1])])


def test_equation_holds_where_the_input_jumps():
    """h' = u and T = u, sampled exactly: every sample satisfies both equations."""
    u = staircase()
    _, (stretch,), noise = gather(WHEEL, run(h=integrate(u), u=u, T=u))
    samples = stretch.samples
    # rounding of h (1) over the step
    np.testing.assert_allclose(samples.dx, samples.u, rtol=0, atol=1e-12)
    np.testing.assert_allclose(samples.y[:, 1:], samples.u, rtol=0, atol=1e-12)
    inside = slice(stretch.reach, 400 - stretch.reach)
    np.testing.assert_array_equal(stretch.applied[:, 0], u[inside])  # for simulation: unsmoothed
    np.testing.assert_array_equal(stretch.measured[:, 0], integrate(u)[inside])
    assert noise["h"]["window_s"] == 2 * stretch.reach * STEP


def test_commands_beyond_the_actuators_limits():
    """h' = clip(u): the limit acts before the smoothing, as it does in the plant."""
    spec = plant(state("h", "u"), output("h", "h"), inputs="[inputs.u]\nmin = -0.4\nmax = 0.7")
    u = staircase(scale=2.0)
    _, (stretch,), _ = gather(spec, run(h=integrate(np.clip(u, -0.4, 0.7)), u=u))
    np.testing.assert_allclose(stretch.samples.dx, stretch.samples.u, rtol=0, atol=1e-12)


def test_output_without_telemetry_is_nan():
    u = staircase()
    how, (stretch,), _ = gather(WHEEL, run(h=integrate(u), u=u))
    assert how.outputs == ("h",)
    assert np.isnan(stretch.samples.y[:, 1]).all()
    assert np.isnan(stretch.measured[:, 1]).all()
    assert np.isfinite(stretch.samples.y[:, 0]).all()


def test_gaps_split_the_run():
    u = staircase()
    h = integrate(u)
    h[150] = np.nan
    t = STEP * np.arange(400)
    t[300:] += 10
    _, stretches, _ = gather(WHEEL, run(t=t, h=h, u=u))
    reach = stretches[0].reach
    edges = [(s.t[0] - reach * STEP, s.t[-1] + reach * STEP) for s in stretches]
    expected = [(t[0], t[149]), (t[151], t[299]), (t[300], t[399])]
    np.testing.assert_allclose(edges, expected, rtol=0, atol=1e-12)  # rounding of 18 s
    for stretch in stretches:
        np.testing.assert_allclose(stretch.samples.dx, stretch.samples.u, rtol=0, atol=1e-11)


@pytest.mark.parametrize("count", [4, 15, 16, 17])
def test_too_short_a_log_is_refused(count):
    u = np.linspace(-1, 1, count)
    with pytest.raises(InputError, match=r"a\.csv: no stretch of \d+ complete samples"):
        gather(WHEEL, run(count, h=integrate(u), u=u))


def test_irregular_record_lands_on_a_grid():
    rng = np.random.default_rng(2)
    t = np.cumsum(STEP * rng.uniform(0.7, 1.3, 500))
    u = np.repeat(rng.uniform(-1, 1, 100), 5)
    h = np.concatenate([[0.0], np.cumsum(np.diff(t) * u[:-1])])
    _, (stretch,), _ = gather(WHEEL, run(t=t, h=h, u=u))
    assert stretch.step == np.median(np.diff(t))
    np.testing.assert_allclose(np.diff(stretch.t), stretch.step, rtol=1e-9)  # times of 10 s
    # linear interpolation of h errs only in an interval where u jumps, by |du| STEP / 4 at most,
    # and the derivative divides by the window
    slack = 2 * STEP / (2 * stretch.reach * stretch.step)
    np.testing.assert_allclose(stretch.samples.dx, stretch.samples.u, rtol=0, atol=slack)
    assert np.mean(stretch.samples.dx - stretch.samples.u) == pytest.approx(0, abs=0.01)  # no bias


def test_a_stated_sigma_takes_the_place_of_the_estimated_noise():
    from faultgauge.identification.samples import channels, collect
    from faultgauge.plants.plant_file import parse_plant

    text = 'name = "p"\n[states.x]\nderivative = "-k*x"\n[parameters]\nk = {value = 1}\n'
    t = np.linspace(0.0, 10.0, 1001)
    run = Run("r", "r.csv", t, {"x": np.exp(-t)})
    for line, wanted in (("", 0.0), ("sigma = 0.25\n", 0.25)):
        spec = parse_plant(f'{text}[outputs.x]\nvalue = "x"\n{line}')
        noise = collect(spec, [run], channels(spec, [run]))[1]["x"]
        # without noise the third differences are those of exp(-t): 1e-6 at this step
        assert noise["column_noise"] == pytest.approx(wanted, abs=1e-5)
