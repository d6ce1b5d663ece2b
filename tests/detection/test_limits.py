"""Calibration and judgement against closed forms and arithmetic by hand."""

from functools import partial

import numpy as np
import pytest

from faultgauge.detection.blocks import Block, allowed_peaks, correlation_time, merged
from faultgauge.detection.calibration import _without_suspects, calibrate, score
from faultgauge.detection.estimation import Event, estimate, sentence
from faultgauge.detection.residual import residuals
from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model, tensors
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

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
    record = {
        "max_step": 1e9,
        "envelope_points": [[0.0, 0.0], [1.0, 0.5], [-1.0, -0.5]],
        "columns": {"states": [["x", 0]], "outputs": ["x"]},
        "data": {"fit": [], "validate": []},
    }
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


def test_a_block_far_above_the_others_is_named_and_left_out():
    blocks = [Block("r", float(k), k + 1.0, 1.0 + 0.01 * k) for k in range(10)]
    odd = Block("r", 10.0, 11.0, 50.0)
    keep, suspects = _without_suspects([*blocks, odd], [log(0)])
    assert keep == blocks
    assert suspects == [odd]


def test_the_score_is_the_largest_channel_in_its_own_units():
    channels = {"a": np.array([1.0, -4.0, np.nan]), "b": np.array([3.0, 0.0, np.nan])}
    np.testing.assert_array_equal(score(channels, {"a": 1.0, "b": 2.0}), [1.5, 4.0, np.nan])


def test_calibration_changes_nothing_but_the_calibration():
    before = model()
    found = by_eso(before, [log(1)])
    again = by_eso(before, [log(1)])
    assert found.model.calibration == again.model.calibration
    assert found.warnings == []
    for name, values in tensors(before.plant).items():
        np.testing.assert_array_equal(values, tensors(found.model.plant)[name])


def test_a_faulty_stretch_of_a_healthy_log_is_left_out():
    spoiled = log(1)
    x = spoiled.columns["x"].copy()
    x[1500:] += 0.5  # a jump that no healthy block has
    spoiled = Run("spoiled", "spoiled.csv", spoiled.t, {**spoiled.columns, "x": x})
    found = by_eso(model(), [spoiled])
    assert any(b.start <= 150.0 <= b.end + 1.0 for b in found.suspects)
    assert "spoiled" in found.warnings[0]


def test_too_short_a_log_is_refused():
    with pytest.raises(InputError, match=r"too short|at least 3 blocks"):
        by_eso(model(), [log(1, samples=60)])


def test_a_step_is_one_event_of_the_right_time_and_size():
    calibrated = by_eso(model(), [log(1), log(2)]).model
    (quiet, faulty), _ = estimate(calibrated, [log(3), log(4, fault=0.2)])
    assert quiet.events == []
    (event,) = faulty.events
    assert event.fault == "leak"
    assert 150.0 <= event.start <= 152.0  # onset at 150 s, bandwidth 1 rad/s
    assert event.lo <= 0.2 <= event.hi
    assert event.end == pytest.approx(faulty.run.t[-1])


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
    assert judged.status[1001 + 51] == "HEALTHY"
    assert judged.status[999] == "HEALTHY"


def test_uncalibrated_nothing_is_judged():
    (judged,), _ = estimate(model(), [log(3, fault=1.0)])
    assert set(judged.status) == {"NOT_JUDGED"}
    assert judged.events == []


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


def test_the_sentence_gives_as_many_digits_as_the_interval_allows():
    event = Event("flight", "leak", 10.0, 20.0, 0.123456, 0.113456, 0.133456)
    assert sentence(event, "m/s") == "leak +0.123 +- 0.01 m/s from 10 s to 20 s (run flight)"


def test_a_passive_fault_is_reported_without_an_alarm_and_a_disabled_one_is_not_estimated():
    def judged(state):
        text = PLANT.replace('unit = "m/s"', f'unit = "m/s"\nmonitor = "{state}"')
        plant = GrayBoxPlant.untrained(parse_plant(text))
        found = by_eso(Model(plant, model().record), [log(1)]).model
        (judgement,), bank = estimate(found, [log(2, fault=0.05)])
        return judgement, bank

    loud, _ = judged("active")
    assert loud.status[-1] == "FAULT"
    passive, _ = judged("passive")
    assert "FAULT" not in passive.status
    assert (passive.status[-1], passive.reason[-1]) == ("NOT_JUDGED", "leak, which is passive")
    assert passive.events == []
    assert passive.f["leak"][-1] == loud.f["leak"][-1]
    _, bank = judged("disabled")
    assert list(bank.designs) == []


def test_suspect_blocks_that_follow_on_each_other_are_one_stretch():
    blocks = [Block("b", 0.0, 1.0, 9.0), Block("a", 2.0, 3.0, 7.0), Block("a", 1.0, 2.0, 8.0)]
    assert merged([*blocks, Block("a", 5.0, 6.0, 1.0)]) == [
        Block("a", 1.0, 3.0, 8.0), Block("a", 5.0, 6.0, 1.0), Block("b", 0.0, 1.0, 9.0),
    ]  # fmt: skip


def test_a_fault_in_one_run_does_not_lengthen_the_blocks():
    """Correlation time of the usual stretch: with a third run that leaks, the blocks are as long
    as without it."""
    clean = by_eso(model(), [log(1), log(2)]).model.calibration
    found = by_eso(model(), [log(1), log(2), log(3, fault=0.6)])
    assert found.model.calibration["block_s"] == pytest.approx(clean["block_s"], rel=0.3)
    assert found.suspects
    assert {block.run for block in found.suspects} == {"run3"}
