"""Held-out data are data that no stage has fitted."""

import numpy as np
import pytest

from faultgauge.identification.fit import fit
from faultgauge.identification.unseen import held_out, on_unseen
from faultgauge.identification.validation.evaluation import evaluate
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run, cut

PLANT = """
name = "first order"
[states.x]
derivative = "b*u - a*x"
[inputs.u]
hold = "zero"
[outputs.x]
value = "x"
[parameters]
a = { value = 1.0, min = 0 }
b = { value = 1.0 }
"""
HIDDEN = PLANT.replace('outputs.x]\nvalue = "x"', 'outputs.y]\nvalue = "2*x"')
STEP, COUNT = 0.05, 600


def plant(text=PLANT):
    return GrayBoxPlant.untrained(parse_plant(text, "plant.toml"))


def log(seed=0, a=0.8, b=2.5):
    """x' = b u - a x under a zero-order hold, sampled: closed form; noise of 0.01."""
    rng = np.random.default_rng(seed)
    u, x, decay = np.repeat(rng.uniform(-2, 2, COUNT // 20), 20), np.zeros(COUNT), np.exp(-a * STEP)
    for k in range(COUNT - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / a * b * u[k]
    x += 0.01 * rng.standard_normal(COUNT)
    return Run(f"run{seed}", "a.csv", STEP * np.arange(COUNT), {"u": u, "x": x})


def hidden_log():
    columns = {"u": log().columns["u"], "y": 2 * log().columns["x"]}
    return Run("hidden", "a.csv", log().t, columns)


@pytest.fixture(scope="module")
def fitted():
    return fit(plant(), [log()], restarts=2)


def test_the_last_share_of_a_run(fitted):
    (tail,) = held_out(*fitted, [log()])
    np.testing.assert_array_equal(tail.t, log().t[510:])  # 85 % of 600
    points = fitted[1].training.u[:, 0]
    assert not np.isin(points, tail.columns["u"][20:]).any(), "every stair has its own height"


def test_every_stretch_has_its_own(fitted):
    whole = log()
    x = whole.columns["x"].copy()
    x[200] = np.nan
    run = Run("a", "a.csv", whole.t, {"u": whole.columns["u"], "x": x})
    first, second = held_out(*fitted, [run])
    np.testing.assert_array_equal(first.t, whole.t[170:200])  # 85 % of 200
    # 85 % of 399 is 339.15
    np.testing.assert_array_equal(second.t, whole.t[201 + 340 :])


@pytest.mark.study
def test_commands_that_act_from_its_start_on_come_along(fitted):
    late, _ = fit(plant(PLANT.replace('zero"', 'zero"\ndelay = 0.5')), [log()], restarts=2)
    (tail,) = held_out(late, fitted[1], [log()])
    # the log acts from 0.5 s on: the last 15 % of its 590 samples, and ten before
    np.testing.assert_array_equal(tail.t, log().t[600 - 88 - 10 :])


def test_scores_and_tests_are_of_the_tail(fitted):
    unseen = on_unseen(*fitted, [log()])
    assert unseen.scores["runs"][0]["samples"] == 90
    (output,) = unseen.validation.outputs
    assert output.samples == 90
    # the noise is 0.01, the start's noise and two fitted constants add to it
    assert 0.007 < output.rmse < 0.015


def test_runs_given_for_validation_are_taken_whole(fitted):
    unseen = on_unseen(*fitted, [log()], [log(1), log(2)])
    assert [run["samples"] for run in unseen.scores["runs"]] == [COUNT, COUNT]


def test_a_hidden_start_is_found_before_the_tail():
    """The whole tail is scored: 45 samples of 300, which a warm-up inside it would use up."""
    whole = hidden = cut(hidden_log(), slice(0, 300))
    model, account = fit(plant(HIDDEN), [hidden], restarts=2)
    (tail,) = held_out(model, account, [hidden])
    np.testing.assert_array_equal(tail.t, whole.t[255 - 50 :])
    unseen = on_unseen(model, account, [hidden])
    assert unseen.predictions[0].t[50] == whole.t[255]
    (output,) = unseen.validation.outputs
    assert output.samples == unseen.scores["runs"][0]["samples"] == 45
    # noise of 0.02 and two fitted constants; the sd of a sd of 45 is 11 %
    assert 0.012 < output.rmse < 0.03


@pytest.mark.study
def test_a_lead_in_does_not_reach_beyond_its_stretch(fitted):
    """What is there of a lead-in is taken; the warm-up's other samples are the tail's own."""
    late, _ = fit(plant(HIDDEN), [hidden_log()], restarts=2)
    account = fitted[1]._replace(groups=[], refinement=object())
    whole = hidden_log()
    whole.columns["u"][40] = np.nan
    first, second = held_out(late, account, [whole])
    np.testing.assert_array_equal(first.t, whole.t[:40])  # 85 % of 40 is 34, less than 50
    np.testing.assert_array_equal(second.t, whole.t[41 + 476 - 50 :])  # 85 % of 559 is 475.15


def test_a_model_fitted_to_the_tail_too_is_scored_as_it_was_before():
    hidden = hidden_log()
    model, account = fit(plant(HIDDEN), [hidden], restarts=2)
    judged = account.refinement.judged
    (tail,) = held_out(model, account, [hidden])
    assert np.isin(tail.columns["u"], account.training.u).all()
    # 50 samples of warm-up come before; every stair of 20 has its own height
    assert not np.isin(tail.columns["u"][50 + 20 :], judged.training.u).any()
    unseen, (before,) = on_unseen(model, account, [hidden]), judged.plants
    for name, plants in {"before": before, "after": model.plant}.items():
        scores, _ = evaluate(plants, [tail], model.max_step)
        assert (scores == unseen.scores) == (name == "before")


def test_nothing_to_run_through(fitted):
    whole = log()
    x = np.where(np.arange(COUNT) % 2, np.nan, whole.columns["x"])
    bare = Run("a", "a.csv", whole.t, {"u": whole.columns["u"], "x": x})
    assert on_unseen(*fitted, [bare]) is None


NETWORK = (
    PLANT.replace("b*u - a*x", "NN(u) - a*x").replace("b = { value = 1.0 }", "")
    + "[networks.NN]\nhidden = 3\n"
)


@pytest.mark.study
@pytest.mark.parametrize("refine", [False, True])
def test_other_seeds_tell_how_much_is_luck(refine):
    """RMSE of the model of every seed, from its own score on the same tail."""
    fits = [fit(plant(NETWORK), [log()], seed=k, restarts=2, refine=refine) for k in range(3)]
    found = on_unseen(*fits[0], [log()], others=fits[1:]).validation.outputs[0].seeds
    alone = [on_unseen(*each, [log()]).validation.outputs[0] for each in fits]
    np.testing.assert_allclose(found.rmse, [each.rmse for each in alone], rtol=1e-9)
    assert len(set(np.round(found.rmse, 9))) > 1
    assert found.spread > 0
    assert all(each.seeds is None for each in alone)
