"""A subclass of `Plant` through every verb: it says what the same plant says as a file."""

import equinox as eqx
import jax
import numpy as np
import pytest

import faultgauge as fg
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.calibration import calibration
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.stream import Stream
from faultgauge.errors import InputError
from faultgauge.plants.signals import Fault, Input, Output, Signals, State
from faultgauge.plants.spec import Parameter
from faultgauge.telemetry.stream import Sample

SCENARIO = """
name = "steps"
plant = "tank"
seconds = 20
step = 0.1
[inputs.u]
source = "multisine"
sigma = 1.0
low = 0.05
high = 1.0
"""
SIGNALS = Signals(
    (State("x", "m"),),
    (Input("u", "V"),),
    (Output("x", "m"),),
    (Fault("leak", "state", "x", "m/s"),),
)


class Tank(fg.Plant):
    """The tank of the tests."""

    signals: Signals = eqx.field(static=True, default=SIGNALS)
    a: jax.Array | float = 1.0
    b: jax.Array | float = 1.0
    constants = (Parameter("a", 1.0, min=0.0), Parameter("b", 1.0))

    def derivative(self, x, u):
        return self.b * u - self.a * x

    def output(self, dx, x, u):
        return x


@pytest.fixture(scope="module")
def pairs(tank, learned, calibrated, judged):
    """(of the file, of the class): fitted, calibrated by the noise of the file, judged."""
    fit, noise = fg.fit(Tank(), tank.log(1)), noise_of(calibrated.model)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "estimate_noise", lambda *_: noise)
        own = fg.calibrate(fit.model, tank.log(2))
    told = fit, own, fg.estimate(own.model, tank.log(3, tank.leak))
    return list(zip((learned, calibrated, judged), told, strict=True))


@pytest.fixture(scope="module")
def model(pairs):
    return pairs[1][1].model


def alike(one, other):
    assert one.keys() == other.keys()
    for name, cells in one.items():
        if any(isinstance(cell, str) for cell in cells):
            assert list(cells) == list(other[name]), name
        else:  # two programs of one arithmetic may round otherwise, and searches go on from it
            found, wanted = (np.array(each, float) for each in (other[name], cells))
            np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9, err_msg=name)


def test_it_is_fitted_calibrated_and_judged_alike(pairs):
    for by_file, by_class in pairs:
        assert str(by_file) == str(by_class)
        alike(by_file.columns(), by_class.columns())
    assert pairs[0][1].parameters == pytest.approx(pairs[0][0].parameters, rel=1e-9)


@pytest.mark.study  # a search of its own, of what is calibrated alike by one noise above
def test_its_noise_is_found_alike(pairs, tank):
    by_class = fg.calibrate(pairs[0][1].model, tank.log(2))
    assert str(pairs[1][0]) == str(by_class)
    alike(pairs[1][0].columns(), by_class.columns())


@pytest.mark.study
def test_it_is_evaluated_rehearsed_and_foreseen_alike(pairs, tank):
    (file, own), healthy = (each.model for each in pairs[1]), tank.log(2)
    for verb in (fg.evaluate, fg.rehearse, fg.detectability):
        found, wanted = verb(own, healthy), verb(file, healthy)
        said = [str(each).replace("Tank", "tank") for each in (found, wanted)]
        assert said[0] == said[1], verb


@pytest.mark.study
def test_its_hidden_states_are_found_by_simulation(tank):
    class Hidden(Tank):
        def output(self, dx, x, u):
            return 2.0 * x

    signals = fg.plant(Tank()).signals
    doubled = Hidden(Signals(signals.states, signals.inputs, (Output("y", "m"),), signals.faults))
    log = tank.log(1)
    fit = fg.fit(doubled, {"t": log["t"], "u": log["u"], "y": 2.0 * log["x"]})
    assert fit.account.refinement is not None
    assert fit.parameters["a"] == pytest.approx(tank.a, rel=0.01)  # noise of 0.2 % of the level
    assert fit.parameters["b"] == pytest.approx(tank.b, rel=0.01)


def test_it_is_simulated(tmp_path, pairs):
    file = tmp_path / "steps.toml"
    file.write_text(SCENARIO)
    untrained, fitted = fg.simulate(file, Tank(a=2.0, b=3.0)), fg.simulate(file, pairs[1][1].model)
    u, x = untrained.run.columns["u"], untrained.run.columns["x"]
    decay = np.exp(-2.0 * 0.1)
    held = np.zeros(len(u))
    for k in range(len(u) - 1):
        held[k + 1] = decay * held[k] + (1 - decay) / 2.0 * 3.0 * u[k]
    np.testing.assert_allclose(x, held, atol=1e-5)  # RK4 with steps of 0.1 s at 2/s
    alike(fg.simulate(file, pairs[1][0].model).columns(), fitted.columns())


@pytest.mark.study
def test_it_is_checked_with_faults_of_nobody(tank):
    bare = Tank(Signals(SIGNALS.states, SIGNALS.inputs, SIGNALS.outputs))
    found = fg.check(tank.log(1, count=1200), tank.log(3, tank.leak), bare)
    event = found.as_dict()["events"][0]
    assert event["fault"] == "x_drift"
    assert event["lo"] < tank.leak < event["hi"]


def test_it_is_watched_and_streamed(model, pairs, tank):
    log = tank.log(3, tank.leak)
    watch = fg.Watch(model, ("u", "x"), tank.step)
    run = fg.read(log, model)[0]
    _, rows = watch.along(watch.init(), prepared(watch.signals, run))
    assert np.asarray(rows.verdict.named)[-50:, 0].all()
    stream = Stream(model)
    samples = [
        Sample(float(t), {"u": float(u), "x": float(x)})
        for t, u, x in zip(log["t"], log["u"], log["x"], strict=True)
    ]
    said = [*stream.push(*samples), *stream.finish()]
    assert said


def test_what_has_no_code_in_it_cannot_carry_it(model, tmp_path):
    with pytest.raises(InputError, match="'Tank' is written in Python, and a model file holds no"):
        fg.save_model(model, tmp_path / "m.fgm")
    assert not list(tmp_path.iterdir())
