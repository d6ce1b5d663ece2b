"""Scoring by free run: the scores, the start of a run, and what is not scored."""

import re

import numpy as np
import pytest
from scipy.signal import cont2discrete

from faultgauge.errors import InputError
from faultgauge.identification.validation.evaluation import (
    divergence,
    evaluate,
    evaluate_ensemble,
    predict,
    scores,
    start_of_run,
)
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

OSCILLATOR = """
name = "oscillator"
[states.q]
derivative = "v"
[states.v]
derivative = "-4*q - 0.5*v + 2*u"
initial = 0.1
[inputs.u]
[outputs.pos]
value = "q"
[outputs.twice]
value = "2*q + 0.1*v"
"""
STEP, COUNT = 0.02, 300
LONGEST = 0.02  # s, of one RK4 step: (|A| h)^5 / 120 = 3e-8 per step, below 1e-6 in all


def plant(text=OSCILLATOR):
    return GrayBoxPlant.untrained(parse_plant(text, "oscillator.toml"))


def truth(x0, count=COUNT, seed=0):
    """(t, u, x) of the oscillator by its exact discrete matrices under a zero-order hold."""
    A, B = np.array([[0.0, 1.0], [-4.0, -0.5]]), np.array([[0.0], [2.0]])
    Ad, Bd, *_ = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), STEP)
    u = np.repeat(np.random.default_rng(seed).uniform(-1, 1, count // 10), 10)
    x = [np.array(x0, float)]
    for value in u[:-1]:
        x.append(Ad @ x[-1] + Bd[:, 0] * value)
    return STEP * np.arange(count), u, np.array(x)


def run(t, name="a", **columns):
    return Run(name, "a.csv", t, columns)


def test_scores_by_hand():
    measured, predicted = np.array([1.0, 3.0, np.nan, 5.0]), np.array([1.5, 3.0, 9.0, 4.0])
    # errors 0.5, 0 and -1; the three measured values have a variance of 8/3
    rmse = np.sqrt(1.25 / 3)
    found = scores(measured, predicted)
    assert found["rmse"] == pytest.approx(rmse, rel=1e-15)
    assert found["nrmse"] == pytest.approx(rmse / np.sqrt(8 / 3), rel=1e-15)
    assert found["r2"] == pytest.approx(1 - 1.25 / 8, rel=1e-15)


def test_scores_where_there_is_nothing_to_explain():
    assert scores(np.full(3, 2.0), np.array([2.0, 2.0, 5.0])) == {
        "r2": None,
        "rmse": pytest.approx(np.sqrt(3), rel=1e-15),
        "nrmse": None,
    }


def test_scores_of_a_run_that_blew_up():
    # 1e200 is a number, its square is none
    assert scores(np.arange(3.0), np.array([0.0, 1e200, 0.0])) == dict.fromkeys(
        ("r2", "rmse", "nrmse")
    )
    assert scores(np.arange(3.0), np.array([0.0, np.inf, np.nan])) == dict.fromkeys(
        ("r2", "rmse", "nrmse")
    )


def test_hidden_initial_state_from_the_warm_up():
    t, u, x = truth((0.7, -1.3))
    (found,) = predict(
        plant(), [run(t, u=u, q=x[:, 0], pos=x[:, 0], twice=2 * x[:, 0] + 0.1 * x[:, 1])], LONGEST
    )
    assert found.warmup == 50
    # LONGEST's error, and the search stops at 1e-8
    np.testing.assert_allclose(found.x, x, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.predicted[:, 0], x[:, 0], rtol=0, atol=1e-6)


def test_all_states_hidden():
    """Only a mixture of both states has a column: both are found from it."""
    t, u, x = truth((0.7, -1.3))
    (found,) = predict(plant(), [run(t, u=u, twice=2 * x[:, 0] + 0.1 * x[:, 1])], LONGEST)
    np.testing.assert_allclose(found.x[0], [0.7, -1.3], rtol=0, atol=1e-5)  # as above, ten times
    assert np.isnan(found.measured[:, 0]).all()
    np.testing.assert_allclose(found.predicted[:, 0], x[:, 0], rtol=0, atol=1e-5)


def test_known_states_are_left_alone():
    t, u, x = truth((0.7, -1.3))
    y = np.stack([x[:, 0], np.full(COUNT, np.nan)], axis=1)
    _, start = start_of_run(plant(), t[:50], u[:50, None], y[:50], {"q": 0.75, "v": -1.0}, LONGEST)
    np.testing.assert_array_equal(start, [0.75, -1.0])
    _, start = start_of_run(plant(), t[:50], u[:50, None], y[:50], {"q": 0.75}, LONGEST)
    assert start[0] == 0.75


def test_start_takes_noise_as_least_squares_does():
    """The initial state enters linearly: NumPy's least squares on the free response."""
    t, u, x = truth((0.7, -1.3))
    y = x[:50, 0] + 0.01 * np.random.default_rng(1).normal(size=50)
    _, _, forced = truth((0.0, 0.0))
    free = [truth(e)[2][:50, 0] - forced[:50, 0] for e in np.eye(2)]
    reference, *_ = np.linalg.lstsq(np.stack(free, axis=1), y - forced[:50, 0])
    both = np.stack([y, np.full(50, np.nan)], axis=1)
    _, start = start_of_run(plant(), t[:50], u[:50, None], both, {}, LONGEST)
    np.testing.assert_allclose(start, reference, rtol=0, atol=1e-5)


def test_a_hidden_start_keeps_to_the_states_bounds():
    """dx = -x seen through y = 2 x: least squares in closed form, or the bound where it is less."""
    text = """
    name = "leak"
    states.x = { derivative = "-x", min = 0 }
    outputs.y = { value = "2*x" }
    """
    t, decay = STEP * np.arange(50), np.exp(-STEP * np.arange(50))
    for true in (0.3, -0.3):
        y = 2 * true * decay + 0.01 * np.random.default_rng(2).normal(size=50)
        wanted = max(2 * decay @ y / (4 * decay @ decay), 0.0)
        _, start = start_of_run(plant(text), t, np.zeros((50, 0)), y[:, None], {}, LONGEST)
        np.testing.assert_allclose(start, [wanted], rtol=0, atol=1e-5)


def test_warm_up_is_not_scored():
    """Rubbish in one output's first samples costs the start, but is not itself an error."""
    t, u, x = truth((0.7, -1.3))
    log = run(t, u=u, pos=x[:, 0], twice=2 * x[:, 0] + 0.1 * x[:, 1])
    log.columns["twice"][:30] = 5.0
    found, (prediction,) = evaluate(plant(), [log], LONGEST, warmup=30)
    assert found["runs"][0]["samples"] == COUNT - 30
    assert found["runs"][0]["warmup"] == 30
    for j, name in enumerate(("pos", "twice")):
        error = prediction.predicted[30:, j] - log.columns[name][30:]
        rmse = np.sqrt(np.mean(error**2))
        spread = np.std(log.columns[name][30:])
        assert found["outputs"][name]["rmse"] == pytest.approx(rmse, rel=1e-12)
        assert found["outputs"][name]["r2"] == pytest.approx(1 - (rmse / spread) ** 2, rel=1e-12)


def test_no_warm_up_where_nothing_is_hidden():
    t, u, x = truth((0.7, -1.3))
    found, (prediction,) = evaluate(
        plant(), [run(t, u=u, q=x[:, 0], v=x[:, 1], pos=x[:, 0])], LONGEST
    )
    assert prediction.warmup == 0
    assert found["runs"] == [
        {"run": "a", "samples": COUNT, "warmup": 0, "outputs": found["outputs"]}
    ]
    assert list(found["outputs"]) == ["pos"]  # `twice` has no column
    assert found["outputs"]["pos"]["rmse"] < 1e-6  # LONGEST's error


def test_without_warm_up_hidden_states_start_as_the_plant_says():
    t, u, x = truth((0.7, -1.3))
    (found,) = predict(plant(), [run(t, u=u, pos=x[:, 0])], LONGEST, warmup=0)
    np.testing.assert_array_equal(found.x[0], [0.7, 0.1])
    assert found.warmup == 0


def test_gaps_split_and_every_part_starts_anew():
    t, u, x = truth((0.7, -1.3))
    u = np.where(np.arange(COUNT) == 120, np.nan, u)
    t = np.where(np.arange(COUNT) >= 200, t + 9.0, t)
    found, parts = evaluate(plant(), [run(t, u=u, q=x[:, 0], v=x[:, 1], pos=x[:, 0])], LONGEST)
    edges = [(p.t[0], p.t[-1]) for p in parts]
    assert edges == [(t[0], t[119]), (t[121], t[199]), (t[200], t[299])]
    for part, first in zip(parts, (0, 121, 200), strict=True):
        np.testing.assert_array_equal(part.x[0], x[first])
    assert found["runs"][0]["samples"] == COUNT - 1
    assert found["outputs"]["pos"]["rmse"] < 1e-6  # LONGEST's error, over all three parts


def test_empty_outputs_are_gone_through_and_not_scored():
    """One free run, from the warm-up on, through single cells and a long hole."""
    t, u, x = truth((0.7, -1.3))
    empty = np.random.default_rng(3).random(COUNT) < 0.1
    empty[150:220] = True
    empty[0] = False
    off = x[:, 0] + 0.25 * (np.arange(COUNT) >= 50)  # the warm-up does not see it
    found, (part,) = evaluate(plant(), [run(t, u=u, pos=np.where(empty, np.nan, off))], LONGEST)
    np.testing.assert_allclose(part.x, x, rtol=0, atol=1e-5)  # as with the warm-up above
    np.testing.assert_array_equal(np.isnan(part.measured[:, 0]), empty)
    assert found["runs"][0]["samples"] == np.sum(~empty[50:])
    assert found["outputs"]["pos"]["rmse"] == pytest.approx(0.25, abs=1e-5)
    assert found["warnings"] == []


def test_a_run_starts_where_all_measured_states_are():
    t, u, x = truth((0.7, -1.3))
    q, v = x[:, 0].copy(), x[:, 1].copy()
    q[:3], v[3] = np.nan, np.nan
    (found,) = predict(plant(), [run(t, u=u, q=q, v=v, pos=x[:, 0])], LONGEST)
    assert (found.t[0], found.warmup) == (t[4], 0)
    np.testing.assert_allclose(found.x, x[4:], rtol=0, atol=1e-6)
    v[:200] = np.nan  # too late to wait for: found as a hidden state is
    (found,) = predict(plant(), [run(t, u=u, q=q, v=v, pos=x[:, 0])], LONGEST)
    assert (found.t[0], found.warmup) == (t[0], 50)
    np.testing.assert_allclose(found.x, x, rtol=0, atol=1e-5)


def test_states_that_are_never_sampled_together():
    """Sensors that take turns: the one that is empty at first is found as a hidden state is."""
    t, u, x = truth((0.7, -1.3))
    even = np.arange(COUNT) % 2 == 0
    q, v = np.where(even, x[:, 0], np.nan), np.where(even, np.nan, x[:, 1])
    (found,) = predict(plant(), [run(t, u=u, q=q, v=v, pos=q)], LONGEST)
    assert (found.t[0], found.warmup) == (t[0], 50)
    np.testing.assert_allclose(found.x, x, rtol=0, atol=1e-5)


def test_runs_are_scored_apart_and_together():
    t, u, x = truth((0.7, -1.3))
    off = x[:, 0] + 0.25
    logs = [
        run(t, "good", u=u, q=x[:, 0], v=x[:, 1], pos=x[:, 0]),
        run(t, "bad", u=u, q=x[:, 0], v=x[:, 1], pos=off),
    ]
    found, _ = evaluate(plant(), logs, LONGEST)
    assert [r["run"] for r in found["runs"]] == ["good", "bad"]
    assert found["runs"][1]["outputs"]["pos"]["rmse"] == pytest.approx(0.25, abs=1e-6)  # LONGEST
    together = found["outputs"]["pos"]["rmse"]
    assert together == pytest.approx(0.25 / np.sqrt(2), abs=1e-6)  # a mean of squares, not of roots


def test_refusals():
    t, u, x = truth((0.7, -1.3), 20)
    with pytest.raises(InputError, match=r"a\.csv: none of the outputs pos, twice has a column"):
        predict(plant(), [run(t, u=u, q=x[:, 0])], LONGEST)
    holes = np.where(np.arange(20) % 2, np.nan, u)
    with pytest.raises(InputError, match=r"a\.csv: no two samples in a row"):
        predict(plant(), [run(t, u=holes, pos=x[:, 0])], LONGEST)
    with pytest.raises(InputError, match=r"a\.csv: no two samples in a row"):
        predict(plant(), [run(t, u=u, pos=np.full(20, np.nan))], LONGEST)


def test_a_log_that_the_warm_up_uses_up():
    t, u, x = truth((0.7, -1.3), 60)
    log = run(t[:54], u=u[:54], pos=x[:54, 0])
    sentence = (
        r"run 'a' of a\.csv has at most 54 samples .* takes 50 .* smaller --warmup or a longer"
    )
    with pytest.raises(InputError, match=sentence):
        evaluate(plant(), [log], LONGEST)
    found, _ = evaluate(plant(), [log], LONGEST, warmup=49)
    assert found["runs"][0]["samples"] == 5


def test_a_stretch_that_the_warm_up_uses_up_is_named():
    t, u, x = truth((0.7, -1.3))
    late = np.where(np.arange(COUNT) >= 260, t + 9.0, t)
    logs = [run(late, "cut", u=u, pos=x[:, 0]), run(t[:30], "brief", u=u[:30], pos=x[:30, 0])]
    found, (part,) = evaluate(plant(), logs, LONGEST)
    assert (part.run, part.t[-1]) == ("cut", t[259])
    cut, brief = found["warnings"]
    assert "'cut' of a.csv: 1 of 2 stretches, of at most 40 samples, are left out" in cut
    assert "'brief' of a.csv: 1 of 1 stretches, of at most 30 samples" in brief
    # where every state is measured, none needs a warm-up
    logs = [run(each.t, each.name, **each.columns, v=x[: len(each.t), 1]) for each in logs]
    assert evaluate(plant(), logs, LONGEST)[0]["warnings"] == []


def test_plant_without_inputs():
    decay = plant('name = "d"\n[states.x]\nderivative = "-x"\n[outputs.x]\nvalue = "x"')
    t = STEP * np.arange(60)
    found, _ = evaluate(decay, [run(t, x=3 * np.exp(-t))], LONGEST)
    assert found["outputs"]["x"]["rmse"] < 1.5e-9  # RK4: 3 t exp(-t) STEP^4 / 120


def test_ensemble_by_hand():
    """Three decays that start and rise alike but for a known offset of the output."""
    t = STEP * np.arange(60)
    log = run(t, x=3 * np.exp(-t), y=3 * np.exp(-t))
    offsets = (0.1, -0.2, 0.4)
    plants = [
        plant(
            'name = "d"\n[states.x]\nderivative = "-x"\n[outputs.y]\n'
            f'value = "x + c"\n[parameters]\nc = {{ value = {c}, fixed = true }}'
        )
        for c in offsets
    ]
    found = evaluate_ensemble(plants, [log], LONGEST)
    assert found.keys() == {"y"}
    # RK4's error, 1.5e-9, beside offsets of a tenth
    assert found["y"]["rmse"] == pytest.approx(np.mean(offsets), rel=1e-7)
    assert found["y"]["spread"] == pytest.approx(np.std(offsets), rel=1e-7)
    assert found["y"]["r2"] == pytest.approx(1 - 0.01 / np.var(log.columns["y"]), rel=1e-6)


def test_ensemble_with_a_member_that_diverges():
    t = STEP * np.arange(60)
    log = run(t, x=3 * np.exp(-t))
    good = 'name = "d"\n[states.x]\nderivative = "-x"\n[outputs.x]\nvalue = "x"'
    plants = [plant(good), plant(good.replace('"-x"', '"1e3*x**3"'))]
    found = evaluate_ensemble(plants, [log], LONGEST)
    assert found["x"] == dict.fromkeys(("r2", "rmse", "nrmse", "spread"))


def test_divergence_says_when_and_in_which_state():
    """x' = x^3 from 1 ends at its pole, t = 1/2."""
    t = STEP * np.arange(60)
    log = run(t, x=np.ones(60))
    text = 'name = "d"\n[states.x]\nderivative = "x**3"\n[outputs.x]\nvalue = "x"'
    wild = plant(text)
    said = divergence(wild, predict(wild, [log], LONGEST))
    named = re.fullmatch(
        rf"the free run diverges: state 'x' .* t = (.+) s of run '{log.name}'", said
    )
    assert named is not None
    assert 0.5 <= float(named[1]) <= 0.5 + 2 * STEP  # the next sample, and a step over the pole
    calm = plant(text.replace("x**3", "-x"))
    assert divergence(calm, predict(calm, [log], LONGEST)) == "the free run diverges"


def test_dead_time_of_an_input():
    """The command of 0.1 s ago drives the plant: commanded early, the same truth."""
    t, u, x = truth((0.7, -1.3))
    early = np.append(u[5:], np.full(5, u[-1]))
    late = plant(OSCILLATOR.replace("[inputs.u]", "[inputs.u]\ndelay = 0.1"))
    (found,) = predict(late, [run(t, u=early, q=x[:, 0], v=x[:, 1], pos=x[:, 0])], LONGEST)
    assert found.t[0] == pytest.approx(0.1, abs=1e-12), "before, nobody knows what acted"
    np.testing.assert_allclose(found.predicted[:, 0], x[5:, 0], rtol=0, atol=1e-6)  # LONGEST's
    np.testing.assert_array_equal(found.u[:, 0], u[5:])
