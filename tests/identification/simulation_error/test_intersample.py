"""Inputs between their samples, against exact signals, hand arithmetic and SciPy's integrator."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.free_run import simulate_through
from faultgauge.simulation.integrators import step_through
from faultgauge.simulation.intersample import band_limited, intersample, line

MIXED = """
name = "three holds"
[states.x]
derivative = "z + r + b - 2*x"
[inputs.z]
hold = "zero"
[inputs.r]
hold = "linear"
[inputs.b]
hold = "band-limited"
[outputs.x]
value = "x"
"""
LAG = """
name = "lag"
[states.x]
derivative = "3*u - 2*x"
[inputs.u]
hold = "HOLD"
[outputs.x]
value = "x"
"""
PASS_BAND = 1e-4  # error that the filter states up to 0.4 of the sampling rate, per unit amplitude
REACH = 12  # samples either side that it uses


def plant(text):
    return GrayBoxPlant.untrained(parse_plant(text, "plant.toml"))


def multisine(seed, highest=0.35, tones=12):
    """u(t) and the sum of its amplitudes; t in samples, frequencies up to `highest` per sample."""
    rng = np.random.default_rng(seed)
    frequency = rng.uniform(0.0, highest, tones)
    frequency[0] = highest
    amplitude, phase = rng.uniform(0.2, 1.0, tones), rng.uniform(0, 2 * np.pi, tones)

    def u(t):
        angle = 2 * np.pi * np.multiply.outer(np.asarray(t, float), frequency) + phase
        return np.cos(angle) @ amplitude + 0.7

    return u, float(amplitude.sum())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("shift", [0.0, 0.125, 0.5, 0.9])
def test_band_limited_is_the_exact_signal(seed, shift):
    u, size = multisine(seed)
    t = np.arange(300)
    found = np.asarray(band_limited(jnp.asarray(u(t))[:, None], shift))[:, 0]
    inside = slice(REACH, -REACH)
    np.testing.assert_allclose(found[inside], u(t + shift)[inside], rtol=0, atol=PASS_BAND * size)


def test_a_straight_line_would_not_do():
    """Half way between samples of a fast sine, the chord misses by half of it."""
    t = np.arange(200)
    u = jnp.asarray(np.sin(2 * np.pi * 0.35 * t))[:, None]
    exact = np.sin(2 * np.pi * 0.35 * (t + 0.5))[REACH:-REACH]
    curved = np.asarray(band_limited(u, 0.5))[REACH:-REACH, 0]
    chord = 0.5 * np.asarray(u[REACH:-REACH] + u[REACH + 1 : -REACH + 1])[:, 0]
    assert np.abs(curved - exact).max() < PASS_BAND
    # cos(pi 0.35) of the sine is left in the middle of its chords: rounding
    np.testing.assert_allclose(chord, np.cos(np.pi * 0.35) * exact, rtol=0, atol=1e-12)


def test_a_constant_stays_one():
    found = np.asarray(band_limited(jnp.full((40, 1), 2.5), 0.3))
    np.testing.assert_allclose(found, 2.5, rtol=1e-14)  # rounding: the taps sum to one


def test_holds_by_hand():
    """Two substeps, so five stages at 0, 1/4, 1/2, 3/4 and 1 of a step."""
    signals = plant(MIXED).signals
    u = np.zeros((30, 3))
    u[:, 0] = u[:, 1] = np.arange(30.0) ** 2
    u[:, 2] = 1.0
    found = np.asarray(intersample(signals, jnp.asarray(u), 2))
    assert found.shape == (30, 5, 3)
    np.testing.assert_array_equal(found[3, :, 0], [9, 9, 9, 9, 9])
    np.testing.assert_array_equal(found[3, :, 1], [9, 10.75, 12.5, 14.25, 16])
    np.testing.assert_array_equal(found[-1, :, :2], np.full((5, 2), 29.0**2))  # nothing follows
    np.testing.assert_allclose(found[:, :, 2], 1.0, rtol=1e-14)


def test_the_ends_of_a_step_are_the_samples():
    u, _ = multisine(5)
    columns = jnp.asarray(np.stack([u(np.arange(60))] * 3, axis=1))
    found = np.asarray(intersample(plant(MIXED).signals, columns, 3))
    np.testing.assert_array_equal(found[:, 0], columns)
    np.testing.assert_allclose(
        found[:-1, -1, 1:], columns[1:, 1:], rtol=0, atol=1e-14
    )  # a + (b - a)
    np.testing.assert_array_equal(found[:, -1, 0], columns[:, 0])


def test_line_needs_no_future():
    """Online only the next sample is known: a band-limited input runs straight."""
    found = np.asarray(
        line(plant(MIXED).signals, jnp.array([1.0, 1.0, 1.0]), jnp.array([3.0, 3.0, 3.0]), 1)
    )
    np.testing.assert_array_equal(found, [[1, 1, 1], [1, 2, 2], [1, 3, 3]])


def stepped(model, stages, substeps, dt):
    return float(
        step_through(
            model,
            jnp.array([0.4]),
            jnp.asarray(stages)[:, None],
            jnp.zeros(0),
            jnp.asarray(dt),
            substeps,
        )[0]
    )


def test_a_held_step_is_the_closed_form():
    # x' = 3 u - 2 x under u = 0.5, 0.1 s in four substeps; (2 * 0.025)^5 / 120 a step = 3e-9
    exact = 0.75 + (0.4 - 0.75) * np.exp(-0.2)
    found = stepped(plant(LAG.replace("HOLD", "zero")), np.full(9, 0.5), 4, 0.1)
    assert found == pytest.approx(exact, abs=1e-8)


def test_a_ramp_is_the_closed_form():
    # u = 0.5 + 4 t: x = A + B t + (0.4 - A) exp(-2 t) with B = 6 and A = (1.5 - 6) / 2
    exact = -2.25 + 6 * 0.1 + 2.65 * np.exp(-0.2)
    found = stepped(plant(LAG.replace("HOLD", "linear")), np.linspace(0.5, 0.9, 9), 4, 0.1)
    assert found == pytest.approx(exact, abs=5e-8)  # as above, its larger transient


@pytest.mark.parametrize(("hold", "bound"), [("band-limited", 1e-4), ("linear", None)])
def test_a_sampled_multisine_drives_the_plant_as_the_continuous_one(hold, bound):
    u, size = multisine(1, highest=0.3)
    step, count = 0.2, 200
    # the filter needs samples before the first: start the plant where it has them
    reference = solve_ivp(
        lambda t, x: 3 * u(t / step) - 2 * x,
        (REACH * step, (count - 1) * step),
        [0.3],
        t_eval=step * np.arange(REACH, count),
        rtol=1e-9,
        atol=1e-11,
        max_step=step / 2,
    ).y[0]
    model = plant(LAG.replace("HOLD", hold))
    stages = intersample(model.signals, jnp.asarray(u(np.arange(count)))[:, None], 4)[REACH:]
    dt = jnp.full(count - REACH, step)
    f = jnp.zeros((count - REACH, 0))
    found = simulate_through(model, jnp.array([0.3]), stages, dt, f, 4).y[:, 0]
    error = np.abs(np.asarray(found) - reference)[:-REACH].max()
    gain = 1.5  # of the plant at frequency 0: the error of the input is seen at most so large
    if bound is not None:
        # RK4 on tones of 0.3 a sample in quarters: (2 pi 0.3 / 4)^4 / 2880 = 2e-5
        assert error < gain * size * (bound + 2e-5)
    else:
        assert error > 10 * gain * size * (1e-4 + 2e-5)
