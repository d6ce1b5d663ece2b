"""Free runs beside a log, against SciPy's exact discrete response."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.free_run import MAX_SUBSTEPS, bucket, free_run, pad, substeps_for

OSCILLATOR = """
name = "oscillator"
[states.q]
derivative = "v"
[states.v]
derivative = "-4*q - 0.5*v + 2*u"
[inputs.u]
min = -1
max = 1
[outputs.q]
value = "q"
[outputs.a]
value = "d(v)"
[faults.push]
enters = "state"
target = "v"
[faults.offset]
enters = "output"
target = "q"
"""
STEP, COUNT = 0.05, 200


def oscillator():
    return GrayBoxPlant.untrained(parse_plant(OSCILLATOR, "oscillator.toml"))


def simulate(u, dt, *, x0=(0.3, -0.2), f=None, substeps=1):
    f = np.zeros((len(u), 2)) if f is None else f
    found = free_run(
        oscillator(),
        jnp.asarray(x0),
        jnp.asarray(u)[:, None],
        jnp.asarray(dt),
        jnp.asarray(f),
        substeps,
    )
    return tuple(map(np.asarray, found))


def reference(u, x0=(0.3, -0.2), push=0.0):
    """The oscillator by its exact discrete matrices under a zero-order hold."""
    A, B = np.array([[0.0, 1.0], [-4.0, -0.5]]), np.array([[0.0, 0.0], [2.0, 1.0]])
    Ad, Bd, *_ = cont2discrete((A, B, np.eye(2), np.zeros((2, 2))), STEP)
    inputs = np.stack([np.clip(u, -1, 1), np.full(len(u), push)], axis=1)
    x = [np.array(x0)]
    for row in inputs[:-1]:
        x.append(Ad @ x[-1] + Bd @ row)
    return np.array(x)


U = np.repeat(np.random.default_rng(0).uniform(-1.5, 1.5, COUNT // 8), 8)  # clipped at times
DT = np.full(COUNT, STEP)
# RK4 on |A| = 4.1: (|A| h)^5 / 120 = 3e-6 of the state per step; over a memory of 4 s (80 steps)
# 2.5e-4 at worst, and 1/4^4 of it with 4 substeps
TOLERANCE = {1: 2.5e-4, 4: 1e-6}


@pytest.mark.parametrize("substeps", [1, 4])
def test_states_are_the_exact_response(substeps):
    x, _, _ = simulate(U, DT, substeps=substeps)
    np.testing.assert_allclose(x, reference(U), rtol=0, atol=TOLERANCE[substeps])


def test_outputs_and_derivatives_belong_to_their_sample():
    x, dx, y = simulate(U, DT)
    np.testing.assert_array_equal(x[0], [0.3, -0.2])
    acceleration = -4 * x[:, 0] - 0.5 * x[:, 1] + 2 * np.clip(U, -1, 1)
    np.testing.assert_array_equal(dx[:, 0], x[:, 1])
    np.testing.assert_allclose(dx[:, 1], acceleration, rtol=0, atol=1e-14)  # rounding
    np.testing.assert_array_equal(y[:, 0], x[:, 0])
    np.testing.assert_allclose(y[:, 1], acceleration, rtol=0, atol=1e-14)


def test_faults_over_time():
    f = np.zeros((COUNT, 2))
    f[:, 0], f[50:, 1] = 0.7, 5.0
    x, _, y = simulate(U, DT, f=f, substeps=4)
    np.testing.assert_allclose(x, reference(U, push=0.7), rtol=0, atol=TOLERANCE[4])
    np.testing.assert_array_equal(y[:50, 0], x[:50, 0])
    np.testing.assert_array_equal(y[50:, 0], x[50:, 0] + 5.0)


def test_padding_changes_nothing():
    length = bucket(COUNT)
    assert length > COUNT
    dt = np.append(DT[:-1], 0.0)
    whole = simulate(U, dt)
    padded = simulate(pad(U[:, None], length)[:, 0], np.concatenate([dt, np.zeros(length - COUNT)]))
    for a, b in zip(whole, padded, strict=True):
        np.testing.assert_allclose(b[:COUNT], a, rtol=0, atol=1e-14)  # another program: rounding
        assert np.all(np.ptp(b[COUNT - 1 :], axis=0) == 0)  # time stands still in the padding


def test_uneven_steps():
    """Two half steps under one input are one step."""
    u, dt = np.repeat(U[:40], 2), np.full(80, STEP / 2)
    x, _, _ = simulate(u, dt, substeps=4)
    np.testing.assert_allclose(x[::2], reference(U[:40]), rtol=0, atol=TOLERANCE[4])


@pytest.mark.parametrize(
    ("step", "longest", "expected"),
    [
        (0.1, 1.0, 1),
        (0.1, 0.1, 1),
        (0.3, 0.1, 3),  # 0.3 / 0.1 is 2.9999999999999996 or 3.0000000000000004: neither gives 4
        (0.1 + 0.2, 0.1, 3),
        (0.31, 0.1, 4),
        (1.0, 1e-9, MAX_SUBSTEPS),
        (0.0, 1.0, 1),
    ],
)
def test_substeps_for(step, longest, expected):
    assert substeps_for(step, longest) == expected


def test_bucket():
    lengths = [bucket(n) for n in range(1, 20_001)]
    assert all(length >= n for n, length in enumerate(lengths, 1))
    assert all(length <= max(64, 1.5 * n) for n, length in enumerate(lengths, 1))
    sizes = sorted(set(lengths))
    assert sizes[:5] == [64, 96, 128, 192, 256]
    assert len(sizes) <= 2 * math.log2(20_000)
    assert all(bucket(size) == size for size in sizes)


def test_pad_repeats_the_last_row():
    rows = np.array([[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(pad(rows, 4), [[1, 2], [3, 4], [3, 4], [3, 4]])
    assert pad(rows, 2).shape == (2, 2)
