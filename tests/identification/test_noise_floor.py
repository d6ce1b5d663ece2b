"""The noise of columns against the noise that was put in."""

import numpy as np
import pytest

from faultgauge.identification.noise_floor import noise_floor
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run
from faultgauge.telemetry.rates import align

TWO = """
name = "two"
[states.x]
unit = "m"
derivative = "u - x"
[states.z]
derivative = "x - z"
[inputs.u]
[outputs.y]
unit = "V"
value = "2*x"
[outputs.unseen]
value = "z"
"""
STEP, COUNT, SIGMA = 0.02, 1200, 0.05
# The median of |third differences| of n normal values: a median tells a standard deviation to
# 1.17 / sqrt(n), and neighbours are correlated (-15/20, 6/20, -1/20), which costs
# sqrt(1 + 2 (0.75^2 + 0.3^2 + 0.05^2)) = 1.52 on top: 1.77 / sqrt(n).
SCATTER = 1.77


def signals():
    return parse_plant(TWO).signals


def run(seed, sigma=SIGMA, name="run"):
    """y = 2 x under a held input that jumps; exact under the hold."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, COUNT // 40), 40)
    x, fade = np.zeros(COUNT), np.exp(-STEP)
    for k in range(COUNT - 1):
        x[k + 1] = u[k] + fade * (x[k] - u[k])
    y = 2 * x + sigma * rng.standard_normal(COUNT)
    return Run(name, "log.csv", STEP * np.arange(COUNT), {"u": u, "y": y})


def sd(*runs, name="y"):
    return noise_floor(signals(), runs)[name]["sd"]


def test_the_noise_is_what_was_put_in():
    found = np.array([sd(run(seed)) for seed in range(20)])
    assert found.mean() == pytest.approx(SIGMA, rel=3 * SCATTER / np.sqrt(20 * COUNT))
    assert found.std() / SIGMA == pytest.approx(SCATTER / np.sqrt(COUNT), rel=0.5)  # of 20 seeds
    assert sd(run(0), run(1), run(2)) == np.median(found[:3])


def test_only_columns_that_are_there_are_told_with_their_units():
    found = noise_floor(signals(), [run(0)])
    assert list(found) == ["y"]  # x is hidden, "unseen" has no column
    assert found["y"]["unit"] == "V"
    seen = run(0)
    seen.columns["x"] = seen.columns["y"] / 2
    found = noise_floor(signals(), [seen])
    assert found["x"] == {"sd": found["y"]["sd"] / 2, "unit": "m"}


def test_a_slow_sensor_is_told_by_its_own_samples():
    """Lines between samples would have third differences of 0."""
    levels = []
    for seed in range(10):
        whole = run(seed)
        y = np.where(np.arange(COUNT) % 5 == 0, whole.columns["y"], np.nan)
        found = align(whole.t, whole.columns | {"y": y}, held={"u"})
        levels.append(sd(Run("r", "a.csv", whole.t, found.columns, sampled=found.sampled)))
    assert np.mean(levels) == pytest.approx(SIGMA, rel=3 * SCATTER / np.sqrt(10 * COUNT / 5))


@pytest.mark.parametrize("q", [0.01, 0.05, 1.0])
def test_a_quantised_column_has_at_least_the_noise_of_its_steps(q):
    """sigma^2 + q^2 / 12 where the noise moves the reading through steps, q / sqrt(12) where it
    does not."""
    rounded = []
    for seed in range(10):
        each = run(seed)
        each.columns["y"] = q * np.round(each.columns["y"] / q)
        rounded.append(sd(each))
    if q > SIGMA:
        assert rounded == pytest.approx([q / np.sqrt(12)] * 10, rel=1e-9)
    else:  # third differences are whole steps, and so is their median: to half of one over sqrt(20)
        room = q / 2 / 0.6745 / np.sqrt(20) + 3 * SIGMA * SCATTER / np.sqrt(10 * COUNT)
        assert np.mean(rounded) == pytest.approx(np.hypot(SIGMA, q / np.sqrt(12)), abs=room)


def test_without_noise_next_to_nothing_is_left():
    assert sd(run(0, sigma=0.0)) < 1e-3 * SIGMA


def test_where_a_sensor_is_stuck_nothing_is_learned():
    stuck = run(0)
    stuck.columns["y"][300:1000] = stuck.columns["y"][300]
    assert sd(stuck) == pytest.approx(SIGMA, rel=3 * SCATTER / np.sqrt(COUNT - 700))
    stuck.columns["y"][:] = 1.0
    assert sd(stuck) == 0.0


def test_too_short_a_run_says_nothing():
    short = Run("r", "a.csv", STEP * np.arange(19), {"u": np.ones(19), "y": np.arange(19.0)})
    assert sd(short) is None
    assert sd(short, run(0)) == sd(run(0))
