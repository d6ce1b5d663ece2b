"""How constants differ between runs, and how they do so together."""

import jax.numpy as jnp
import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.detection.bank.extended import directions_of, disturbed
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.calibration.innovation_likelihood import healthy_stretches
from faultgauge.detection.calibration.noise_estimation import estimate_noise
from faultgauge.detection.calibration.noise_levels import first_guess
from faultgauge.detection.calibration.run_spread import _between
from faultgauge.telemetry import Run
from models import as_stated

DRUM = """
name = "drum"
[states.w]
unit = "rad/s"
derivative = "u - b*w - c"
[inputs.u]
hold = "zero"
[outputs.w]
value = "w"
[parameters]
b = { value = 0.2, unit = "1/s" }
c = { value = 1.0, unit = "rad/s**2" }
"""
B, C, AT, STEP, COUNT, LOGS = 0.2, 1.0, 5.0, 0.5, 240, 8
SIGMA, PROCESS = 0.05, 0.02  # of a sample, per sqrt(s)


def model():
    points = np.random.default_rng(0).uniform([4, 1], [6, 3], (60, 2))
    return as_stated(DRUM, points)


def log(seed):
    """w' = u - b w - c + noise near 5 rad/s, where b and c look alike but for what little w moves:
    exact under the hold of u."""
    rng = np.random.default_rng(seed)
    u = B * AT + C + np.repeat(rng.uniform(-0.02, 0.02, COUNT // 20), 20)
    fade, w = np.exp(-B * STEP), np.full(COUNT, AT)
    for k in range(COUNT - 1):
        w[k + 1] = fade * w[k] + (1 - fade) / B * (u[k] - C)
        w[k + 1] += PROCESS * np.sqrt(STEP) * rng.standard_normal()
    y = w + SIGMA * rng.standard_normal(COUNT)
    return Run(f"{seed}", "drum.csv", STEP * np.arange(COUNT), {"u": u, "w": y})


def test_what_few_runs_say_of_a_correlation_counts_beside_one_run_of_each_constant():
    """Two runs, off by (1, 1) and (-1, -1), each of which leaves 3 -1 -1 3 unknown: sums of 8
    and none together. Off by (2, 1) and (-2, -1): sums of 14, 8 and 2 together, a correlation that
    counts as one in three. A third run is the prior. The units differ: nothing is pooled."""
    V = np.array([[[3.0, -1.0], [-1.0, 3.0]]] * 2)
    usual = np.array([1.0, 2.0])
    off = np.array([[1.0, 1.0], [-1.0, -1.0]])
    found = _between(model(), ("b", "c"), off, V, usual)
    assert found == pytest.approx(np.diag([8 + 1, 8 + 4]) / 3)
    found = _between(model(), ("b", "c"), off * [2, 1], V, usual)
    apart = np.sqrt([15.0, 12.0])
    share = 2 / np.sqrt(14 * 8) / 3
    assert found == pytest.approx(np.outer(apart, apart) * [[1, share], [share, 1]] / 3)
    found = _between(model(), ("b", "c"), 0 * off, 0 * V, usual)
    assert found == pytest.approx(np.diag([1.0, 4.0]) / 3)


def test_a_covariance_is_kept_in_model_files():
    wanted = np.array([[4e-6, -1.8e-5], [-1.8e-5, 1e-4]])
    runs = [log(seed) for seed in range(2)]
    guess = first_guess(model(), runs, healthy_stretches(model(), runs))
    noise = guess.with_between(wanted)
    assert noise.spread == pytest.approx([2e-3, 1e-2])
    assert noise.together[0, 1] == pytest.approx(-0.9)
    read = noise_of(for_bank(model(), block := noise.as_dict(model())))
    assert block["together"] == {"b, c": pytest.approx(-0.9)}
    W = directions_of(model(), read)
    assert pytest.approx(wanted, rel=1e-12) == W @ W.T
    # a model file from before: each its own way
    del block["together"]
    W = directions_of(model(), noise_of(for_bank(model(), block)))
    assert pytest.approx(np.diag(np.diag(wanted)), rel=1e-12, abs=1e-20) == W @ W.T


def test_what_holds_at_rest_in_a_model_file_from_before_lasts_as_long_in_motion():
    """exp(-1) of what lasts 3 s is left after those, at rest and at 5 rad/s alike where the file
    has no travel; with one of 0.5 rad, of 15 rad at the slip, where half count, exp(-16)."""
    runs, one = [log(seed) for seed in range(2)], np.ones(1)
    noise = first_guess(model(), runs, healthy_stretches(model(), runs))
    noise = noise._replace(grip=0.1 * one, gripping=3 * one, slip=5 * one, travel=0.5 * one)
    block = noise.as_dict(model())
    for travel, left in (({"w": 0.5}, np.exp(-1 - 3 * 5 * 0.5 / 0.5)), ({}, np.exp(-1))):
        plant = disturbed(model(), noise_of(for_bank(model(), block | {"travel": travel})))
        q = plant.parts.q.start - plant.count
        for w, wanted in ((0.0, np.exp(-1)), (5.0, left)):
            x = jnp.full(1, w)
            found = float(plant.lasting(jnp.asarray(3.0), x, x)[q])
            assert found == pytest.approx(wanted, rel=1e-12)


@pytest.mark.study  # a search of its own
def test_what_runs_at_one_speed_cannot_tell_of_two_frictions_does_not_hide_their_sum():
    """The runs do not differ, and each tells b w + c at 5 rad/s to v = 0.02 / sqrt(120 s) = 0.002
    rad/s^2. Of that, C settles at 0.0054, its eighth, for what is not known of the mean, and
    Student's t of eight degrees of freedom, 2.306 / 1.960, beside it; each constant on its own
    would make that 0.0089. What each is made of no run tells: that stays the prior's, 1 %."""
    at, v, usual = np.array([AT, 1.0]), PROCESS / np.sqrt(COUNT * STEP), 0.01 * np.array([B, C])
    between = np.diag(usual**2)
    for _ in range(60):
        gain = between @ at / (at @ between @ at + v**2)
        told, untold = np.outer(gain, gain) * v**2, between - np.outer(gain, at @ between)
        sums = LOGS * (told + untold)
        each = np.sqrt(np.diag(sums))
        share = sums[0, 1] / each[0] / each[1] * (LOGS - 1) / (LOGS - 1 + 2)
        apart = np.sqrt(np.diag(sums) + usual**2)
        between = np.outer(apart, apart) * [[1, share], [share, 1]] / (LOGS + 1)
    wanted = np.sqrt(at @ between @ at * (1 + 1 / LOGS)) * 2.306 / 1.960
    assert wanted == pytest.approx(0.0067, abs=5e-5)
    found = estimate_noise(model(), [log(seed) for seed in range(LOGS)])
    # v from eight runs scatters by a quarter, and is a third of it
    assert np.sqrt(at @ found.between @ at) == pytest.approx(wanted, rel=0.15)
    assert found.spread[0] > 0.5 * 0.01 * B
    assert found.spread[1] > 0.5 * 0.01 * C
    assert found.together[0, 1] < -0.5
