"""A sensor at a tenth of the log's rate: what was filled in between its samples counts nowhere."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from calibrations import for_observer
from faultgauge.detection.answer.estimation import estimate
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.decisions import Decision, decide_runs
from faultgauge.detection.onset.retrospective import retrospect
from faultgauge.detection.rows.intake import Intake, slow_outputs, with_taken
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.rows.residual import residuals
from faultgauge.detection.stream import Stream
from faultgauge.errors import InputError
from faultgauge.telemetry import Run, cut, read_telemetry
from faultgauge.telemetry.rates import align
from faultgauge.telemetry.stream import Sample
from faultgauge.telemetry.writing import as_table, write_table
from models import as_stated

pytestmark = [pytest.mark.usefixtures("quick_code"), pytest.mark.study]

HEATER = """
name = "heater"
[states.x]
derivative = "u - 0.5*x"
[states.z]
derivative = "0.2*x - 0.1*z"
[inputs.u]
hold = "zero"
[outputs.x]
value = "x"
[outputs.z]
value = "z"
[faults.loss]
enters = "state"
target = "z"
"""
STEP, EVERY, COUNT, ONSET = 0.1, 10, 3000, 1500
SIGMA = {"x": 0.02, "z": 0.05}
LOSS = -0.1


def model(text=HEATER):
    points = np.random.default_rng(0).uniform([-4, -6, -2], [4, 6, 2], (80, 3))
    return as_stated(text, points, [("x", 0), ("z", 0)], ["x", "z"])


def cells(seed, loss=0.0, every=EVERY):
    """t and columns, z empty between its samples; exact under the hold, `loss` from ONSET on."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, COUNT // 50), 50)
    A = np.array([[-0.5, 0.0], [0.2, -0.1]])
    fade = expm(A * STEP)
    states = np.zeros((COUNT, 2))
    for k in range(COUNT - 1):
        rest = -np.linalg.solve(A, [u[k], loss * (k >= ONSET)])
        states[k + 1] = rest + fade @ (states[k] - rest)
    x, z = (states + rng.standard_normal(states.shape) * list(SIGMA.values())).T
    z[np.arange(COUNT) % every > 0] = np.nan
    return STEP * np.arange(COUNT), {"u": u, "x": x, "z": z}


def log(seed, loss=0.0, every=EVERY):
    t, columns = cells(seed, loss, every)
    found = align(t, columns, held={"u"})
    return Run(f"run{seed}", "heater.csv", t, found.columns, sampled=found.sampled)


def spoiled(run):
    """`run` with nonsense for what was filled in between samples."""
    filled = ~run.sampled["z"] & np.isfinite(run.columns["z"])
    return replace(run, columns=run.columns | {"z": np.where(filled, 1e3, run.columns["z"])})


@pytest.fixture(scope="module")
def progress():
    """What is said while it is calibrated."""
    return []


@pytest.fixture(scope="module")
def calibration(progress):
    return calibrate(model(), [log(seed) for seed in (0, 1, 2)], progress=progress.append)


def test_calibrate_says_how_far_it_is_with_every_step_of_its_search(calibration, progress):
    shares = [each.share for each in progress]
    assert list(dict.fromkeys(progress)) == [
        "finding noise and model error",
        "finding the alarm level",
    ]
    assert shares == sorted(shares)
    assert shares[0] == 0 < shares[-1] < 1
    assert len(shares) > 10


def test_noise_is_that_of_the_samples(calibration):
    """n samples tell a standard deviation to 1 / sqrt(2 n): three of that. The 4 stretches of 2048
    rows that are looked at are 3 here, 614 samples of z: 8.6 %."""
    found = calibration.model.calibration.noise.sigma
    for name, samples in {"x": 3 * 2048, "z": 3 * 2048 / EVERY}.items():
        assert found[name] == pytest.approx(SIGMA[name], rel=3 / np.sqrt(2 * samples))


@pytest.fixture(scope="module")
def limited():
    """With intervals of an observer."""
    return calibrate(model(), [log(seed) for seed in (0, 1, 2)], observer="eso").model


def test_the_bandwidth_is_that_of_the_sensors_own_step(limited):
    assert limited.calibration.bandwidth == pytest.approx(0.1 / (EVERY * STEP))


def test_a_fault_that_only_the_slow_sensor_shows_is_inside_its_interval(calibration):
    decisions, bank = decide_runs(calibration.model, [log(10, LOSS), log(11)])
    (event,) = decisions[0].events
    assert event.fault == "loss"
    assert event.lo <= LOSS <= event.hi
    assert event.onset_lo <= ONSET * STEP <= event.onset_hi
    assert "FAULT" not in decisions[1].status
    (late,) = [each for each in retrospect(bank, decisions[0]) if each.cause == "loss"]
    assert late.lo <= LOSS <= late.hi
    assert late.onset_lo <= ONSET * STEP <= late.onset_hi


def test_the_observer_corrects_at_samples_and_is_stable(limited):
    (found,), bank = estimate(limited, [log(10, LOSS)])
    f, width = found.f["loss"], found.half_width["loss"]
    assert abs(np.nanmean(f[-COUNT // 4 :]) - LOSS) <= width
    moved = np.flatnonzero(np.diff(f[np.isfinite(f)]) != 0) + 1  # from the first row on
    assert set(moved % EVERY) == {0}
    assert bank.designs["loss"].radius < 1


def test_intervals_of_a_healthy_log_hold_zero_as_often_as_they_say(calibration):
    """The truth is 0: 95 % intervals hold it in 95 % of the judged samples, and model error makes
    them wider. 300 s are some 10 independent estimates, 2 of which may miss by chance (p 0.01)."""
    (decision,), _ = decide_runs(calibration.model, [log(12)])
    judged = np.array(decision.status) == "HEALTHY"
    found = decision.posterior
    assert judged.mean() > 0.5
    inside = (found.lo[judged, 0] <= 0) & (found.hi[judged, 0] >= 0)
    assert inside.mean() >= 0.8


@pytest.mark.parametrize("observer", ["eso", "bank"])
def test_what_is_filled_in_changes_nothing(calibration, observer):
    known, run = calibration.model, log(10, LOSS)
    if observer == "bank":
        (plain,), (odd,) = (decide_runs(known, [each])[0] for each in (run, spoiled(run)))
        np.testing.assert_array_equal(plain.posterior.f, odd.posterior.f)
        np.testing.assert_array_equal(plain.posterior.lo, odd.posterior.lo)
        assert plain.status == odd.status
        assert plain.events == odd.events
    else:
        (plain,), (odd,) = (estimate(known, [each])[0] for each in (run, spoiled(run)))
        np.testing.assert_array_equal(plain.f["loss"], odd.f["loss"])


@pytest.mark.parametrize("reference", ["free", "measured", "observer"])
def test_residuals_are_those_of_samples(calibration, reference):
    run = log(10)
    r = residuals(calibration.model, run, reference)
    assert np.isfinite(r["x"]).sum() >= COUNT - EVERY
    assert set(np.flatnonzero(np.isfinite(r["z"]))) == set(range(0, COUNT, EVERY))
    odd = residuals(calibration.model, spoiled(run), reference)
    for name in ("x", "z"):
        np.testing.assert_array_equal(r[name], odd[name])


def test_a_stream_says_what_the_file_says(calibration):
    """Ten rows apart the 20 first do not show a rate; an empty cell is not sampled. The rows about
    the onset."""
    first, last = ONSET - 200, ONSET + 400
    t, columns = cells(10, LOSS)
    online, rows = Stream(calibration.model), []
    for k in range(first, last):
        sample = Sample(float(t[k]), {name: float(v[k]) for name, v in columns.items()})
        rows += [each for each in online.push(sample) if isinstance(each, Decision)]
    rows += [each for each in online.finish() if isinstance(each, Decision)]
    (decision,), _ = decide_runs(calibration.model, [cut(log(10, LOSS), slice(first, last))])
    assert "FAULT" in decision.status
    for name in ("f", "lo", "hi", "healthy"):
        said = np.concatenate([getattr(each.posterior, name) for each in rows])
        np.testing.assert_array_equal(said, getattr(decision.posterior, name))
    assert [status for each in rows for status in each.status] == decision.status
    for name, values in decision.residuals.items():
        said = np.concatenate([each.residuals[name] for each in rows])
        np.testing.assert_array_equal(said, values)


def test_a_stream_of_an_observer_cannot_wait_for_a_slow_sensor(calibration):
    t, columns = cells(10, every=5)
    online = Stream(calibration.model, observer="eso")
    samples = [Sample(t[k], {name: v[k] for name, v in columns.items()}) for k in range(20)]
    for each in samples[:19]:
        assert list(online.push(each)) == []
    with pytest.raises(InputError, match="'z' is sampled at times of its own"):
        list(online.push(samples[19]))


def test_a_slow_sensor_that_is_stuck_stands_still_by_its_own_samples():
    """Healthy logs never repeat a value, so two samples may: from the third on it stands still."""
    run = log(0)
    run.columns["z"][500:] = 1.25
    known = for_observer(model(), {"x": 1, "z": 1})
    intake = Intake.of(known, STEP, slow_outputs(known, [run]), sized=False)
    rows = prepared(known.plant.signals, run)
    _, taken = intake.along(intake.init(STEP), rows)
    assert np.flatnonzero(taken.standing == 2).tolist() == list(range(520, COUNT))
    used = with_taken(known, rows, taken, outputs=True).run
    assert np.isnan(used.columns["z"][520:2991]).all()
    assert np.isfinite(used.columns["z"][:520]).all()


def test_a_window_that_is_written_has_the_samples_alone(tmp_path):
    run = log(0)
    write_table(as_table(run), tmp_path / "window.csv")
    (again,) = read_telemetry(tmp_path / "window.csv", held=["u"])
    np.testing.assert_array_equal(again.sampled["z"], run.sampled["z"])
    # ten digits of the samples, also where the line between two of them passes 0
    np.testing.assert_allclose(again.columns["z"], run.columns["z"], rtol=1e-9, atol=1e-9)
