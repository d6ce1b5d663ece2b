"""Derivatives under a piecewise-constant input, against closed forms and Savitzky-Golay."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from faultgauge.telemetry.derivatives import Kernel, choose_kernel, noise_sd

STEP = 0.1
KERNELS = [Kernel(2, 1), Kernel(1, 2), Kernel(2, 4), Kernel(3, 6), Kernel(2, 25)]


def staircase(count=400, seed=0):
    """An input that jumps at every third sample."""
    return np.repeat(np.random.default_rng(seed).uniform(-1, 1, count // 3 + 1), 3)[:count]


def integral(u):
    """x' = u under a zero-order hold, sampled: exact."""
    return 0.5 + STEP * np.concatenate([[0.0], np.cumsum(u[:-1])])


@pytest.mark.parametrize("kernel", KERNELS, ids=str)
def test_no_bias_where_the_input_jumps(kernel):
    u = staircase()
    slope = kernel.smooth(integral(u), STEP, derivative=1)
    mean = kernel.smooth(u, STEP, held=True)
    # rounding only: x is about 5, divided by a step of 0.1 or more
    np.testing.assert_allclose(slope, mean, rtol=0, atol=1e-12)


@pytest.mark.parametrize("width", [1, 4, 15])
def test_no_bias_through_two_integrators(width):
    """q'' = u: the second difference of q is the input's mean over the same kernel."""
    u = staircase()
    v = integral(u)
    q = np.concatenate([[0.0], np.cumsum(STEP * v[:-1] + STEP**2 / 2 * u[:-1])])
    kernel = Kernel(2, width)
    curvature = kernel.smooth(q, STEP, derivative=2)
    # rounding of q (about 100, so 1e-14) over the square of a window of 0.1 s or more, times 4
    np.testing.assert_allclose(curvature, kernel.smooth(u, STEP, held=True), rtol=0, atol=1e-11)


def first_order(rate, u):
    """x' = -rate x + u under a zero-order hold, sampled: exact."""
    x, decay = np.zeros(len(u)), np.exp(-rate * STEP)
    for k in range(len(u) - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / rate * u[k]
    return x


def test_savitzky_golay_is_biased_on_the_same_data_and_this_is_not():
    rate, u = 0.5, staircase()
    x = first_order(rate, u)
    kernel = Kernel(2, 4)
    ours = kernel.smooth(x, STEP, derivative=1) - (
        kernel.smooth(u, STEP, held=True) - rate * kernel.smooth(x, STEP)
    )
    # What is left is the trapezoidal rule on x: at most step^2/12 max|x''|, and x'' = -rate x'.
    curvature = rate * np.max(np.abs(u - rate * x))
    assert np.max(np.abs(ours)) <= rate * STEP**2 / 12 * curvature
    savgol = savgol_filter(x, 9, 2, deriv=1, delta=STEP) - (u - rate * x)
    assert np.std(savgol) > 0.2 * np.std(u)  # a fifth of the signal, on data without any noise
    assert np.std(savgol) > 1000 * np.std(ours)


@pytest.mark.parametrize("kernel", KERNELS, ids=str)
def test_polynomials_at_the_kernels_centre(kernel):
    t = np.arange(200) * STEP
    centre = t[kernel.half : len(t) - kernel.half]
    # rounding: numbers up to 400, sums of up to 200 of them, a window of 0.1 s or more
    np.testing.assert_allclose(kernel.smooth(3 * t - 1, STEP), 3 * centre - 1, atol=1e-11)
    np.testing.assert_allclose(kernel.smooth(t**2, STEP, derivative=1), 2 * centre, atol=1e-10)
    if kernel.order >= 2:
        np.testing.assert_allclose(kernel.smooth(t**2, STEP, derivative=2), 2.0, atol=1e-9)


@pytest.mark.parametrize("derivative", [0, 1, 2])
@pytest.mark.parametrize("kernel", [Kernel(2, 1), Kernel(2, 5), Kernel(3, 8)], ids=str)
def test_noise_gain_is_what_white_noise_does(kernel, derivative):
    noise = np.random.default_rng(1).normal(size=100_000)
    seen = np.std(kernel.smooth(noise, STEP, derivative=derivative))
    # Neighbours within 2 half share their noise, so there are N / (2 half) draws or more; a
    # standard deviation from n draws has a relative error of 1 / sqrt(2 n), and 5 of these pass.
    error = 5 * np.sqrt(2 * kernel.half / (2 * len(noise)))
    assert seen == pytest.approx(kernel.noise_gain(derivative, STEP), rel=error)


def test_noise_gain_in_closed_form():
    n = 7
    slope, curvature = Kernel(1, 2 * n), Kernel(2, n)
    # (x1 - x0) / W and (x2 - 2 x1 + x0) / W^2 with independent x: sqrt(1 + 1), sqrt(1 + 4 + 1)
    assert slope.noise_gain(1, STEP) == pytest.approx(np.sqrt(2) / (2 * n * STEP), rel=1e-14)
    assert curvature.noise_gain(2, STEP) == pytest.approx(np.sqrt(6) / (n * STEP) ** 2, rel=1e-14)


@pytest.mark.parametrize("sigma", [1e-3, 0.05])
def test_noise_sd_of_white_noise_on_a_sine(sigma):
    t = np.arange(5000) * 0.01
    noisy = np.sin(2 * t) + sigma * np.random.default_rng(2).normal(size=len(t))
    # The median of 5000 correlated differences scatters by about 2 %; the sine's own third
    # difference (0.02^3 / sqrt(20) = 2e-6) adds nothing that shows.
    assert noise_sd(noisy) == pytest.approx(sigma, rel=0.1)


def test_noise_sd_does_not_see_jumps():
    noise = 0.01 * np.random.default_rng(3).normal(size=4000)
    steps = np.repeat(np.random.default_rng(4).uniform(-10, 10, 40), 100)
    assert noise_sd(noise + steps) == pytest.approx(0.01, rel=0.1)  # 3 % of the differences jump


def test_noise_sd_of_too_few_samples_is_zero():
    assert noise_sd(np.array([1.0, 5.0, -2.0, 3.0])) == 0.0


def slow(count=4000):
    return np.sin(2 * np.pi * np.arange(count) * STEP / 50)


def test_noise_free_signal_gets_the_narrowest_kernel():
    kernel = choose_kernel([slow()], STEP, 1, 0.0)
    assert (kernel.width, kernel.half) == (1, 1)


def test_kernel_is_just_wide_enough():
    sigma, x = 0.001, slow()
    kernel = choose_kernel([x], STEP, 1, sigma)
    spread = 2 * np.pi / 50 / np.sqrt(2)  # of the true derivative
    noise = sigma * np.random.default_rng(5).normal(size=len(x))
    assert np.std(kernel.smooth(noise, STEP, derivative=1)) < 0.011 * spread  # 10 %: noise draw
    # no narrower than needed: noise falls with the width, so half of it would not have done
    half = Kernel(kernel.order, kernel.width // 2)
    assert np.std(half.smooth(noise, STEP, derivative=1)) > 0.01 * spread


@pytest.mark.parametrize("derivative", [1, 2, 3])
@pytest.mark.parametrize("sigma", [0.0, 1e-3, 1.0])
@pytest.mark.parametrize("count", [16, 100, 4000])
def test_kernel_is_centred_and_leaves_most_of_the_record(count, sigma, derivative):
    kernel = choose_kernel([slow(count)], STEP, derivative, sigma)
    assert kernel.order * kernel.width % 2 == 0
    assert kernel.order >= derivative
    assert 2 * kernel.half <= max(4, count // 10)


def driven(noise: float) -> tuple[np.ndarray, np.ndarray]:
    """(an integrator's state with noise, its held broad-band input)."""
    rng = np.random.default_rng(3)
    u = rng.standard_normal(2000)
    x = np.concatenate([[0.0], np.cumsum(u[:-1] * STEP)])
    return x + noise * rng.standard_normal(2000), u


def test_what_an_input_does_is_no_noise():
    noise = 0.01 * STEP  # small beside what the input does in a step
    x, u = driven(noise)
    assert noise_sd(x) > 50 * noise
    # median absolute deviation of 2000 correlated third differences: 5 % standard deviation
    assert noise_sd(x, [u]) == pytest.approx(noise, rel=0.2)


def test_no_kernel_averages_the_excitation_away():
    x, u = driven(STEP)  # as large as what the input does
    wide = choose_kernel([x], STEP, 1, STEP)
    kept = choose_kernel([x], STEP, 1, STEP, [u])
    assert np.std(wide.smooth(u, STEP, held=True)) < 0.5 * np.std(u)
    narrowest = choose_kernel([x], STEP, 1, 0.0)
    assert kept == narrowest  # white input: already the next one would keep less than 95 %
