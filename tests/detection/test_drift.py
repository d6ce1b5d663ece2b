"""The drift test against SciPy's regression, chance, and plants whose drift is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, linregress

from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.calibration.drift import Drift, drifts, trend
from faultgauge.detection.decisions import Decision, decide, decide_runs
from faultgauge.detection.posterior.events import BankEvent
from faultgauge.detection.posterior.posterior import Posterior
from faultgauge.detection.rows.prepared import prepared
from faultgauge.reporting.words.drift import as_dicts, sentences
from faultgauge.telemetry import Run
from lags import PLANT, STEP, driven
from models import as_stated

LAG = f"""{PLANT}
[faults.leak]
enters = "state"
target = "x"
unit = "K/s"
[observer]
bandwidth = 0.5
"""
COUNT, SIGMA = 6000, 0.02


def red(seed, count=COUNT, memory=5.0):
    rng = np.random.default_rng(seed)
    fade = np.exp(-1 / memory)
    x = np.zeros(count)
    for k in range(1, count):
        x[k] = fade * x[k - 1] + rng.standard_normal()
    return x


def run_of(seed, drive=0.0, count=COUNT):
    """The lag, exact under the hold, with `drive` (per sample) on its derivative."""
    rng = np.random.default_rng([seed, 1])
    u = np.repeat(rng.uniform(0.5, 1.5, count // 20), 20)
    y = driven(u + drive, u[0] / 0.2) + SIGMA * rng.standard_normal(count)
    return Run(f"r{seed}", "lag.csv", STEP * np.arange(count), {"u": u, "x": y})


@pytest.fixture(scope="module")
def model():
    rng = np.random.default_rng(0)
    points = np.stack([rng.uniform(2, 8, 60), rng.uniform(0, 2, 60)], axis=1)
    return calibrate(as_stated(LAG, points), [run_of(90), run_of(91)]).model


def test_the_trend_is_that_of_a_regression_on_block_means():
    run = run_of(0)
    x = red(0) + 2.0 * run.t / run.t[-1]
    found = trend(run, x, np.ones(COUNT, bool), {})
    fit = linregress(run.t, x)
    assert found.change == pytest.approx(fit.slope * found.seconds, rel=0.1)  # means of blocks
    assert found.lo < 2.0 < found.hi


def test_where_nothing_drifts_chance_is_what_it_says():
    """Of 200 records of red noise one in 20 is below p = 0.05; three binomial sd allow 19."""
    run = run_of(0, count=2000)
    everything = np.ones(2000, bool)
    found = [trend(run, red(seed, 2000), everything, {}).p for seed in range(200)]
    assert sum(p < 0.05 for p in found) <= 19
    assert np.median(found) == pytest.approx(0.5, abs=0.15)


@pytest.mark.study
def test_a_sound_plant_does_not_drift(model):
    decisions, bank = decide_runs(model, [run_of(seed) for seed in range(3)])
    assert drifts(bank, decisions) == []


@pytest.mark.study
def test_what_grows_below_the_alarm_is_told_and_left_open(model):
    """A leak of either kind, fault or wear, that grows too slowly to be told from the model's own
    error: to three times its learned size."""
    grown = 3 * model.calibration.noise.size["x"]
    decisions, bank = decide_runs(model, [run_of(1, grown * np.linspace(0, 1, COUNT))])
    found = drifts(bank, decisions)
    for each in found:
        assert (each.channel, each.cause) == ("the model's error in x", "ambiguous")
    for line, plain in zip(sentences(found), as_dicts(found), strict=True):
        assert "cannot tell apart" in line
        assert "fit again" in line
        assert plain["sentence"] == line


def test_a_measured_quantity_that_explains_it_is_named():
    run = run_of(3)
    warm = np.linspace(0.0, 1.0, COUNT) + 0.2 * np.sin(run.t / 100)
    x = 30 * warm + red(4)
    found = trend(replace(run, columns=run.columns | {"warm": warm}), x, np.ones(COUNT, bool),
                  {"u": run.columns["u"], "warm": warm})  # fmt: skip
    assert found.follows == "warm"
    ramp = 30 * np.linspace(0.0, 1.0, COUNT) + red(4)
    without = trend(run, ramp, np.ones(COUNT, bool), {"u": run.columns["u"]})
    assert without.p < 1e-3
    assert without.follows is None


@pytest.mark.study
def test_a_drifting_parameter_is_told_from_a_fault():
    """The bank tracks `warm` beside the leak; it moves by eight times its prior spread of 10 %."""
    text = LAG.replace("u - 0.2*x", "u - 0.2*x + warm").replace(
        "[faults.leak]",
        '[parameters]\nwarm = { value = 0.1, vary = "slow", min = -1, max = 1 }\n[faults.leak]',
    )
    rng = np.random.default_rng(0)
    points = np.stack([rng.uniform(1, 9, 60), rng.uniform(0, 2, 60)], axis=1)
    walk = 0.1 + 0.04 * np.sin(2 * np.pi * np.arange(COUNT) / 4000)
    plain = as_stated(text, points)
    calibrated = calibrate(plain, [run_of(s, walk) for s in (80, 81)]).model
    run = run_of(7, 0.1 + 0.08 * np.linspace(0, 1, COUNT))
    decisions, bank = decide_runs(calibrated, [run])
    found = drifts(bank, decisions)
    told = [each for each in found if each.cause == "plant"]
    assert [each.channel for each in told] == ["warm"]
    assert told[0].change == pytest.approx(0.08, rel=0.25)
    assert "apart from any fault" in sentences(told)[0]


def dragged(run):
    """The bank of a lag whose drag differs from run to run by 0.002/s."""
    text = (
        LAG.replace("u - 0.2*x", "u - drag*x") + "[parameters]\ndrag = {value = 0.2, unit = '1/s'}"
    )
    points = np.random.default_rng(0).uniform([2, 0], [8, 2], (60, 2))
    levels = ([SIGMA], [1e-3], [], [1e-4], [100.0], [1e-3], [5.0], [0.002], [0.0])
    return build_fault_bank(as_stated(text, points), [run], Noise(*map(np.array, levels)))


@pytest.mark.study
def test_a_constant_is_known_as_well_as_is_said():
    """Of 24 runs with drags of their own the errors, in standard deviations that are said, have a
    sum of squares between the 0.1 % and the 99.9 % quantile of chi-squared."""
    bank, rng = dragged(run_of(0, count=200)), np.random.default_rng(1)
    errors = []
    for seed in range(24):
        drag = 0.2 + 0.002 * rng.standard_normal()
        run = run_of(seed, count=200)
        fade, x = np.exp(-drag * STEP), run.columns["u"][0] / drag
        for k, u in enumerate(run.columns["u"]):
            run.columns["x"][k] = x + SIGMA * rng.standard_normal()
            x = fade * x + (1 - fade) * u / drag
        said = decide(bank, run, None)
        (off,) = bank.plant.directions @ said.posterior.x[-1, bank.plant.parts.xi]
        assert 0 < said.loose[0] < 0.002
        errors.append((off + 0.2 - drag) / said.loose[0])
    low, high = chi2.ppf([0.001, 0.999], 24)
    assert low < np.sum(np.square(errors)) < high


def test_what_moves_and_what_stands_off_is_said_with_its_interval():
    moved = Drift("a", "warm", "K/s", "plant", False, 0.08, 0.0751, 0.0849, 600.0, 1e-5, None)
    stands = Drift("a", "warm", "", "ambiguous", True, 0.5, 0.4, 0.6, 600.0, 1e-5, None)
    first, second = sentences([moved, stands])
    assert first.startswith("run a: warm moved by +0.080 K/s (+0.075 to +0.085) over 600 s of ")
    assert second.startswith("run a: warm stands at +0.50 (+0.40 to +0.60) over 600 s of ")


def test_the_mean_of_a_trend_has_students_interval():
    """Blocks of ten correlation times, as SciPy has it for their mean."""
    run = run_of(0)
    x = 3.0 + red(2)
    found = trend(run, x, np.ones(COUNT, bool), {})
    assert found.mean - found.mean_half < 3.0 < found.mean + found.mean_half
    # 5 samples of memory; a sum of COUNT such values has the spread of as many times 1 / (1 - fade)
    sd = 1 / (1 - np.exp(-1 / 5.0)) / np.sqrt(COUNT)
    assert found.mean_half == pytest.approx(1.96 * sd, rel=0.4)  # some 60 blocks: 3 sd of their sd


def test_a_constant_that_took_something_up_is_told_where_no_fault_is():
    """A drag that ends 3.2 times as far off as healthy runs differ (1 %), behind it a row under
    alarm, which does not count."""
    run = run_of(0, count=40)
    bank = dragged(run)
    x = np.zeros((40, bank.plant.parts[-1].stop))
    x[:-1, -1] = 3.2
    empty = dict.fromkeys(Posterior._fields, np.zeros(40))
    found = Posterior(**empty | {"x": x})
    status, loose = ["HEALTHY"] * 39 + ["FAULT"], np.array([0.0005])
    rows = prepared(bank.model.plant.signals, run)
    said = Decision(run, found, {}, status, [""] * 40, [], rows, rows, loose=loose)
    (drag,) = drifts(bank, [said])
    assert (drag.channel, drag.cause) == ("drag", "constant")
    assert drag.change == pytest.approx(3.2 * 0.002, rel=1e-6)
    assert drag.p == pytest.approx(math.erfc(3.2 / math.sqrt(2)))  # both tails
    (line,) = sentences([drag])
    assert (drag.lo, drag.hi) == pytest.approx((0.00542, 0.00738), abs=1e-5)  # 1.96 sd
    assert line.startswith(
        "run r0: drag ends +0.0064 1/s (+0.0054 to +0.0074) off its usual value, further than"
    )
    event = BankEvent("r0", "leak", 1.0, 2.0, 1.0, 0.9, 1.1, 1.0, 0.5, 0.4, 0.6, ())
    assert drifts(bank, [replace(said, events=[event])]) == []


@pytest.mark.study
def test_samples_under_alarm_do_not_count(model):
    run = run_of(5)
    healthy = run.t < 1000
    x = red(6) + np.where(healthy, 0.0, 50.0)
    assert trend(run, x, healthy, {}).p > 1e-3
    assert trend(run, x, np.zeros(COUNT, bool), {}) is None
