"""`--resample`: a log at a kilohertz of a plant that moves in seconds."""

import io
import json
import sys

import numpy as np
import pytest

import faultgauge as fg
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration import calibration
from faultgauge.identification.samples import column_names, jumping

TAU, FINE, RATE, NOISE = 0.7, 1000, 20.0, 0.01
# the mean of 50 samples of the sensor, and next to no error of the model; tau is known to 1 %
LEVELS = Noise(
    *(np.array(each) for each in (
        [NOISE / (FINE / RATE) ** 0.5], [1e-4], [], *([1e-4], [8.0], [1e-4], [3.0]),
        *([0.01 * TAU], [0.0], [0.0]),
    ))
)  # fmt: skip
PLANT = """name = "lag"

[states.x]
unit = "m"
derivative = "(u - x)/tau"

[inputs.u]
unit = "m"
hold = "zero"

[outputs.x]
unit = "m"
value = "x"

[parameters]
tau = { value = 2.0, min = 0.01, unit = "s" }

[faults.drift]
enters = "state"
target = "x"
unit = "m/s"
"""


def lag(path, seed, rate=FINE, duration=40.0, unit=1.0, drift=0.0):
    """x' = (u - x)/tau + f over each held input, exactly, as a log at `rate` Hz.

    The input moves every 17 ms at most, which is no whole number of the new steps."""
    random = np.random.default_rng(seed)
    count = round(duration * FINE)
    u = np.repeat(random.uniform(-1, 1, count // 17 + 1), 17)[:count]
    u += np.repeat(random.choice([-2.0, 2.0], count // 850 + 1), 850)[:count]
    f = np.where(np.arange(count) < count // 2, 0.0, drift)
    decay, x = np.exp(-1 / FINE / TAU), np.zeros(count)
    for k in range(count - 1):
        x[k + 1] = decay * x[k] + (1 - decay) * (u[k] + TAU * f[k])
    x += NOISE * random.standard_normal(count)
    every = FINE // rate
    rows = zip(unit * np.arange(0, count, every) / FINE, u[::every], x[::every], strict=True)
    path.write_text("t,u,x\n" + "".join(f"{t:.10g},{a:.10g},{b:.10g}\n" for t, a, b in rows))
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    from faultgauge.cli.app import run

    folder = tmp_path_factory.mktemp("resample")
    (folder / "plant.toml").write_text(PLANT)
    for name, seed in (("fit", 0), ("healthy", 1), ("more", 2)):
        lag(folder / f"{name}.csv", seed)
    lag(folder / "suspect.csv", 3, drift=0.8)
    model = ["fit", folder / "plant.toml", folder / "fit.csv", "--out", folder / "model.fgm"]
    assert run([str(each) for each in (*model, "--resample", RATE)]) == 0
    model, out = folder / "model.fgm", folder / "calibrated.fgm"
    call = ["calibrate", model, folder / "healthy.csv", "--out", out]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "estimate_noise", lambda *_: LEVELS)
        assert run([str(each) for each in call]) == 0
    return folder


@pytest.mark.parametrize("seed", range(3))
def test_the_constant_of_a_lag_within_its_error(call, files, tmp_path, seed):
    log, out = lag(tmp_path / "log.csv", 10 + seed), tmp_path / "model.fgm"
    said = call("fit", files / "plant.toml", log, "--out", out, "--resample", RATE)
    assert said.code == 0, said.err
    value, error = said.out.split("tau = ")[1].split(" s")[0].split(" +- ")
    assert abs(float(value) - TAU) < 4 * float(error)  # sd; one of 16,000 honest ones would not
    assert float(error) < 0.05 * TAU


def test_the_model_keeps_its_rate_and_only_then_has_one(files, call, tmp_path):
    model = fg.load_model(files / "model.fgm")
    assert model.resample == RATE
    assert model.record.sample_time == pytest.approx(1 / RATE, rel=1e-9)
    slow = lag(tmp_path / "slow.csv", 0, rate=20)
    assert call("fit", files / "plant.toml", slow, "--out", tmp_path / "m.fgm").code == 0
    record = fg.load_model(tmp_path / "m.fgm").record
    assert {"resample", "log_step"}.isdisjoint(record.as_dict())


def test_evaluate_and_estimate_bring_logs_to_it(files, call, tmp_path):
    found = call("evaluate", files / "model.fgm", files / "healthy.csv", "--json").json
    assert found["runs"][0]["samples"] == 40 * RATE - 6  # three at each end are lost
    assert found["outputs"]["x"]["r2"] > 0.99
    out = tmp_path / "out.csv"
    said = call("estimate", files / "calibrated.fgm", files / "suspect.csv", "--out", out, "--json")
    assert said.code == 0, said.err
    t = np.genfromtxt(out, delimiter=",", names=True, dtype=None, encoding=None)["t"]
    np.testing.assert_allclose(t, np.arange(3, 797) / RATE, rtol=1e-9)
    (event,) = said.json["events"]
    assert event["fault"] == "drift"
    assert event["size"] == pytest.approx(0.8, rel=0.02)  # one draw: its interval may miss
    assert 19.5 < event["start"] < 22


def test_the_same_from_python(files, call):
    """What the command says, from the functions that it calls."""
    said = call("evaluate", files / "model.fgm", files / "healthy.csv", "--json").json
    model = fg.load_model(files / "model.fgm")
    required, optional = column_names(model.plant.signals)
    runs = fg.read_telemetry(
        files / "healthy.csv",
        names=required,
        optional=optional,
        held=["u"],
        averaged=jumping(model.plant.spec),
        resample=model.resample,
        slower="keep",
    )
    assert fg.evaluate(model, runs).as_dict()["outputs"] == said["outputs"]
    assert fg.evaluate(model, files / "healthy.csv").as_dict() == said


def test_a_log_that_is_slower_than_the_model_is_taken_as_it_is(files, call, tmp_path):
    slow = lag(tmp_path / "slow.csv", 4, rate=10)
    found = call("evaluate", files / "model.fgm", slow, "--json").json
    assert found["runs"][0]["samples"] == 400


def test_rates_that_are_refused(files, call, tmp_path):
    def refused(*arguments):
        said = call(*arguments)
        assert said.code == 2
        assert said.out == ""
        assert said.err.count("\n") == 1, said.err
        return said.err

    fit = ("fit", files / "plant.toml", files / "fit.csv", "--out", tmp_path / "m.fgm")
    for rate in ("0", "-20", "inf", "nan"):
        assert "positive number of hertz" in refused(*fit, f"--resample={rate}")
    assert "only 1000 samples a second" in refused(*fit, "--resample", 2000)
    other = refused("evaluate", files / "model.fgm", files / "fit.csv", "--resample", 50)
    assert "the model was fitted at 20 Hz" in other
    assert call("evaluate", files / "model.fgm", files / "fit.csv", "--resample", 20).code == 0
    stream = refused("estimate", files / "model.fgm", "-", "--resample", 20)
    assert "--resample does not go with -" in stream


def test_calibrate_gives_its_rate_to_a_model_without_one(files, call, tmp_path):
    slow = lag(tmp_path / "slow.csv", 0, rate=20, duration=100.0)
    model = tmp_path / "m.fgm"
    assert call("fit", files / "plant.toml", slow, "--out", model).code == 0
    logs = files / "healthy.csv", files / "more.csv"
    said = call("calibrate", model, *logs, "--resample", RATE, "--observer", "eso")
    assert said.code == 0, said.err
    assert fg.load_model(model).resample == RATE


def stream(monkeypatch, path):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(path.read_bytes())))


def test_a_stream_at_the_rate_of_the_model_and_a_faster_one(files, call, tmp_path, monkeypatch):
    stream(monkeypatch, lag(tmp_path / "slow.csv", 5, rate=20))
    said = call("estimate", files / "calibrated.fgm", "-")
    assert said.code == 0, said.err
    assert said.out.count("\n") == 801
    stream(monkeypatch, files / "healthy.csv")
    said = call("estimate", files / "calibrated.fgm", "-")
    assert said.code == 2
    assert "rows come at 1000 Hz and the model was fitted at 20 Hz" in said.err


@pytest.mark.parametrize("rate", [20])
def test_a_log_in_milliseconds(files, call, tmp_path, rate):
    """Of a model that keeps a rate, and of one that does not."""
    model, slow = files / "model.fgm", lag(tmp_path / "s.csv", 0, rate=20)
    if rate == 20:
        model = tmp_path / "m.fgm"
        assert call("fit", files / "plant.toml", slow, "--out", model).code == 0
    log = lag(tmp_path / "log.csv", 1, rate=rate, unit=1000.0)
    said = call("evaluate", model, log)
    assert "1000 times" in said.err
    assert 'if it is, give --map "t=t/1000"' in said.err
    mended = call("evaluate", model, log, "--map", "t=t/1000", "--json")
    assert not any("looks to be in" in each for each in mended.json["warnings"])
    assert mended.json["outputs"]["x"]["r2"] > 0.99
    log.write_text(log.read_text().replace("t,u,x", "stamp,u,x"))
    said = call("estimate", model, log, "--time", "stamp", "--out", tmp_path / "o.csv", "--json")
    assert '--map "t=stamp/1000" in place of --time stamp' in json.dumps(said.json).replace(
        '\\"', '"'
    )
    # a thousand times the step is a thousand steps of integration, which the bank would find dear
    limited = ("--observer", "eso", "--out", tmp_path / "c.fgm")
    said = call("calibrate", model, log, "--map", "t=stamp*1", *limited)
    assert '--map "t=(stamp*1)/1000" in place of that of t' in said.err
