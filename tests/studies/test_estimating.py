"""How estimates are judged, and the filters beside them, against arithmetic and SciPy."""

import numpy as np
import pytest

from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.satellite.observatory import run
from faultgauge.simulation.schedules import inject, truth
from faultgauge_studies.paper import estimating, severity
from faultgauge_studies.paper.cases import CASES, PHYSICAL
from faultgauge_studies.paper.learning import beside, rms, scores

DT = 0.25
T = DT * np.arange(4000)
RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def eso():
    grid = np.linspace(-130.0, 130.0, 27)[:, None]
    return estimating.design(load_plant("reaction_wheel"), OperatingPoints(grid, 0 * grid))


def test_the_faults_are_eqs_17_and_19():
    t = np.array([499.75, 500.0, 599.75, 600.0, 699.75, 700.0, 799.75, 800.0, 999.75])
    d1 = [0.0, 0.1, 0.1, 0.15, 0.15, 0.2, 0.2, 0.0, 0.0]
    np.testing.assert_array_equal(truth(CASES["mode1_intermittent"].fault, t), d1)
    t = np.array([499.75, 500.0, 549.75, 550.0, 600.0, 649.75, 650.0, 999.75])
    d2 = [np.nan, 0.05, 0.05, 0.08, 0.1, 0.1, 0.0, 0.0]  # a dead output at the end, not a free one
    np.testing.assert_array_equal(truth(CASES["mode2_intermittent"].fault, t), d2)


def test_eq_18_overwrites_the_output_and_the_text_the_derivative():
    signals, t = load_plant("reaction_wheel").signals, np.array([400.0, 600.0])
    written = inject([CASES["mode2_sustained"].fault], signals, t).stuck
    said = inject([PHYSICAL.fault], signals, t).stuck
    np.testing.assert_array_equal(written.y[:, 0], [np.nan, 0.1])
    np.testing.assert_array_equal(written.dx[:, 0], [np.nan, np.nan])
    np.testing.assert_array_equal(said.dx[:, 0], [np.nan, 0.1])
    np.testing.assert_array_equal(said.y[:, 0], [np.nan, np.nan])


def test_quality_by_hand():
    case = CASES["mode1_intermittent"]
    d = truth(case.fault, T)
    f = d.copy()
    f[T < 500] = 7.0  # before the onset nothing counts
    f[(T >= 500) & (T < 510)] = 0.09  # 10 % off for 10 s
    f[(T >= 600) & (T < 612)] = 0.155  # 10 % of the jump of 0.05 beyond, for 12 s
    f[(T >= 900)] += 0.001
    found = estimating.quality(case, T, f, d)
    assert found.settling_s == 12.0
    assert found.overshoot == pytest.approx(0.1)
    # scored: 500 s less 50 s after each of four jumps = 300 s, of which 100 s are off by 1 mN*m
    assert found.rmse == pytest.approx(1e-3 / np.sqrt(3), rel=1e-9)


def test_what_never_settles_says_so():
    case = CASES["mode1_sustained"]
    d = truth(case.fault, T)
    assert estimating.quality(case, T, 0.9 * d, d).settling_s == np.inf


def test_scored_samples_are_50_s_from_every_jump():
    chosen = T[estimating.scored(CASES["mode1_intermittent"], T)]
    for start, end in ((550, 600), (650, 700), (750, 800), (850, 1000)):
        assert np.sum((chosen >= start) & (chosen < end)) == (end - start) / DT
    assert len(chosen) == 300 / DT


def filtered(gain_x, gain_f, h):
    """fhat of the current-form observer of h(k+1) = h(k) + dt f, written out."""
    x, f, found = 0.0, 0.0, []
    for measured in h:
        x += DT * f
        e = x - measured
        x, f = x - gain_x * e, f - gain_f * e
        found.append(f)
    return np.array(found)


def test_noise_gain_is_what_noise_does(eso):
    gain_x, gain_f = float(eso.gain_x[0, 1]), float(eso.gain_f[1])
    found = estimating.noise_gain(gain_x, gain_f, DT)
    noise = RNG.standard_normal(400_000)
    # 400,000 samples, correlated over 1/omega_o = 20 of them: 1 % standard deviation of the sd
    assert np.std(filtered(gain_x, gain_f, noise)[2000:]) == pytest.approx(found, rel=0.03)
    # sd = sqrt(T_s omega_o^3 / 4) for slow poles with zeta = 1; omega_o T_s = 0.05 here
    assert found == pytest.approx(np.sqrt(DT * 0.2**3 / 4), rel=0.05)


def test_the_kalman_filter_has_the_same_noise_gain_and_is_one(eso):
    sigma = 0.05
    kalman = estimating.kalman_at_equal_noise(eso, sigma)
    K = np.array([float(kalman.gain_x[0, 1]), float(kalman.gain_f[1])])
    own = estimating.noise_gain(float(eso.gain_x[0, 1]), float(eso.gain_f[1]), DT)
    assert estimating.noise_gain(*K, DT) == pytest.approx(own, rel=1e-6)  # a bisection's end
    # a Kalman filter: some walk q makes the Riccati recursion end at these gains
    A, C = np.array([[1.0, DT], [0.0, 1.0]]), np.array([[1.0, 0.0]])

    def end(q):
        P = np.eye(2)
        for _ in range(20_000):
            P = A @ P @ A.T + np.diag([0.0, q])
            G = P @ C.T / (C @ P @ C.T + sigma**2)
            P = (np.eye(2) - G @ C) @ P
        return G[:, 0]

    # f's gain is near sqrt(q)/sigma for slow filters: two corrections find q
    q = (K[1] * sigma) ** 2
    for _ in range(4):
        q *= (K[1] / end(q)[1]) ** 2
    np.testing.assert_allclose(end(q), K, rtol=1e-4)  # of four corrections


def test_cramer_rao_is_the_spread_of_straight_lines():
    t = DT * np.arange(200)
    slopes = [np.polyfit(t, 0.05 * RNG.standard_normal(200), 1)[0] for _ in range(4000)]
    # the sd of 4000 draws is known to 1/sqrt(8000) = 1.1 %
    assert np.std(slopes) == pytest.approx(estimating.cramer_rao(0.05), rel=0.05)


def test_means_jumps_and_growth_by_hand():
    r = np.where(T >= 500, 0.1 + (T - 500) * 1e-3, 0.0)
    case = CASES["mode1_sustained"]
    assert severity.jumps(case, r) == {"500s": pytest.approx(0.1)}
    # means over [500, 520) and [590, 610): 0.1 + 0.010 and 0.1 + 0.100, less half a sample
    assert severity.growth(r) == pytest.approx(0.199875 / 0.109875)
    seen = severity.channels_at({"r": r, "still": 0 * T})
    assert seen == {"r": pytest.approx(0.199875), "still": 0.0}


def test_the_true_wheel_runs_beside_itself():
    wheel = load_plant("reaction_wheel")
    flown = run(wheel, 1000.0, 0)
    free = beside(wheel, flown)
    # the same RK4 steps under the same held command: rounding over 20,000 steps of momenta of 100
    np.testing.assert_allclose(free.x[:, 0], flown.momentum[:, 1], rtol=0, atol=1e-9)
    known = beside(wheel, flown, "measured")
    np.testing.assert_allclose(known.y[:, 0], flown.torque[:, 1], rtol=0, atol=1e-12)
    off = free._replace(y=free.y + 0.01, x=free.x + 1.0)
    found = scores(off, flown)
    torque, momentum = flown.torque[:, 1], flown.momentum[:, 1]
    assert found.rmse == pytest.approx(0.01, rel=1e-6)
    assert found.r2 == pytest.approx(1 - 0.01**2 / np.var(torque), rel=1e-6)
    assert found.r2_h == pytest.approx(1 - 1 / np.var(momentum), rel=1e-6)


def test_rms_by_hand():
    assert rms(np.array([3.0, -4.0])) == pytest.approx(np.sqrt(12.5))
