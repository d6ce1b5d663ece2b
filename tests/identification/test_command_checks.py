"""Is the input of a log the command? Named where an actuator stands between, silent elsewhere."""

import re

import numpy as np
import pytest

from faultgauge.identification.command_checks import _Left, command_warnings
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

PLANT = """
name = "first order"
[states.x]
derivative = "{derivative}"
[inputs.u]
{key}
[outputs.x]
value = "x"
[parameters]
a = {{ value = 1.0 }}
b = {{ value = 1.0 }}
"""
A, B, STEP, COUNT = 0.8, 2.5, 0.05, 3000


def straight(u, k, last):
    return u[k]


def delayed(u, k, last):
    return u[max(k - 3, 0)]


def lagged(u, k, last):
    return last + (1 - np.exp(-STEP / 0.2)) * (u[k] - last)


def delayed_and_lagged(u, k, last):
    return lagged(u, max(k - 10, 0), last)


def limited(u, k, last):
    return min(u[k], 0.5)


def log(gain, seed, applied=straight, noise=0.01, load=0.05):
    """x' = b v - a x + load, v what an actuator makes of u = r - gain * x as measured."""
    random = np.random.default_rng(seed)
    r = np.repeat(random.uniform(-2, 2, COUNT // 40), 40)
    sensor, drive = random.standard_normal((2, COUNT))
    decay, keep = np.exp(-A * STEP), np.exp(-STEP / 0.3)
    x, u, state, d, v = np.zeros(COUNT), np.zeros(COUNT), 0.0, 0.0, 0.0
    for k in range(COUNT):
        d = keep * d + load * np.sqrt(1 - keep**2) * drive[k]
        x[k] = state + noise * sensor[k]
        u[k] = r[k] - gain * x[k]
        v = applied(u, k, v)
        state = decay * state + (1 - decay) / A * (B * v + d)
    return Run(f"run{seed}", "loop.csv", STEP * np.arange(COUNT), {"x": x, "u": u})


def plant(derivative="b*u - a*x", key="", more=""):
    text = PLANT.format(derivative=derivative, key=key) + more
    return GrayBoxPlant.untrained(parse_plant(text, "plant.toml"))


@pytest.mark.parametrize(
    ("applied", "words"),
    [
        (delayed, ["follows it delayed by 0.15 s", "give delay = 0.15 in [inputs.u]"]),
        pytest.param(
            lagged, ["follows it through a lag of 0.2 s", "as a state"], marks=pytest.mark.study
        ),
        pytest.param(
            limited,
            ["follows it only as far as about 0.", "give its limits"],
            marks=pytest.mark.study,
        ),
    ],
)
def test_what_stands_between_the_command_and_the_plant_is_named(applied, words):
    for seed in range(2):
        model, account = fit(plant(), [log(0.5, seed, applied)], restarts=1)
        # beside it stands, where the limit makes the model a poor one, that it is
        (text,) = (each for each in account.warnings if "input 'u' looks like the command" in each)
        assert all(word in text for word in words)
        assert command_warnings(model.plant, [log(0.5, seed, applied)]) == [text]


def test_a_lag_behind_a_dead_time_is_no_longer_dead_time():
    for seed in range(2):
        _, account = fit(plant(), [log(0.0, seed, delayed_and_lagged)], restarts=1)
        (text,) = (each for each in account.warnings if "looks like the command" in each)
        assert "follows it delayed by 0.5 s and through a lag of 0.2 s, which explains" in text
        assert "give delay = 0.5 in [inputs.u] and add the lag to the plant file" in text


def test_what_is_measured_is_no_command():
    found = fit(plant(key='hold = "linear"'), [log(0.5, 0, delayed)], restarts=1)[1].warnings
    assert any(re.match(r"the plant follows input 'u' delayed by 0\.1\d* s", w) for w in found)
    assert not any("looks like the command" in text for text in found)


def test_an_applied_input_is_left_alone_at_any_gain_and_noise():
    for gain in (0.0, 0.5, 4.0):
        for noise, load in ((0.0, 0.0), (0.05, 0.0), (0.01, 0.3), (0.02, 1.0)):
            for seed in range(2):
                run = log(gain, seed, noise=noise, load=load)
                _, account = fit(plant(), [run], restarts=1)
                assert not any("input 'u'" in text for text in account.warnings)


def test_a_delay_that_the_plant_file_knows_is_no_warning():
    _, account = fit(plant(key="delay = 0.15"), [log(0.5, 0, delayed)], restarts=1)
    assert account.warnings == []


def test_values_beyond_the_limits():
    run = log(0.5, 0)
    u = run.columns["u"]
    beyond = np.mean(np.abs(u) > 1.5)
    (text,) = command_warnings(plant(key="min = -1.5\nmax = 1.5"), [run])[:1]
    assert f"goes beyond its limits, -1.5 to 1.5, in {100 * beyond:.2f} % of the rows" in text
    assert f"as far as {u[np.argmax(np.abs(u))]:.4g}" in text
    rounded = np.clip(np.round(u, 4), -1.5, 1.50001)  # as a log of five digits has it
    run = Run("a", "a.csv", run.t, {**run.columns, "u": rounded})
    found = command_warnings(plant(key="min = -1.5\nmax = 1.5"), [run])
    assert not any("beyond its limits" in text for text in found)


def test_a_network_that_has_learned_a_saturation():
    network = plant("push(u) - a*x", more="[networks.push]\nhidden = 3\n")
    _, account = fit(network, [log(0.5, 0, limited)], restarts=1)
    (text,) = [text for text in account.warnings if "input 'u'" in text]
    level = float(text.split("moves on above ")[1].split()[0])
    assert 0.5 <= level < 1.5  # the network rounds the corner off, so it is seen late
    assert "give min and max" in text
    model, account = fit(network, [log(0.5, 0)], restarts=1)
    assert not any("input 'u'" in text for text in account.warnings)
    # a linear plant has this log, too, and beyond its training a network keeps its edge
    wide = log(0.5, 0)
    wide.columns.update({name: 2 * column for name, column in wide.columns.items()})
    assert command_warnings(model.plant, [wide]) == []


def test_samples_where_the_model_has_no_value_do_not_count():
    """rho = 2 q but for a sample at which F is infinite, on which LAPACK might not end."""
    q = np.random.default_rng(0).standard_normal(50)
    rho = np.where(np.arange(50) == 7, np.inf, 2 * q)
    left = _Left(rho, np.ones((50, 1)), np.ones(50, bool), 0)
    share, _ = left.explained(q, 1.0)
    assert share == pytest.approx(1.0)  # q explains all that is left
