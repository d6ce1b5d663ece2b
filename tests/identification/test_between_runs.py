"""What differs between runs, and a run's own values found with it: against formulas by hand."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.stats import norm

import faultgauge as fg
from faultgauge.detection.rows.prepared import as_it_acts
from faultgauge.detection.rows.residual import Residuals, residuals
from faultgauge.identification.between_runs import between_runs
from faultgauge.identification.fit import fit
from faultgauge.identification.samples import Samples
from faultgauge.identification.unseen import on_unseen, run_anew
from faultgauge.identification.validation.evaluation import evaluate, start_of_run
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model, load_model, save_model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.record import BetweenRuns
from faultgauge.telemetry import Run, cut
from models import record_of

RAMP = """
name = "ramp"
[states.x]
derivative = "c"
[outputs.x]
value = "x"
[parameters]
c = { value = 2.0, vary = "run" }
"""
STEP, COUNT = 0.1, 51
T = STEP * np.arange(COUNT)


def plant(text):
    return GrayBoxPlant.untrained(parse_plant(text, "plant.toml"))


def left(usual, values):
    """The median of the standard deviation by adaptive quadrature: chi^2 of the runs times a
    normal distribution of its logarithm around the usual one, a factor of ten wide."""
    squares, free = np.sum((np.array(values) - np.mean(values)) ** 2), len(values) - 1

    def density(x):
        return np.exp(-free * x - squares / 2 * np.exp(-2 * x)) * norm.pdf(
            x, np.log(usual), np.log(10)
        )

    low, high = np.log(usual) - 20, np.log(usual) + 20
    total = quad(density, low, high, limit=500)[0]
    return np.exp(brentq(lambda x: quad(density, low, x, limit=500)[0] / total - 0.5, low, high))


@pytest.mark.parametrize(
    ("declared", "values", "expected"),
    [
        ("value = 20.0", [18.0, 24.0], left(2.0, [18.0, 24.0])),
        ("value = 20.0", [21.0], 2.0),  # one run: 10 % of the file's value
        # logarithms, whatever the value
        ("value = 7.0, min = 0", [1.0, np.exp(2.0), 2.0], left(0.1, [0.0, 2.0, np.log(2.0)])),
        # four runs that lie far nearer tell it; they are not taken to be alike to the last digit
        ("value = 96.0", [95.8, 95.9, 96.6, 96.4], left(9.6, [95.8, 95.9, 96.6, 96.4])),
        ("value = 20.0", [21.0, 21.0], 2.0 * 10 ** -np.log(10.0)),
        # a file that says 0 gives no scale: the runs alone, and nothing of one (+- 1, as in a fit)
        ("value = 0.0", [-1.0, 1.0], sqrt(2)),
        ("value = 0.0", [0.5], 1.0),
    ],
)
def test_how_far_runs_lie_apart(declared, values, expected):
    own = plant(RAMP.replace("value = 2.0", declared))
    nothing, y = np.zeros((2, 0)), np.array([[1.0], [5.0]])
    training = Samples(nothing, nothing, nothing, y)
    per_run = {"c": dict(zip("abcd", values, strict=False))}
    found = between_runs(own, training, 0.25, 3.0, per_run)
    assert found.apart["c"] == pytest.approx(expected, rel=1e-3)
    assert (found.off, found.lasting) == ({"x": 0.5}, 3.0)  # 1 and 5 spread by 2
    assert between_runs(own, training, 0.0, 3.0, per_run).off == {"x": 2e-3}  # a floor of 1e-3


@pytest.mark.parametrize("rows", [1, 3])
@pytest.mark.parametrize(
    ("lasting", "independent"),
    [(100.0, 1.0), (2.0, 2.5), (1e-3, None)],  # longer than the 5 s, shorter, than a sample
)
def test_what_the_plant_lacks_counts_for_as_long_as_it_lasts(rows, lasting, independent):
    """x = c t is linear in c: (p0 w + n mean(t y) / off^2) / (w + n mean(t^2) / off^2) with
    w = 1 / apart^2, over the samples that there are."""
    off, apart, sampled = 0.3, 0.2, np.arange(COUNT) % rows == 0
    y = 3.0 * T + 0.1 * np.sin(7 * T)
    between = BetweenRuns(apart={"c": apart}, off={"x": off}, lasting=lasting)
    cells = np.where(sampled, y, np.nan)[:, None]
    inputs = np.zeros((COUNT, 0))
    found, _ = start_of_run(plant(RAMP), T, inputs, cells, {"x": 0.0}, 1.0, between)
    t, n = T[sampled], independent or np.sum(sampled)
    told = n / off**2
    c = (2.0 / apart**2 + told * np.mean(t * y[sampled])) / (1 / apart**2 + told * np.mean(t**2))
    # Levenberg-Marquardt ends at a relative 1e-8 of a linear problem
    assert float(found.values()["c"]) == pytest.approx(c, rel=1e-6)


HEATER = """
name = "heater"
[states.T]
unit = "degC"
derivative = "0.2*u - 0.002*(T - room)"
[inputs.u]
hold = "zero"
[outputs.T]
unit = "degC"
value = "T"
[parameters]
room = { value = 20, unit = "degC", vary = "slow" }
"""
LAG, ROOM, LENGTH = 20.0, 22.0, 3000  # s, degC, samples of 1 s


def cold_start():
    """The heater behind a lag that the model lacks, exact for a step of u at 0: beside the model's
    own T it is late by 0.2 u lag / (1 - 0.002 lag) (exp(-0.002 t) - exp(-t / lag))."""
    t = np.arange(LENGTH, dtype=float)
    without = ROOM + 100 * 0.2 * (1 - np.exp(-0.002 * t)) / 0.002 / 100
    late = 0.2 * LAG / (1 - 0.002 * LAG) * (np.exp(-0.002 * t) - np.exp(-t / LAG))
    return Run("cold", "cold.csv", t, {"u": np.ones(LENGTH), "T": without - late})


def heater(between):
    record = record_of(
        max_step=1.0, columns={"states": [["T", 0]], "outputs": ["T"]}, between=between
    )
    return Model(plant(HEATER), record)


BETWEEN = {"apart": {"room": 2.0}, "off": {"T": 2.0}, "lasting": 200.0}


def test_a_lag_at_a_cold_start_does_not_go_into_what_varies():
    """Over 49 s the room moves T by 1 - exp(-0.002 t), up to 0.1 K/K: 4 K that are late there are
    dozens of degrees of the room, which the runs that were fitted have not seen."""
    run, model = cold_start(), heater(BETWEEN)
    odd, (alone,) = evaluate(model.plant, [run], model.max_step)
    found, (told,) = evaluate(model.plant, [run], model.max_step, between=model.record.between)
    assert alone.warmup == told.warmup == 50
    assert odd["outputs"]["T"]["rmse"] > 30
    # the room is 22, a standard deviation from 20; what the lag adds is less than another one, and
    # late T is 2 K on the average of an hour at most
    assert found["outputs"]["T"]["rmse"] < 2 * 2.0 + 2.0


def test_all_free_runs_have_one_rule(tmp_path):
    """`evaluate`, on the file as in Python, and the residual columns: the same free run."""
    run, model = cold_start(), heater(BETWEEN)
    _, (told,) = evaluate(model.plant, [run], model.max_step, between=model.record.between)
    r = residuals(model, run, "free")["T"]
    # two programs over the same numbers
    np.testing.assert_allclose(r[50:], (told.measured - told.predicted)[50:, 0], atol=1e-9)
    path = tmp_path / "heater.fgm"
    save_model(model, path)
    (by_verb,) = fg.evaluate(path, run).predictions
    np.testing.assert_array_equal(by_verb.predicted, told.predicted)
    ensemble = load_model(path).with_members([model.plant])
    both = fg.evaluate(ensemble, run).scores
    assert both["ensemble"]["T"]["rmse"] == pytest.approx(both["outputs"]["T"]["rmse"], rel=1e-9)


def test_a_stream_waits_for_as_many_samples_as_a_file_does():
    run, model = cut(cold_start(), slice(0, 120)), heater(BETWEEN)
    whole = residuals(model, run, "free")["T"]
    assert np.isnan(whole[:49]).all()
    assert np.isfinite(whole[49:]).all()
    stream = Residuals(model, run, "free")
    rows = as_it_acts(model.plant.signals, run)
    parts = [stream.push(rows.cut(slice(k, k + 6)))["T"] for k in range(0, 120, 6)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_an_older_model_goes_on_as_it_did():
    run = cold_start()
    (before,) = fg.evaluate(heater(None), run).predictions
    _, (alone,) = evaluate(heater(None).plant, [run], 1.0)
    np.testing.assert_array_equal(before.predicted, alone.predicted)


@pytest.fixture(scope="module")
def fitted():
    """Three rooms, and white noise of 0.05 K: exact under the hold."""
    logs = []
    for seed, room in enumerate((18.0, 20.0, 25.0)):
        rng = np.random.default_rng(seed)
        u, temperature = np.repeat(rng.uniform(0, 1, 10), 60), np.full(600, room)
        for k in range(599):
            rest = room + 100 * u[k]
            temperature[k + 1] = rest + np.exp(-0.002) * (temperature[k] - rest)
        noisy = temperature + 0.05 * rng.standard_normal(600)
        logs.append(Run(f"room{seed}", "a.csv", np.arange(600.0), {"u": u, "T": noisy}))
    text = HEATER.replace('"slow"', '"run"').replace("0.2*u", "g*u")
    text += 'g = { value = 0.3, min = 0, unit = "K/s" }\n'
    return logs, *fit(plant(text), logs, restarts=2)


def test_a_fit_tells_it(fitted):
    _, model, account = fitted
    own = np.array([*account.refinement.per_run["room"].values()])
    np.testing.assert_allclose(own, (18, 20, 25), atol=0.5)  # what 600 noisy samples leave, by far
    assert model.record.between.apart == {"room": pytest.approx(left(2.0, own), rel=1e-3)}
    off = account.refinement.error * np.std(account.training.y[:, 0])
    assert model.record.between.off == {"T": pytest.approx(off)}
    lasting = account.refinement.information.residual_time * 1.0
    assert model.record.between.lasting == pytest.approx(lasting)


def test_validation_goes_by_it(fitted):
    """With runs that lie next to nowhere apart, held-out free runs have the common room."""
    logs, model, account = fitted
    glued = {"apart": {"room": 1e-6}, "off": {"T": 1.0}, "lasting": 1.0}
    record = model.record.but(between=BetweenRuns.model_validate(glued))
    common = replace(model, record=record)
    near = on_unseen(model, account, [], logs[:1]).scores["outputs"]["T"]["rmse"]
    far = on_unseen(common, account, [], logs[:1]).scores["outputs"]["T"]["rmse"]
    # The common room is 3 K too warm, of which 1 - exp(-0.002 t) shows: 1.3 K r.m.s. over 600 s. By
    # the first 50 s the noise of T(0), 0.05 K over a mean of 0.05 K/K, leaves one degree of them.
    assert near < 0.6 < 1.0 < far
    assert run_anew(model, account, logs, 1.0).error < run_anew(common, account, logs, 1.0).error
