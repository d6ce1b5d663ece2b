"""The paper's estimator and how it is judged, against simulated noise, polyfit and arithmetic."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.schedules import Constant, Schedule, truth
from faultgauge_studies.paper.cases import CASES, Case
from faultgauge_studies.paper.estimating import (
    cramer_rao,
    design,
    estimate,
    kalman_at_equal_noise,
    noise_gain,
    quality,
)

DT = 0.25  # s
EQ_17 = CASES["mode1_intermittent"]
PLANT = """
name = "body"
states.h.derivative = "u"
inputs.u.unit = "N*m"
outputs.T.value = "d(h)"
outputs.hm.value = "h"
faults.friction = { enters = "state", target = "h" }
"""
GAIN_X, GAIN_F = 0.1, 0.01  # of no design: any stable pair


@pytest.fixture(scope="module")
def observer():
    """The paper's, over a wheel without friction."""
    plant = GrayBoxPlant.untrained(parse_plant(PLANT, "body"))
    return design(plant, OperatingPoints(np.zeros((1, 1)), np.zeros((1, 1))))


def gains(omega, zeta):
    """Of real poles p, q: their product is 1 - gain_x, and (1 - p)(1 - q) is gain_f dt."""
    split = np.sqrt(zeta**2 - 1)
    p, q = np.exp(-omega * DT * np.array([zeta - split, zeta + split]))
    return 1 - p * q, (1 - p) * (1 - q) / DT


def by_hand(gain_x, gain_f, h, u, delta):
    """(fhat, e): predict by the last command and fhat, correct by e or its square root (12)."""
    x, f, found, errors = h[0], 0.0 * h[0], [], []
    for k, now in enumerate(h):
        x = x + (DT * (u[k - 1] + f) if k else 0.0)
        e = x - now
        bent = np.sign(e) * np.sqrt(delta * abs(e)) if abs(e) > delta else e
        x, f = x - gain_x * e, f - gain_f * bent
        found.append(f)
        errors.append(e)
    return np.array(found), np.array(errors)


def flight(u, f, start=40.0):
    """Telemetry of a frictionless pitch wheel; the other axes and its torque are not known."""
    h = start + DT * np.concatenate([[0.0], np.cumsum(u + f)[:-1]])
    unknown = np.full(len(u), np.nan)

    def pitch(x):
        return np.stack([unknown, x, unknown], axis=1)

    t = DT * np.arange(len(u))
    no = np.full((len(u), 3), np.nan)
    return Telemetry(t, pitch(u), no, pitch(h), no, no, no, unknown), h


@pytest.mark.parametrize("size", [0.2, 5.0])
def test_the_estimate_is_the_recursion_by_hand(observer, size):
    """0.2 N*m, the greatest jump of eq (17), stays in the linear zone; 5 N*m leaves it."""
    rng = np.random.default_rng(1)
    u, noise = rng.normal(0, 0.1, 600), rng.normal(0, 0.005, 600)
    flown, h = flight(u, np.where(np.arange(600) < 200, 0.0, size))
    wanted, e = by_hand(*gains(0.2, 1.01), h + noise, u, 0.4)
    assert (abs(e).max() > 0.4) == (size == 5.0)
    # poles at 1.01 are placed through (z - p)(z - q), which loses 1e-12 to cancellation of 1 - p
    np.testing.assert_allclose(estimate(observer, flown, noise), wanted, rtol=0, atol=1e-9)


def test_noise_gain_is_that_of_the_continuous_observer_for_short_periods():
    """sd = sigma_h sqrt(T omega^3/4) for zeta = 1: white noise through omega^2 s/(s + omega)^2."""
    ratios = np.array(
        [noise_gain(*gains(w, 1.0), DT) / np.sqrt(DT * w**3 / 4) for w in (0.08, 0.04, 0.02)]
    )
    # what is left is of the second order in omega T = 0.02: halving it leaves a quarter
    assert abs(ratios[0] - 1) < 0.02**2
    np.testing.assert_allclose((ratios - 1)[:-1] / (ratios - 1)[1:], 4.0, rtol=0.01)


def through_noise(gain_x, gain_f):
    """sd(fhat) per sd of white noise: root of the sum of squares of the response to one sample."""
    impulse = np.zeros(6000)
    impulse[1] = 1.0  # not the first, which is where the observer starts
    return np.sqrt(np.sum(by_hand(gain_x, gain_f, impulse, np.zeros(6000), np.inf)[0] ** 2))


def riccati(walk):
    """Gains for unit noise in h where f walks by variance `walk` a sample: iterated to rest."""
    A, P = np.array([[1.0, DT], [0.0, 1.0]]), np.eye(2)
    for _ in range(1500):
        P = A @ P @ A.T + np.diag([0.0, walk])
        gain = P[:, 0] / (P[0, 0] + 1)
        P = P - np.outer(gain, P[0])
    return float(gain[0]), float(gain[1])


def test_the_kalman_filter_has_the_observers_noise_gain(observer):
    kalman = kalman_at_equal_noise(observer, 0.05)
    found = float(kalman.gain_x[0, 1]), float(kalman.gain_f[1])
    before = float(observer.gain_x[0, 1]), float(observer.gain_f[1])
    wanted = through_noise(*before)
    # responses die out as e^(-0.14 * 1500 s): sums are exact to rounding of 6000 terms
    assert noise_gain(*before, DT) == pytest.approx(wanted, rel=1e-9)
    assert through_noise(*found) == pytest.approx(wanted, rel=1e-6)  # 80 halvings, and SciPy's
    assert found[0] < before[0]  # it is the less damped of the two
    # only the walk's ratio to the noise matters, so gains for unit noise are gains for all
    walk = np.exp(brentq(lambda q: through_noise(*riccati(np.exp(q))) - wanted, -14, -4))
    np.testing.assert_allclose(found, riccati(walk), rtol=1e-6)  # a root of each
    assert not kalman.gain_x[0, 0]
    assert not kalman.gain_f[0]


def test_the_kalman_filter_is_linear_everywhere(observer):
    kalman = kalman_at_equal_noise(observer, 0.05)
    flown, h = flight(np.zeros(400), np.where(np.arange(400) < 100, 0.0, 5.0))
    wanted, e = by_hand(
        float(kalman.gain_x[0, 1]), float(kalman.gain_f[1]), h, np.zeros(400), np.inf
    )
    assert abs(e).max() > 0.4  # where the paper's observer is not
    # (1e9)^(1/2) and back: a few roundings of 5 N*m
    np.testing.assert_allclose(estimate(kalman, flown), wanted, rtol=0, atol=1e-9)


@pytest.mark.parametrize("window", [10.0, 50.0])
def test_the_bound_is_the_spread_of_a_fitted_slope(window):
    t, sigma = DT * np.arange(round(window / DT)), 0.05
    draws = np.random.default_rng(3).normal(40.0, sigma, (20000, len(t)))
    slopes = np.polyfit(t, draws.T, 1)[0]
    # the sd of 20,000 draws is known to 1/sqrt(40,000) = 0.5 %: four of that
    assert cramer_rao(sigma, window) == pytest.approx(slopes.std(), rel=0.02)
    exact = np.polyfit(t, draws[0], 1, cov="unscaled")[1][0, 0]
    assert cramer_rao(sigma, window) == pytest.approx(sigma * np.sqrt(exact), rel=1e-9)


def made_up(change):
    """(t, fhat, d): `change(tau, k)` is the error tau s after jump k as a share of the jump."""
    t = DT * np.arange(4000)
    d = truth(EQ_17.fault, t)
    f = np.full(4000, 5.0)  # before the first jump nothing is judged
    edges = [*EQ_17.jumps, 1000.0]
    for k, jump in enumerate((0.1, 0.05, 0.05, -0.2)):
        here = (t >= edges[k]) & (t < edges[k + 1])
        f[here] = d[here] + jump * change(t[here] - edges[k], k)
    return t, f, d


def answer(tau, k):
    """Nothing for 10 s, 20 % too much until 20 s (of the third: 30 % until 35 s), then 4 %."""
    over, until = (0.3, 35) if k == 2 else (0.2, 20)
    return np.select([tau < 10, tau < until], [-1.0, over], 0.04)


def test_quality_by_hand():
    found = quality(EQ_17, *made_up(answer))
    assert found.settling_s == 35.0  # times of a binary grid are exact
    assert found.overshoot == pytest.approx(0.3, abs=1e-12)  # roundings of sizes of 0.05
    # 4 % of every jump; 50 s, 50 s, 50 s and 150 s of them are scored
    wanted = 0.04 * np.sqrt((50 * (0.1**2 + 2 * 0.05**2) + 150 * 0.2**2) / 300)
    assert found.rmse == pytest.approx(wanted, rel=1e-12)


def test_an_answer_that_never_settles():
    found = quality(
        EQ_17, *made_up(lambda tau, k: np.where((k == 1) & (tau == 99.75), -0.06, answer(tau, k)))
    )
    assert found.settling_s == np.inf
    assert found.overshoot == pytest.approx(0.3, abs=1e-12)


def test_what_comes_late_is_no_overshoot_but_is_not_settled():
    late = made_up(lambda tau, k: np.where((tau >= 50) & (tau < 60), 0.5, 0.0))
    found = quality(EQ_17, *late)
    assert found.overshoot == 0.0
    assert found.settling_s == 60.0


def test_one_jump_answered_at_once():
    case = Case("", Schedule("d", "state", "h", Constant(0.1, 500.0)), 1000.0, (500.0,))
    t = DT * np.arange(4000)
    d = truth(case.fault, t)
    assert quality(case, t, d, d) == (0.0, 0.0, 0.0)
    assert quality(case, t, 0.96 * d, d).settling_s == 0.0  # 4 % short: inside from the start
    assert quality(case, t, 0.94 * d, d).settling_s == np.inf
    assert quality(case, t, 0.94 * d, d).overshoot == 0.0


def test_the_design_is_closed_on_momentum_alone(observer):
    np.testing.assert_allclose(
        [float(observer.gain_x[0, 1]), float(observer.gain_f[1])], gains(0.2, 1.01), rtol=1e-9
    )  # 1 - p is 0.05: cancellation leaves 1e-14 of it, squared and divided by 0.25
    assert not jnp.any(observer.gain_x[:, 0])
    assert not observer.gain_f[0]
