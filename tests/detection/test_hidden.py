"""Calibration and estimates where a state is hidden, a parameter varies, or an input acts late."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.signal import cont2discrete

from faultgauge.detection.answer.estimation import ALONE, estimate
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.rows.judged import start_from_samples
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.rows.residual import residuals
from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from models import record_of

by_eso = partial(calibrate, observer="eso")

PLANT = """
name = "two tanks"
[states.upper]
derivative = "u - 0.5*upper"
initial = 9
[states.lower]
derivative = "0.5*upper - c*lower"
[inputs.u]
hold = "zero"
[outputs.level]
value = "lower"
[parameters]
c = { value = 0.8, min = 0, fixed = true }
[faults.leak]
enters = "state"
target = "lower"
[faults.clog]
enters = "state"
target = "upper"
[observer]
bandwidth = 1
"""
DT, COUNT, NOISE = 0.1, 1500, 1e-3
START = (2.0, 1.0)


def model(text=PLANT):
    grid = np.random.default_rng(9).uniform(0, 3, (50, 3))
    record = record_of(
        max_step=0.1,
        envelope_points=grid.tolist(),
        columns={"states": [["", 0], ["level", 0]], "outputs": ["level"]},
    )
    return Model(GrayBoxPlant.untrained(parse_plant(text, "tanks.toml")), record)


def log(seed, leak=0.0, c=0.8, noise=NOISE, early=0):
    """Exact under a zero-order hold; `leak` from the middle on; u commanded `early` samples."""
    A, B = np.array([[-0.5, 0.0], [0.5, -c]]), np.eye(2)
    Ad, Bd, *_ = cont2discrete((A, B, np.eye(2), np.zeros((2, 2))), DT)
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0, 2, COUNT // 25), 25)
    x = np.zeros((COUNT, 2))
    x[0] = START
    for k in range(COUNT - 1):
        x[k + 1] = Ad @ x[k] + Bd @ [u[k], leak if k >= COUNT // 2 else 0.0]
    level = x[:, 1] + noise * rng.standard_normal(COUNT)
    u = np.append(u[early:], np.full(early, u[-1]))
    return Run(f"run{seed}", "a.csv", DT * np.arange(COUNT), {"u": u, "level": level})


def rows(model, run):
    return prepared(model.plant.signals, run)


def test_hidden_state_starts_from_the_first_samples():
    start = start_from_samples(model(), rows(model(), log(0, noise=0.0)))
    assert start.samples == 50
    # RK4's error, (0.8 DT)^5 / 120 = 3e-8 per step, over 50 steps, seen through 5 s
    np.testing.assert_allclose(start.x, START, rtol=0, atol=1e-5)


def test_a_leak_beside_a_hidden_state():
    calibrated = by_eso(model(), [log(1), log(2)]).model
    (healthy, faulty), bank = estimate(calibrated, [log(3), log(4, leak=-0.3)])
    assert bank.refused == {}
    assert healthy.reason[49] != ALONE
    assert healthy.reason[50] == ALONE, "settled as soon as nothing of the future is used"
    width = healthy.half_width["leak"]
    late = slice(3 * COUNT // 4, COUNT)
    size = np.mean(faulty.f["leak"][late])
    assert size == pytest.approx(-0.3, abs=0.01)  # noise of the mean, far below
    assert abs(size + 0.3) < width


def test_what_the_observer_cannot_reach_is_refused():
    text = PLANT.replace("u - 0.5*upper", "0.5*feed - 0.5*upper").replace(
        "[states.upper]", '[states.feed]\nderivative = "u - feed"\n[states.upper]'
    )
    text = text[: text.index("[faults.leak]")]
    text += '[faults.pump]\nenters = "state"\ntarget = "feed"\n[observer]\nbandwidth = 1\n'
    far = model(text)
    far.record.columns.states.insert(0, ("", 0))
    far.record.envelope_points[:] = np.ones((5, 4)).tolist()
    for job in (by_eso, estimate):
        with pytest.raises(InputError, match="fault 'pump'") as refusal:
            job(far, [log(1)])
        assert str(refusal.value).count(". ") == 0


def test_a_varying_parameter_is_the_runs_own():
    varying = model(PLANT.replace("fixed = true", 'vary = "run"'))
    start = start_from_samples(varying, rows(varying, log(0, c=0.6, noise=0.0)))
    # the prior, a thousandth of an output's spread, pulls towards 0.8
    assert float(start.plant.parameters["c"]) == pytest.approx(0.6, rel=1e-3)
    assert float(varying.plant.parameters["c"]) == 0.8
    r = residuals(varying, log(0, c=0.6, noise=0.0), "free")["level"]
    assert np.isnan(r[:49]).all(), "what the start was found from is no residual"
    assert np.abs(r[49:]).max() < 1e-2 * np.std(log(0).columns["level"])
    run = [log(k, c=0.6) for k in (1, 2)]
    (judged,), _ = estimate(by_eso(varying, run).model, [log(3, c=0.6)])
    inside = np.abs(judged.f["leak"][judged.settled]) <= 2 * judged.half_width["leak"]
    assert inside.mean() > 0.99  # four standard deviations


def test_dead_time_on_every_path():
    """A command 0.5 s early and `delay = 0.5` are the same as neither."""
    late = model(PLANT.replace('"zero"', '"zero"\ndelay = 0.5'))
    plain = by_eso(model(), [log(1), log(2)])
    told = by_eso(late, [log(1, early=5), log(2, early=5)])
    widths = [f.model.calibration.channels["leak"].interval for f in (plain, told)]
    assert widths[1] == pytest.approx(widths[0], rel=0.1)  # five samples fewer
    (early,), _ = estimate(told.model, [log(3, early=5)])
    (usual,), _ = estimate(replace(told.model, plant=plain.model.plant), [log(3)])
    assert early.reason[:5] == ["not sampled"] * 5
    rows = slice(250, COUNT)  # both have forgotten their start: exp(-0.5 * 24 s) = 6e-6
    scale = np.std(usual.f["leak"][rows])
    np.testing.assert_allclose(early.f["leak"][rows], usual.f["leak"][rows], atol=1e-3 * scale)
    for reference in ("free", "observer"):
        r = residuals(told.model, log(3, early=5), reference)["level"]
        assert np.isnan(r[:5]).all()
        assert np.std(r[100:]) < 3 * NOISE
    assert told.model.calibration.data == sorted(log(k, early=5).content_hash for k in (1, 2)), (
        "of the logs as they are"
    )
