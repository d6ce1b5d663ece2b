"""Calibration and judgement against closed forms and arithmetic by hand."""

from functools import partial

import numpy as np
import pytest

from faultgauge.detection.answer.estimation import ALONE, estimate, table
from faultgauge.detection.calibration.blocks import Block, allowed_peaks, correlation_time, merged
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.rows.residual import residuals
from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model, tensors
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from models import record_of

by_eso = partial(calibrate, observer="eso")

PLANT = """
name = "integrator"
[states.x]
derivative = "u"
[inputs.u]
[outputs.x]
value = "x"
[faults.leak]
enters = "state"
target = "x"
unit = "m/s"
[observer]
bandwidth = 1
"""
DT = 0.1


def model():
    record = record_of(
        max_step=1e9,
        envelope_points=[[0.0, 0.0], [1.0, 0.5], [-1.0, -0.5]],
        columns={"states": [["x", 0]], "outputs": ["x"]},
    )
    return Model(GrayBoxPlant.untrained(parse_plant(PLANT)), record)


def log(seed, fault=0.0, samples=3000):
    """x' = u + f under a held u, exact; white measurement noise of 1e-3."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, samples // 20), 20)
    f = np.where(np.arange(samples) >= samples // 2, fault, 0.0)
    x = np.concatenate([[0.0], np.cumsum(DT * (u + f))[:-1]])
    columns = {"u": u, "x": x + 1e-3 * rng.standard_normal(samples)}
    return Run(f"run{seed}", f"run{seed}.csv", DT * np.arange(samples), columns)


def test_correlation_time_of_an_autoregressive_process():
    """tau = (1 + rho) / (1 - rho) for x+ = rho x + noise."""
    rng, rho = np.random.default_rng(0), 0.8
    x = np.zeros(200_000)
    noise = rng.standard_normal(len(x))
    for k in range(1, len(x)):
        x[k] = rho * x[k - 1] + noise[k]
    # the estimate's scatter: about sqrt(2 lags / samples), 40 lags: 2 %; four of those
    assert correlation_time(x, 1.0) == pytest.approx((1 + rho) / (1 - rho), rel=0.08)


def test_no_alarm_in_t_seconds_proves_a_rate_below_3_over_t():
    allowed, mtbfa = allowed_peaks(300.0, None, 50)
    assert allowed == 0
    assert mtbfa == pytest.approx(300.0 / -np.log(0.05))  # the rule of three, exactly
    with pytest.raises(InputError, match="support at most"):
        allowed_peaks(300.0, 101.0, 50)
    # one alarm in T: the 95 % bound on the mean count is 4.744 (Poisson table)
    assert allowed_peaks(300.0, 300.0 / 4.75, 50)[0] == 1
    assert allowed_peaks(300.0, 300.0 / 4.73, 50)[0] == 0


def test_calibration_changes_nothing_but_the_calibration():
    before = model()
    found = by_eso(before, [log(1)])
    again = by_eso(before, [log(1)])
    assert found.model.calibration == again.model.calibration
    assert found.warnings == []
    for name, values in tensors(before.plant).items():
        np.testing.assert_array_equal(values, tensors(found.model.plant)[name])


def test_too_short_a_log_is_refused():
    with pytest.raises(InputError, match="10 healthy samples after settling are too few"):
        by_eso(model(), [log(1, samples=60)])


def test_an_observer_alone_has_no_rate_of_false_alarms():
    with pytest.raises(InputError, match="--mtbfa is about alarms"):
        by_eso(model(), [log(1)], mtbfa=10.0)


def test_a_step_is_estimated_within_an_interval_and_nothing_is_decided():
    calibrated = by_eso(model(), [log(1), log(2)]).model
    (quiet, faulty), _ = estimate(calibrated, [log(3), log(4, fault=0.2)])
    width = quiet.half_width["leak"]
    f = quiet.f["leak"][quiet.settled]
    # 95 % of what was calibrated, by another log of as many independent values: some 300
    assert 0.9 < np.mean(np.abs(f) <= width) <= 1.0
    late = faulty.run.t > 160.0  # onset at 150 s, bandwidth 1 rad/s
    assert np.mean(np.abs(faulty.f["leak"][late] - 0.2) <= width) > 0.9
    rows = table([faulty], ("leak",))
    assert set(rows["status"]) == {"NOT_JUDGED"}
    assert rows["reason"][-1] == ALONE
    assert rows["p_leak"][-1] is None
    assert rows["f_leak_hi"][-1] - rows["f_leak"][-1] == pytest.approx(width)


def test_a_gap_and_an_empty_cell_are_not_judged():
    run = log(5)
    x = run.columns["x"].copy()
    x[1000] = np.nan
    t = run.t.copy()
    t[2000:] += 30.0
    calibrated = by_eso(model(), [log(1)]).model
    (judged,), _ = estimate(calibrated, [Run("r", "r.csv", t, {**run.columns, "x": x})])
    assert judged.reason[1000] == "not sampled"
    settling = "settling after a start or a gap"
    assert judged.reason[1001] == judged.reason[2000] == settling
    # 5 / bandwidth = 5 s of hold-off
    assert judged.reason[1001 + 51] == judged.reason[999] == ALONE


def test_uncalibrated_there_is_an_estimate_without_an_interval():
    (judged,), _ = estimate(model(), [log(3, fault=0.2)])
    rows = table([judged], ("leak",))
    assert rows["f_leak"][-1] == pytest.approx(0.2, abs=0.02)  # four sd of the healthy estimate
    assert rows["f_leak_lo"][-1] is None


def test_the_three_references_on_an_integrator():
    """Free: the noise plus the integrated fault; measured: one step; observer: f / (wT)-like."""
    fault = 0.2
    run = log(6, fault=fault)
    free = residuals(model(), run, "free")["x"]
    measured = residuals(model(), run, "measured")["x"]
    observer = residuals(model(), run, "observer")["x"]
    since = run.t[-1] - run.t[1500]
    # noise 1e-3 at either end: 5e-3 is five standard deviations
    assert free[-1] == pytest.approx(fault * since, abs=5e-3)
    assert np.mean(measured[1600:]) == pytest.approx(fault * DT, abs=2e-4)
    # steady innovation of x- = x + T u, gain 1 - exp(-w T): f T / gain
    assert np.mean(observer[2000:]) == pytest.approx(fault * DT / (1 - np.exp(-DT)), abs=1e-3)


def test_a_disabled_fault_is_not_estimated():
    text = PLANT.replace('unit = "m/s"', 'unit = "m/s"\nmonitor = "disabled"')
    plant = GrayBoxPlant.untrained(parse_plant(text))
    with pytest.raises(InputError, match=r"disables all its \[faults\]"):
        by_eso(Model(plant, model().record), [log(1)])
    _, bank = estimate(Model(plant, model().record), [log(1)])
    assert list(bank.designs) == []


def test_suspect_blocks_that_follow_on_each_other_are_one_stretch():
    blocks = [Block("b", 0.0, 1.0, 9.0), Block("a", 2.0, 3.0, 7.0), Block("a", 1.0, 2.0, 8.0)]
    assert merged([*blocks, Block("a", 5.0, 6.0, 1.0)]) == [
        Block("a", 1.0, 3.0, 8.0), Block("a", 5.0, 6.0, 1.0), Block("b", 0.0, 1.0, 9.0),
    ]  # fmt: skip
