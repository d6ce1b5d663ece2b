"""The Kalman filter against exact motion, Riccati's equation and the chi-square distribution."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from faultgauge.simulation.satellite.determination import AttitudeEstimate, AttitudeFilter
from faultgauge.simulation.satellite.sensors import Direction, EarthSensor, SunSensors

DT = 0.25
FILTER = AttitudeFilter(arw=1e-5, rrw=1e-7)
EARTH, SUN = EarthSensor(), SunSensors()
NADIR, SUNWARD = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
# Slow enough that both stay within 0.1 rad of their boresights, where the sensors' noise is the
# filter's: equal across the direction.
RATE = np.array([3e-4, -5e-4, 4e-4])
STEPS = 800
LATER = DT * np.arange(1, STEPS + 1)
TRUTH = Rotation.from_rotvec(LATER[:, None] * RATE)  # exact: the rate is constant in body axes


def directions(rotation):
    """Nadir and the Sun in the axes of a body so turned."""
    return [jnp.asarray(rotation.inv().apply(v)) for v in (NADIR, SUNWARD)]


def follow(begin, increments, nadirs, suns, noise):
    """The estimate after every sample."""

    def sample(estimate, now):
        increment, nadir, sun, noise = now
        estimate = FILTER.propagate(estimate, increment, DT)
        earth = EARTH.measure(nadir, noise[:2])
        estimate = FILTER.correct(estimate, earth, jnp.asarray(NADIR), EARTH.sigma)
        head = SUN.measure(sun, jnp.asarray(True), noise[2:])
        estimate = FILTER.correct(estimate, head, jnp.asarray(SUNWARD), SUN.sigma)
        return estimate, estimate

    return jax.lax.scan(sample, begin, (increments, nadirs, suns, noise))[1]


FOLLOW = jax.jit(follow)


def believed(error, bias, spread):
    """An estimate that is off by the rotation `error`, with standard deviations `spread`."""
    q = Rotation.from_rotvec(error).as_quat(scalar_first=True)
    return AttitudeEstimate(
        jnp.asarray(q), jnp.asarray(bias), jnp.diag(jnp.asarray(spread) ** 2), jnp.zeros(3)
    )


def attitude_error(q, truth):
    """The rotation vector from the estimate to the truth, in body axes."""
    return (Rotation.from_quat(np.asarray(q), scalar_first=True).inv() * truth).as_rotvec()


SPREAD = np.repeat([0.05, 5e-5], 3)
BIAS = np.array([5e-5, -3e-5, 4e-5])
# 1/s: the slower root of s^2 + a s + w^2, w^2 = rrw/r, a^2 = arw^2/r^2 + 2 w^2, where
# r = 5e-4 rad * sqrt(0.25 s) is the earth sensor's noise
SLOWEST = 0.0104


@pytest.fixture(scope="module")
def without_noise():
    """The gyro is off by BIAS; the filter starts 0.06 rad off and knows of no bias."""
    increments = jnp.asarray(np.tile((RATE + BIAS) * DT, (STEPS, 1)))
    begin = believed([0.04, -0.03, 0.035], np.zeros(3), SPREAD)
    found = FOLLOW(begin, increments, *directions(TRUTH), jnp.zeros((STEPS, 4)))
    return jax.device_get(found)


def test_converges_onto_a_wrong_start(without_noise):
    """What the linear filter leaves out of the first turn, 0.04 * 0.03/2 rad, is about one of its
    standard deviations then; it dies away as exp(-SLOWEST t), over 200 s to 0.125."""
    left = attitude_error(without_noise.q, TRUTH)
    sigma = np.sqrt(np.diagonal(without_noise.covariance, axis1=1, axis2=2))
    assert np.linalg.norm(left[-1]) < 0.125 * sigma[-1, :3].max()
    assert np.abs(without_noise.bias[-1] - BIAS).max() < 0.125 * sigma[-1, 3:].max()
    # the rate is the gyro's less the bias, to rounding of the increment
    np.testing.assert_allclose(
        without_noise.rate[-1], RATE + BIAS - without_noise.bias[-1], rtol=0, atol=1e-15
    )


def test_bias_is_what_turns_the_gyro_away(without_noise):
    """With its sign, to 0.125 of the standard deviation 1.1e-6 rad/s: half a percent."""
    np.testing.assert_allclose(without_noise.bias[-1], BIAS, rtol=0.005)


def test_covariance_solves_riccatis_equation():
    """At rest the axes part: x is seen by the earth sensor, z by the sun's, y by both."""
    begin = believed(np.zeros(3), np.zeros(3), np.repeat([1e-4, 1e-6], 3))
    seen = directions(Rotation.from_rotvec(np.zeros((STEPS, 3))))
    quiet = jnp.zeros((STEPS, 3)), *seen, jnp.zeros((STEPS, 4))
    half = jax.tree.map(lambda a: a[-1], FOLLOW(begin, *quiet))
    still = FOLLOW(half, *quiet)
    found = np.array(still.covariance[-1])
    A, H = np.array([[1.0, -DT], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    Q = DT * np.diag([FILTER.arw**2, FILTER.rrw**2])
    precision = np.array([EARTH.sigma**-2, EARTH.sigma**-2 + SUN.sigma**-2, SUN.sigma**-2])
    for axis, information in enumerate(precision):
        R = np.array([[1 / information]])
        before = solve_discrete_are(A.T, H.T, Q, R)
        after = before - before @ H.T @ np.linalg.solve(H @ before @ H.T + R, H @ before)
        part = found[axis::3, axis::3]
        # errors die away as exp(-SLOWEST t), their squares over 400 s to 2.4e-4
        np.testing.assert_allclose(part, after, rtol=5e-4)
        found[axis::3, axis::3] = 0
    assert np.abs(found).max() < 1e-22  # rounding of 3e-9: nothing couples the axes


def test_error_is_what_the_covariance_says():
    """Normalised estimation error squared, averaged over 200 runs, is chi-square with 6 degrees
    of freedom per run; so are the attitude and the bias alone with 3."""
    runs, rng = 200, np.random.default_rng(0)
    spread = np.repeat([2e-3, 2e-5], 3)  # 2e-3 rad: its square is well below the sensors' noise
    first = spread * rng.standard_normal((runs, 6))
    walk = rng.standard_normal((runs, STEPS, 3))
    bias = FILTER.rrw * np.sqrt(DT) * np.cumsum(walk, axis=1)
    bias = np.concatenate([np.zeros((runs, 1, 3)), bias], axis=1) + first[:, None, 3:]
    increments = (RATE + bias[:, :-1]) * DT
    increments += FILTER.arw * np.sqrt(DT) * rng.standard_normal((runs, STEPS, 3))
    noise = rng.standard_normal((runs, STEPS, 4))

    def last(q, increments, noise):
        begin = believed(np.zeros(3), np.zeros(3), spread)._replace(q=q)
        return jax.tree.map(lambda a: a[-1], follow(begin, increments, *directions(TRUTH), noise))

    starts = Rotation.from_rotvec(-first[:, :3]).as_quat(scalar_first=True)
    found = jax.jit(jax.vmap(last))(*map(jnp.asarray, (starts, increments, noise)))
    errors = np.concatenate([attitude_error(found.q, TRUTH[-1]), bias[:, -1] - found.bias], axis=1)
    P = np.asarray(found.covariance)
    for part in (slice(0, 6), slice(0, 3), slice(3, 6)):
        e, p = errors[:, part], P[:, part, part]
        nees = np.einsum("ni,ni->n", e, np.linalg.solve(p, e[..., None])[..., 0])
        low, high = chi2.interval(0.999, runs * e.shape[1])
        assert low < nees.sum() < high
    # no part leans to one side: a mean of 200 is within 4/sqrt(200) of its standard deviation
    assert np.abs(errors.mean(0) / errors.std(0)).max() < 0.285


def test_what_is_not_seen_changes_nothing():
    begin = believed([0.04, -0.03, 0.035], BIAS, SPREAD)
    blind = Direction(jnp.asarray(SUNWARD), jnp.asarray(False))
    after = FILTER.correct(begin, blind, jnp.asarray(SUNWARD), SUN.sigma)
    for a, b in zip(begin, after, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-15)  # normalised again


def test_one_direction_says_nothing_of_the_turn_about_it():
    begin = believed(np.zeros(3), np.zeros(3), SPREAD)
    seen = Direction(jnp.asarray(SUNWARD), jnp.asarray(True))
    after = FILTER.correct(begin, seen, jnp.asarray(SUNWARD), SUN.sigma)
    sigma = np.sqrt(np.diag(after.covariance))
    # of two readings, one of 0.05 rad and one of 3e-4, the second counts (0.006^2/2 apart)
    np.testing.assert_allclose(sigma[:3], [0.05, SUN.sigma, SUN.sigma], rtol=2e-5)


def test_uncertainty_turns_with_the_body():
    """Between samples the error stands still in inertial axes, so in body axes it turns back; an
    error in bias drifts into it against its sign; the gyro's noise is added."""
    turn, attitude = np.array([0.0, 0.0, 0.1]), np.diag([1e-4, 4e-4, 9e-4])
    begin = believed(np.zeros(3), np.zeros(3), np.array([1e-2, 2e-2, 3e-2, 1e-2, 2e-2, 3e-2]))
    found = np.asarray(FILTER.propagate(begin, jnp.asarray(turn), DT).covariance)
    back = Rotation.from_rotvec(turn).inv().as_matrix()
    gyro = np.diag(np.full(3, FILTER.arw**2 * DT))
    expected = back @ attitude @ back.T + DT**2 * attitude + gyro
    # the turn's cube is left out, 0.1^3/6 = 1.7e-4 of 9e-4 rad^2, twice
    np.testing.assert_allclose(found[:3, :3], expected, rtol=0, atol=3.1e-7)
    np.testing.assert_allclose(found[:3, 3:], -DT * attitude, rtol=0, atol=1e-18)  # rounding
    assert abs(expected[0, 1]) > 2e-5  # the turn shows


def test_a_corrected_bias_corrects_the_rate():
    """What the gyro said stands: rate and bias always add up to it."""
    increment = np.array([1e-5, -2e-4, 3e-5])
    begin = believed(np.zeros(3), BIAS, SPREAD)._replace(
        covariance=jnp.asarray(np.diag(SPREAD**2) + 1e-6 * (1 - np.eye(6)))
    )
    turned = FILTER.propagate(begin, jnp.asarray(increment), DT)
    seen = Direction(jnp.asarray([0.28, 0.0, 0.96]), jnp.asarray(True))
    after = FILTER.correct(turned, seen, jnp.asarray(NADIR), EARTH.sigma)
    assert np.abs(after.bias - turned.bias).max() > 1e-9
    np.testing.assert_allclose(after.rate + after.bias, increment / DT, atol=1e-12)  # rounding
