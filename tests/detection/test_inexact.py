"""What a model whose answers are off makes of a posterior, against Bayes' theorem written out."""

import inspect
import types
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import norm

from calibrations import for_bank
from faultgauge.detection.bank import fidelity
from faultgauge.detection.bank.fidelity import (
    SHORTEST_PIECE,
    USUAL_GAIN,
    USUAL_SHAPE,
    Following,
    gain_error,
    shape_error,
)
from faultgauge.detection.posterior.inexact import Inexact, _rival_sets
from faultgauge.observers.branches import BranchInfo
from faultgauge.telemetry import Run
from lags import COUNT, LAG, NOISE, SIGMA, STEP, log, model
from models import as_stated

SETS = 5  # healthy, two faults of the plant, both, unknown
ACTS, SIZE, COMMON = np.array([1.0, 1.0]), np.array([2.0, 4.0]), 1e-3
SOURCES = ((1, -1, 3, -1, -1), (2, 3, -1, -1, -1))
HOLDS = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0, 0]], float)


def inexact(shape=0.1, gain=0.0, acts=ACTS, rivals=(), others=1):
    levels = (np.asarray(each) for each in (COMMON, shape, gain))
    return Inexact(HOLDS, acts, SIZE, *levels, SOURCES, rivals, others)


def said(first, second, most=(0.0, 0.0), sudden=(0.0, 0.0), quick=0.0, told=0.0):
    """Both faults at p 0.9, `first` and `second` being (size, sd); `sudden` are the score and the
    info of the first sample of the second one, `quick` the info of a unit of the first in one
    sample, `told` what had been told of the second one before the first came."""
    f = np.tile([first[0], second[0]], (SETS, 1))
    sd = np.tile([first[1], second[1]], (SETS, 1))
    f[1], sd[1] = (first[0] + 0.5, 9.0), (2 * first[1], 9.0)  # alone it is told otherwise
    p = np.array([0.02, 0.04, 0.03, 0.9, 0.01])
    rest = np.zeros(3), np.zeros((2, 2)), np.zeros((2, 2))
    rest = *rest, np.array([0.95, 0.94]), np.array(most)
    jumps = *np.zeros((3, SETS, 2)), np.array([quick, 0.0])
    jumps[0][:, 1], jumps[1][:, 1] = sudden
    jumps[2][:, 1] = told
    return BranchInfo(
        *map(jnp.asarray, (p, f, sd, *rest, *jumps, np.zeros(1), np.zeros(3), np.zeros(())))
    )


@pytest.mark.parametrize("quick", [0.0, 500.0])
@pytest.mark.parametrize(("jump", "rest"), [(4.0, 1.0), (4.9, -2.0), (40.0, 1.0), (3.0, 6.0)])
def test_what_the_first_sample_told_of_a_sensor_is_not_made_up_by_what_acts_on_the_plant(
    jump, rest, quick
):
    """By hand: it was off by `jump` of its standard deviations, and is by `rest` of them from the
    size that was told. A plant makes up 0.1 * 2 * sqrt(quick) = 4.5 of them within a sample, or
    none."""
    z, sd = 6.0, 0.01
    root = (jump - rest) / (z * sd)  # of the info of the first sample
    given = said((40 * 0.05, 0.05), (z * sd, sd), sudden=(jump * root, root**2), quick=quick)
    found = inexact(acts=np.array([1.0, 0.0])).told(given)
    e, e1 = 0.1 * 40, 0.1 * 40 * 0.05 * np.sqrt(quick)

    left = jump**2 / (1 + e1**2) - rest**2 / (1 + (root * sd) ** 2)
    wide = np.sqrt(1 + e**2 + (SIZE[1] / sd) ** 2)
    real = np.log(COMMON) + norm.logpdf(z, 0, wide) + max(left, 0.0) / 2
    made_up = np.log(e**2 / (1 + e**2)) + norm.logpdf(z, 0, np.hypot(1, e))
    share = expit(made_up - real)
    np.testing.assert_allclose(found.p[3], 0.9 * (1 - share), rtol=1e-6)


@pytest.mark.parametrize(("z", "named"), [(6.0, False), (30.0, True)])
def test_a_second_fault_is_there_as_far_as_the_error_of_the_first_does_not_explain_it(z, named):
    """The first shows at 40 standard deviations, so that 4 of the second are its error's doing."""
    sd = 0.01
    given = said((40 * 0.05, 0.05), (z * sd, sd))
    found = inexact().told(given)
    e = 0.1 * 40
    real = COMMON * norm.pdf(z, 0, np.sqrt(1 + e**2 + (SIZE[1] / sd) ** 2))
    made_up = e**2 / (1 + e**2) * norm.pdf(z, 0, np.hypot(1, e))
    share = made_up / (real + made_up)
    # and the first beside the second, whose error is as small as it is itself
    e1, z1 = 0.1 * z, 40.0
    real1 = COMMON * norm.pdf(z1, 0, np.sqrt(1 + e1**2 + (SIZE[0] / 0.05) ** 2))
    made1 = e1**2 / (1 + e1**2) * norm.pdf(z1, 0, np.hypot(1, e1))
    first_gone = made1 / (real1 + made1)
    both = 0.9 * (1 - share) * (1 - first_gone)
    assert found.p[3] == pytest.approx(both, rel=1e-9)
    assert np.sum(found.p) == pytest.approx(1.0)  # nothing is lost
    assert (found.p[3] > 0.85) == named
    moved = 0.9 * (1 - first_gone) * share
    assert found.ever[1] == pytest.approx(0.94 - moved)
    # alone, the first is a mixture of two
    w = moved / (moved + 0.04)
    assert found.p[1] == pytest.approx(0.04 + moved)
    mean = w * given.f[3, 0] + (1 - w) * given.f[1, 0]
    square = w * (given.f[3, 0] ** 2 + 0.05**2) + (1 - w) * (given.f[1, 0] ** 2 + 0.1**2)
    assert found.f[1, 0] == pytest.approx(mean)
    assert found.sd[1, 0] == pytest.approx(np.sqrt(square - mean**2))


@pytest.mark.parametrize("others", [1, 3])
@pytest.mark.parametrize("gain", [0.0, 0.03])
def test_what_one_fault_leaves_may_be_an_error_of_what_it_does(others, gain):
    """By hand: the first fault explains less than the second, by 30 nats, and shows at 20 standard
    deviations, the error of its size by `gain` left aside. Were it the one, the model's answer to
    it would be off by 0.4 of that, as much like each of the `others`: a normal distribution so much
    wider puts the residual's 60 at 60 / (1 + 0.16 * 400 / others). What both share stays theirs,
    and a model that is right changes nothing."""
    given = said((2.0, 0.1), (0.3, 0.01))
    f, sd = np.array(given.f), np.array(given.sd)
    f[1, 0], sd[1, 0] = 2.0, np.hypot(0.1, gain * 2.0)
    p = np.array([0.01, np.exp(-30.0), 0.98, 1e-30, 0.0])
    p[-1] = 1 - p.sum()
    given = given._replace(p=jnp.asarray(p), f=jnp.asarray(f), sd=jnp.asarray(sd))
    found = inexact(0.4, gain, rivals=((1, 2),), others=others).rivals(given)
    less = (np.log(0.98) + 30.0) / (1 + 0.4**2 * 20.0**2 / others)
    assert float(found[2]) == pytest.approx(0.98 * expit(less), rel=1e-6)
    assert float(found[1] + found[2]) == pytest.approx(0.98, rel=1e-9)
    exact = inexact(0.0, gain, rivals=((1, 2),)).rivals(given)
    assert np.asarray(exact) == pytest.approx(p, rel=1e-9)


def test_rivals_have_as_many_faults_that_act_and_the_same_ones_of_sensors():
    sets = ((), (0,), (1,), (2,), (0, 1), (0, 2), (1, 2))
    assert _rival_sets(sets, np.array([1.0, 1.0, 0.0])) == ((1, 2), (5, 6))
    assert _rival_sets(sets, np.array([1.0, 0.0, 0.0])) == ()


@pytest.mark.parametrize(("told", "most", "named"), [(20.0, 0.0, True), (20.0, 0.2, False)])
def test_what_was_told_of_a_fault_before_a_larger_one_came_is_not_made_up_by_that(
    told, most, named
):
    """By hand: the odds of the fault times e^told, and of one that was larger once as much of that
    as the square of what is left."""
    z, sd = 6.0, 0.01
    given = said((40 * 0.05, 0.05), (z * sd, sd), most=(2.0, most), told=told)
    found = inexact().told(given)
    e = 0.1 * 40
    real = COMMON * norm.pdf(z, 0, np.sqrt(1 + e**2 + (SIZE[1] / sd) ** 2))
    real *= np.exp(told * min(z * sd / most if most else 1.0, 1.0) ** 2)
    made_up = e**2 / (1 + e**2) * norm.pdf(z, 0, np.hypot(1, e))
    e1 = 0.1 * z
    first1 = COMMON * norm.pdf(40.0, 0, np.sqrt(1 + e1**2 + (SIZE[0] / 0.05) ** 2))
    made1 = e1**2 / (1 + e1**2) * norm.pdf(40.0, 0, np.hypot(1, e1))
    both = 0.9 * real / (real + made_up) * first1 / (first1 + made1)
    assert found.p[3] == pytest.approx(both, rel=1e-9)
    assert (found.p[3] > 0.85) == named


def test_what_a_sensors_own_fault_shows_is_known_exactly():
    given = said((2.0, 0.05), (0.06, 0.01))
    rig = inexact(gain=0.1, acts=np.array([0.0, 1.0]))
    found = rig.unsure(rig.told(given))
    # no error of the first makes up the second; its size is as sure as before
    assert found.p[3] == pytest.approx(0.9, rel=1e-3)
    assert found.sd[3] == pytest.approx([0.05, np.hypot(0.01, 0.1 * 0.06)])


@pytest.mark.parametrize(("most", "told"), [(3.0, False), (0.3, False), (0.1, True), (0.0, True)])
def test_a_rest_of_a_fault_that_was_larger_is_there_as_far_as_its_error_does_not_explain_it(
    most, told
):
    """0.06 +- 0.01 are left of 3, of which a tenth, 0.3, may be an error: 30 times its own sd. Of
    the other, 2 +- 0.05, nothing has gone."""
    given = said((2.0, 0.05), (0.06, 0.01), most=(2.0, most))
    found = inexact(shape=0.0, gain=0.1).told(given)
    e, z = 0.1 * max(most - 0.06, 0) / 0.01, 6.0
    real = COMMON * norm.pdf(z, 0, np.sqrt(1 + e**2 + (SIZE[1] / 0.01) ** 2))
    made_up = e**2 / (1 + e**2) * norm.pdf(z, 0, np.hypot(1, e))
    share = made_up / (real + made_up)
    assert found.p[3] == pytest.approx(0.9 * (1 - share), rel=1e-9)
    assert found.p[2] == pytest.approx(0.03 * (1 - share), rel=1e-9)
    # it was there all the same
    assert found.ever == pytest.approx([0.95, 0.94])
    assert np.sum(found.p) == pytest.approx(1.0)
    assert (found.p[3] > 0.85) == told


def test_of_a_sensors_own_fault_a_rest_is_there():
    given = said((2.0, 0.05), (0.06, 0.01), most=(2.0, 3.0))
    found = inexact(shape=0.0, gain=0.1, acts=np.array([1.0, 0.0])).told(given)
    assert found.p[3] == pytest.approx(0.9, rel=1e-9)


def test_an_exact_model_changes_nothing():
    given = said((2.0, 0.05), (0.06, 0.01))
    for before, after in zip(given, inexact(shape=0.0).told(given), strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-12)


def off(run, gain):
    """`run` of a plant whose answer is by `gain` larger: of a linear one from rest, all of it."""
    x = run.columns["x"]
    return Run(
        run.name, run.source, run.t, {**run.columns, "x": x[0] + (1 + gain) * (x - x[0])}, STEP
    )


def test_the_error_of_gain_is_that_of_healthy_logs_and_of_one_usual_one():
    plain, runs = model(), [log(k) for k in (1, 2, 3)]
    exact = gain_error(plain, runs)
    assert exact == pytest.approx(USUAL_GAIN / 2, abs=2e-3)  # noise is a hundredth of what x does
    larger = gain_error(plain, [off(run, 0.2) for run in runs])
    # x(0) is no answer and adds a little
    assert larger == pytest.approx(np.sqrt((3 * 0.2**2 + USUAL_GAIN**2) / 4), rel=0.05)


def fitted():
    """As if it had been fitted."""
    plain = for_bank(model(), NOISE)
    metrics = plain.record.metrics.model_copy(update={"validation_free_run_nrmse": 0.3})
    return replace(plain, record=plain.record.model_copy(update={"metrics": metrics}))


def beside(run, more):
    """`run` with `more` in x."""
    return replace(run, columns={**run.columns, "x": run.columns["x"] + more})


def test_the_error_of_shape_is_what_the_answer_is_off_by():
    runs = [log(k) for k in (1, 2, 3)]
    assert shape_error(for_bank(model(), NOISE), runs, NOISE) == 0.0  # nobody fitted it
    noise = SIGMA / np.mean([np.std(run.columns["x"]) for run in runs])
    assert shape_error(fitted(), runs, NOISE) == pytest.approx(noise, rel=0.2)
    # 1.2 times the answer, and what it begins from is gone within a few samples
    larger = shape_error(fitted(), [off(run, 0.2) for run in runs], NOISE)
    assert larger == pytest.approx(0.2 / 1.2, rel=0.1)
    louder = np.random.default_rng(0)
    drowned = [
        beside(run, 0.8 * np.std(run.columns["x"]) * louder.standard_normal(COUNT)) for run in runs
    ]
    of_noise = NOISE._replace(sigma=0.8 * SIGMA / noise * np.ones(1))
    assert shape_error(fitted(), drowned, NOISE) == pytest.approx(0.8 / np.hypot(1, 0.8), rel=0.05)
    assert shape_error(fitted(), drowned, of_noise) == USUAL_SHAPE  # no closer than noise lets see
    both = 0.8 / 2**0.5 * SIGMA / noise * np.ones(1)
    together = NOISE._replace(sigma=both, wander=both)
    assert shape_error(fitted(), drowned, together) == USUAL_SHAPE
    lost = [off(run, -2.5) for run in runs]  # worse than none
    assert shape_error(fitted(), lost, NOISE) == USUAL_SHAPE


@pytest.mark.parametrize(
    ("offs", "own", "shape"),
    [
        # a level that an inflow moves, a pressure, a flow: each in the parts that follow it best
        ([(1.7, 0.16, 0.16), (1.2, 0.12, 0.2), (1.3, 0.15, 0.3)], 0, np.hypot(0.12, 0.16) / 2**0.5),
        ([(1.7, 0.9, 0.8), (1.2, 0.7, 0.9), (1.3, 0.8, 0.9)], 0, 0.7),  # none is followed
        ([(np.nan, 0.1, np.nan), (np.nan, 0.2, np.nan)], 0, 0.1),  # two that never move
        # most of what no run follows is noise: (0.49 - 0.45) / 0.55; as good as all; more than half
        ([(90, 25, 0.7), (90, 25, 0.8)], (0, 0, 0.45**0.5), np.sqrt(0.04 / 0.55)),
        ([(90, 25, 0.7), (90, 25, 0.8)], (0, 0, 0.69), USUAL_SHAPE),
        ([(90, 25, 0.7), (90, 25, 0.8)], (0, 0, 0.71), 0.7),
        ([(1.3, 1.2, 0.98), (1.3, 1.2, 1.1)], 0.9, 0.98),  # nothing is seen to answer
        ([(90, 25, 0.7), (90, 25, 0.8)], 0.1, np.sqrt(0.48 / 0.99)),
        ([(0.3, 25, 1.1), (0.4, 25, 1.1)], (0.2, 0.1, 0.1), 0.3),  # of what is followed it counts
    ],
)
def test_an_output_that_no_run_follows_tells_nothing_of_shape(offs, own, shape, monkeypatch):
    told = iter(offs)
    monkeypatch.setattr(fidelity, "_off", lambda found: np.array(next(told)))
    monkeypatch.setattr(fidelity, "_free_runs", lambda *given: [])
    monkeypatch.setattr(fidelity, "_own", lambda *given: np.zeros(3) + own)
    signals = types.SimpleNamespace(outputs=[None] * 3)
    metrics = types.SimpleNamespace(validation_free_run_nrmse=0.3)
    fitted = types.SimpleNamespace(
        plant=types.SimpleNamespace(signals=signals),
        record=types.SimpleNamespace(metrics=metrics),
    )
    run = types.SimpleNamespace(t=np.arange(100_000))
    found = inspect.unwrap(shape_error)(fitted, [run], None)
    assert found == pytest.approx(shape)


def test_what_adds_up_over_a_log_is_no_error_of_shape():
    runs = [log(k) for k in (1, 2, 3)]
    moves = float(np.mean([np.std(run.columns["x"]) for run in runs]))
    rises = 20 * moves * np.arange(COUNT) / COUNT
    found = shape_error(fitted(), [beside(run, rises) for run in runs], NOISE)
    # of whole logs the rise is nearly all; of n-th parts of them it is 20 / n / sqrt(12) of moves
    parts = 2 ** int(np.log2(COUNT / SHORTEST_PIECE))
    rise = 20 / parts / np.sqrt(12)
    assert found == pytest.approx(rise / np.hypot(1, rise), rel=0.2)


@pytest.mark.parametrize(
    ("error", "k", "follows"),
    [
        (0.0, 1.05, True),  # off by 5 %, of 7.5 that are borne where the fit leaves next to nothing
        (0.0, 1.1, False),
        (0.2, 1.2, True),  # the plant's own; with the fit 1/6 is left, of which 1/4 is 1.5 times
        (0.2, 0.95, True),  # off by 21 %
        (0.2, 0.8, False),  # by 33 %
    ],
)
def test_constants_are_borne_that_free_runs_follow_about_as_well_as_with_the_fitted_ones(
    error, k, follows
):
    """The fit has k = 1, the logs answer by 1 + `error` times that."""
    text = LAG.replace("u - 0.2*x", "k*u - 0.2*x") + "[parameters]\nk = {{ value = 1.0 }}\n"
    runs = [off(log(seed), error) for seed in (1, 2, 3)]
    assert Following(model(text=text), runs)(("k",), np.array([k - 1.0])) == follows


def test_an_output_that_one_constant_alone_moves_says_whether_it_is_borne():
    """Off by 10 % beside two that follow as before: 5.8 % in the mean of all, of 7.5 that are
    borne."""
    text = (
        LAG.format(more="", rules="")
        + """
[outputs.gauge]
value = "k*x"
[outputs.other]
value = "x"
[parameters]
k = { value = 1.0 }
"""
    )
    names = ("x", "gauge", "other")
    runs = [log(seed) for seed in (1, 2, 3)]
    runs = [replace(r, columns=r.columns | dict.fromkeys(names, r.columns["x"])) for r in runs]
    points = np.random.default_rng(0).uniform([-6, -1], [6, 1], (60, 2))
    follows = Following(as_stated(text, points, outputs=names), runs)
    assert follows(("k",), np.array([0.05]))
    assert not follows(("k",), np.array([0.1]))
