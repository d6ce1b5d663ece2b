"""Body and wheels against conservation laws and scipy's integrator."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from faultgauge.simulation.satellite.loop import NOISES, fly, start
from faultgauge.simulation.schedules import Constant, Schedule

INERTIA = np.array([3000.0, 2800.0, 2500.0])
MOMENTA = np.array([20.0, 40.0, -20.0])
SLEW = np.deg2rad([3.0, 64.0, -2.0])
PYRAMID = np.array([[1, -1, 1, -1], [1, 1, -1, -1], [1, 1, 1, 1]]) / np.sqrt(3)
SECONDS = range(0, 90, 10)
# RK4 of rates of at most 0.02 rad/s over steps of 0.05 s leaves 0.001^5/120 of 50 N*m*s a step:
# nothing. 1600 steps of rounding of 50 N*m*s, 7e-15 each, remain.
CONSERVED = 2e-11


def _total(state, axes):
    """Angular momentum of body and wheels in inertial axes, N*m*s."""
    body = INERTIA * np.asarray(state.omega) + axes @ np.asarray(state.h)
    return Rotation.from_quat(np.asarray(state.q), scalar_first=True).apply(body)


@pytest.fixture(scope="module")
def slew(build, conditions, parts, large_wheel, happening):
    """States every 10 s of a slew with noise, while one fault follows the other on pitch."""
    noise = np.random.default_rng(0).standard_normal((320, NOISES))
    wheel, during = conditions(large_wheel, 320, schedules=happening, faulty=1, noise=noise)
    satellite = build(wheel)
    states = [start(satellite, jnp.asarray(SLEW), jnp.asarray(MOMENTA), jnp.zeros(3))]
    for now in parts(during):
        states.append(fly(satellite, states[-1], now)[0])
    return dict(zip(SECONDS, states, strict=True))


@pytest.mark.parametrize(
    "until",
    SECONDS[1:-1],
    ids=["healthy", "healthy", "healthy", "friction", "command", "gain", "stuck"],
)
def test_momentum_is_conserved_by_all_that_happens_inside(slew, until):
    """Friction, and faults in the wheel: what it takes up is what the body feels."""
    eye = np.eye(3)
    before, after = _total(slew[until - 10], eye), _total(slew[until], eye)
    np.testing.assert_allclose(after, before, rtol=0, atol=CONSERVED)
    moved = np.abs(np.asarray(slew[until].h) - np.asarray(slew[until - 10].h))
    assert moved.max() > 0.5  # while some of it moves from wheel to body
    assert np.linalg.norm(slew[until].q) == pytest.approx(1, abs=1e-15)


def test_equation_18_makes_momentum_from_nothing(slew):
    """Its output is overwritten and its wheel is not: the body is turned by 0.1 N*m for 10 s that
    no wheel takes up, and feels nothing of what the wheel does take up."""
    made = _total(slew[80], np.eye(3)) - _total(slew[70], np.eye(3))
    wheel = float(slew[80].h[1] - slew[70].h[1]) - 0.1 * 10
    assert abs(wheel) > 2
    # the sum of pieces along the pitch axis while that turns by 0.02 rad/s * 10 s: at least the
    # cosine of it, 0.98
    assert 0.97 * abs(wheel) < np.linalg.norm(made) < (1 + 1e-9) * abs(wheel)


def test_momentum_is_conserved_on_a_pyramid_of_four(build, conditions, large_wheel):
    friction = Schedule("d", "state", "h", Constant(0.1, 2.0))
    wheel, during = conditions(large_wheel, 40, wheels=4, schedules=[friction], faulty=2)
    satellite = build(wheel, axes=PYRAMID)
    begin = start(satellite, jnp.asarray(SLEW), jnp.array([20.0, 30, -10, 5]), jnp.zeros(3))
    end, flown = fly(satellite, begin, during)
    before, after = _total(begin, PYRAMID), _total(end, PYRAMID)
    np.testing.assert_allclose(after, before, rtol=0, atol=CONSERVED)
    # all four turn the body back in pitch, two each way
    np.testing.assert_array_equal(np.sign(flown.u[0]), np.sign(PYRAMID[1]))


def _friction(speed):
    stribeck = 0.03 + (0.037 - 0.03) * np.exp(-((speed / 5) ** 2))
    return 2.5e-4 * speed + stribeck * np.tanh(speed)


def _body(omega, h, torque, outside):
    return (outside - torque - np.cross(omega, INERTIA * omega + h)) / INERTIA


def _attitude(q, omega):
    w, v = q[0], q[1:]
    return np.concatenate([[-v @ omega / 2], (w * omega + np.cross(v, omega)) / 2])


def test_motion_is_that_of_scipys_integrator(build, conditions, parts, large_wheel, happening):
    """The same commands, period by period, into a body and wheels written a second time: motors
    (never at their limits here), friction through zero speed, and torques from outside."""
    disturbance = np.array([[0.02, 0.01, -0.04], [1.0, 4.0, 2.0]])
    h = np.array([-2.0, 40.0, -3.0])
    wheel, during = conditions(large_wheel, 80, schedules=happening)
    during = during._replace(f=jnp.zeros_like(during.f))  # they come later; the unbalance is first
    satellite = build(wheel, disturbance=jnp.asarray(disturbance))
    begin = start(satellite, jnp.asarray(SLEW), jnp.asarray(h), jnp.zeros(3))
    middle, first = fly(satellite, begin, parts(during)[0])
    end, second = fly(satellite, middle, parts(during)[1])
    u, momentum = (np.concatenate([a, b]) for a, b in zip(first[1:4:2], second[1:4:2], strict=True))
    orbital = np.sqrt(3.986004418e14 / 6918137.0**3)

    def rates(t, x, u):
        omega, h = x[4:7], x[7:]
        taken = u - _friction(h / 0.84)
        outside = disturbance[0] + disturbance[1] * np.sin(orbital * t)
        return np.concatenate([_attitude(x[:4], omega), _body(omega, h, taken, outside), taken])

    # friction turns round within 2 s: RK4 errs by 0.05^4/120 = 5e-8 of its fifth derivative,
    # 0.5 N*m/s^4, for 1 s
    x = np.concatenate([begin.q, begin.omega, begin.h])
    for k, command in enumerate(u):
        np.testing.assert_allclose(momentum[k], x[7:], rtol=0, atol=3e-8)
        span = (0.25 * k, 0.25 * (k + 1))
        x = solve_ivp(rates, span, x, "DOP853", args=(command,), rtol=1e-10, atol=1e-13).y[:, -1]
    assert momentum[0, 0] < 0 < momentum[-1, 0]  # one went through zero speed
    np.testing.assert_allclose(end.omega, x[4:7], rtol=0, atol=1e-11)  # over 2500 kg*m^2
    np.testing.assert_allclose(end.q, x[:4], rtol=0, atol=1e-10)  # half of that for 20 s


@pytest.fixture(scope="module")
def tumble(build, conditions, ideal_wheel):
    """{substeps: (omega, q, h)} of a fast free gyrostat after 5 s, and scipy's."""
    locked = ideal_wheel("0*u")
    omega, h = np.array([0.6, -0.5, 0.4]), np.array([1500.0, -1000.0, 800.0])
    found = {}
    for substeps in (1, 2):
        satellite = build(locked, substeps=substeps)
        _, during = conditions(locked, 20, substeps=substeps)
        state = start(satellite, jnp.zeros(3), jnp.asarray(h), jnp.zeros(3))
        end, _ = fly(satellite, state._replace(omega=jnp.asarray(omega)), during)
        found[substeps] = np.concatenate([end.q, end.omega])

    def rates(_, x):
        return np.concatenate([_attitude(x[:4], x[4:]), _body(x[4:], h, 0.0, 0.0)])

    x0 = np.concatenate([state.q, omega])
    exact = solve_ivp(rates, (0, 5), x0, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return found, exact, omega


def test_integration_is_of_fourth_order(tumble):
    found, exact, _ = tumble
    for part in (slice(0, 4), slice(4, 7)):
        coarse, fine = (np.abs(found[s][part] - exact[part]).max() for s in (1, 2))
        assert fine > 1e-8  # well above the reference's own
        # 2^4, but for the next order: 0.25 s * 0.9 rad/s = 0.2
        assert coarse / fine == pytest.approx(16, rel=0.2)


def test_gyroscopic_torque_does_no_work(tumble):
    """A free gyrostat keeps its energy, so does this one to the order of its integrator."""
    found, _, omega = tumble

    def energy(rate):
        return INERTIA @ rate**2 / 2

    drift = [abs(energy(found[s][4:]) / energy(omega) - 1) for s in (1, 2)]
    assert np.abs(found[2][4:] - omega).max() > 0.1  # it does tumble
    assert drift[1] < 1e-5  # 40 steps of (0.125 s * 0.9 rad/s)^5 / 120
    assert drift[0] / drift[1] > 12  # 2^4 or, as energy often does, 2^5: no floor under it
