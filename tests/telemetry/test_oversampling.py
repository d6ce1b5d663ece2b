"""Logs that are sampled far faster than the plant moves."""

import numpy as np
import pytest
from scipy.signal import lfilter, welch

from faultgauge.telemetry import Run, inspect_runs, resampled
from faultgauge.telemetry.oversampling import _power, oversampled

SAMPLES = 30_000


def lag(step, tau, hold, noise=0.01, seed=0):
    """A first-order lag, exactly, under steps of `hold` s, with sensor noise."""
    random = np.random.default_rng(seed)
    each = round(hold / step)
    u = np.repeat(random.choice([-1.0, 1.0], SAMPLES // each + 1), each)[:SAMPLES]
    decay = np.exp(-step / tau)
    y = np.asarray(lfilter([0.0, 1 - decay], [1.0, -decay], u))
    columns = {"u": u, "y": y + noise * random.standard_normal(SAMPLES)}
    return Run("log", "log.csv", step * np.arange(SAMPLES), columns)


def test_a_plant_of_seconds_at_a_kilohertz():
    run = lag(0.001, 1.0, 2.0)
    (sentence,) = oversampled([run], ["y"])
    assert "1000 Hz" in sentence
    rate = float(sentence.split("--resample ")[1].split(",")[0])
    assert 20 <= rate <= 250  # its corner is at 0.16 Hz
    assert oversampled([resampled(run, rate, {"u"})], ["y"]) == []


@pytest.mark.parametrize(("tau", "hold"), [(0.02, 0.05), (0.1, 0.1)])
def test_a_plant_that_moves_within_tens_of_samples(tau, hold):
    assert oversampled([lag(0.001, tau, hold)], ["y"]) == []


def test_the_fastest_column_counts():
    slow, fast = lag(0.001, 1.0, 2.0), lag(0.001, 0.02, 0.05)
    both = Run("log", "log.csv", slow.t, {"a": slow.columns["y"], "b": fast.columns["y"]})
    assert oversampled([both], ["a"])
    assert oversampled([both], ["a", "b"]) == []


def test_nothing_is_said_of_what_cannot_be_told():
    t = np.arange(5000) / 1000
    columns = {"still": np.ones(5000), "noise": np.random.default_rng(0).standard_normal(5000)}
    assert oversampled([Run("log", "log.csv", t, columns)], columns) == []
    assert oversampled([Run("log", "log.csv", t[:500], {"still": t[:500]})], ["still"]) == []


@pytest.mark.parametrize(
    ("name", "time"),
    [
        ("quarter_drone/sinal4_multiseno_malha_fechada", "t_s"),
        ("cascaded_tanks/train", "t_s"),
        ("crazypad/normal_flight_log00", "t"),
    ],
)
def test_measured_logs_at_sensible_rates(data_dir, name, time):
    found = inspect_runs(data_dir / f"{name}.csv.gz", time=time)
    assert not any("--resample" in hint for hint in found.hints)


def test_a_measured_drive_at_a_kilohertz(data_dir):
    """A carriage that moves to and fro within seconds."""
    found = inspect_runs(data_dir / "emps" / "train_nominal.csv.gz", time="t_s")
    assert any("--resample 100" in hint for hint in found.hints)


@pytest.mark.parametrize("length", [256, 255])
def test_power_is_scipys(length):
    x = lag(0.001, 0.1, 0.1).columns["y"][:2000] + np.linspace(0, 3, 2000)
    wanted = welch(x, nperseg=length, detrend="linear", scaling="spectrum")[1]
    found = _power(x, length)
    inner = slice(2, -2)  # at the ends one side is none of two
    scale = wanted[10] / found[10]
    np.testing.assert_allclose(scale * found[inner], wanted[inner], rtol=1e-9)
