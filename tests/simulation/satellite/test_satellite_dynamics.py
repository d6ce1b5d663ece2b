"""Body and wheels against conservation laws and scipy's integrator."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.satellite.loop import NOISES, fly, start
from faultgauge.simulation.schedules import Constant, Schedule, Sine

INERTIA = np.array([3000.0, 2800.0, 2500.0])
MOMENTA = np.array([20.0, 40.0, -20.0])
SLEW = np.deg2rad([3.0, 64.0, -2.0])
PYRAMID = np.array([[1, -1, 1, -1], [1, 1, -1, -1], [1, 1, 1, 1]]) / np.sqrt(3)
PARTS, STEPS = 6, 40  # 60 s in parts of 10 s


@pytest.fixture(scope="module")
def wheel():
    return load_plant("reaction_wheel")


@pytest.fixture(scope="module")
def momenta(build, conditions, wheel):
    """Total angular momentum in inertial axes every 10 s of the slew, of `axes` with faults."""

    def found(schedules=(), axes=np.eye(3), h=MOMENTA):
        wheels = axes.shape[1]
        noise = np.random.default_rng(0).standard_normal((PARTS * STEPS, NOISES))
        named, during = conditions(
            wheel, PARTS * STEPS, wheels=wheels, schedules=schedules, faulty=1, noise=noise
        )
        satellite = build(named, axes=axes)
        state = start(satellite, jnp.asarray(SLEW), jnp.asarray(h), jnp.zeros(3))
        states = [state]
        for part in range(PARTS):
            now = _part(during, part)
            state, _ = fly(satellite, state, now)
            states.append(state)
        return np.array([_total(s, axes) for s in states]), states

    return found


def _part(during, part):
    cut = slice(part * STEPS, (part + 1) * STEPS)
    stuck = type(during.stuck)(*(a[cut] for a in during.stuck))
    return type(during)(during.noise[cut], during.f[cut], stuck)


def _total(state, axes):
    body = INERTIA * np.asarray(state.omega) + axes @ np.asarray(state.h)
    return Rotation.from_quat(np.asarray(state.q), scalar_first=True).apply(body)


# RK4 of rates of at most 0.8 N*m / 2500 kg*m^2 and h/I = 0.02 rad/s over steps of 0.05 s:
# (0.02 * 0.05)^5 / 120 a step of 50 N*m*s is nothing; 1200 roundings of 50 are
CONSERVED = 1e-10


def test_momentum_is_conserved_in_a_slew_with_friction(momenta):
    total, states = momenta()
    np.testing.assert_allclose(total, total[:1].repeat(PARTS + 1, 0), rtol=0, atol=CONSERVED)
    moved = np.asarray(states[-1].h) - MOMENTA
    assert np.abs(moved).max() > 20  # 0.8 N*m for some 50 s went from the wheels into the body
    assert np.linalg.norm(states[-1].q) == pytest.approx(1, abs=1e-15)


@pytest.mark.parametrize(
    "fault",
    [
        Schedule("d", "state", "h", Constant(0.1, 20.0)),
        Schedule("d", "state", "h", Sine(0.3, 0.2)),
        Schedule("d", "input", "u", Constant(0.1, 20.0)),
        Schedule("d", "gain", "u", Constant(0.5, 20.0)),
        Schedule("d", "state", "h", Constant(0.1, 20.0), "stuck"),
    ],
    ids=["friction", "unbalance", "command", "gain", "stuck"],
)
def test_momentum_is_conserved_under_faults_inside_the_wheel(momenta, fault):
    total, _ = momenta([fault])
    np.testing.assert_allclose(total, total[:1].repeat(PARTS + 1, 0), rtol=0, atol=CONSERVED)


def test_momentum_is_conserved_on_a_pyramid_of_four(momenta):
    total, _ = momenta(
        [Schedule("d", "state", "h", Constant(0.1, 20.0))], PYRAMID, np.full(4, 20.0)
    )
    np.testing.assert_allclose(total, total[:1].repeat(PARTS + 1, 0), rtol=0, atol=CONSERVED)


def test_equation_18_makes_momentum_from_nothing(momenta):
    """Its output is overwritten and its wheel is not: the body is turned by 0.1 N*m that no wheel
    takes up, and by nothing of what the wheel does."""
    total, states = momenta([Schedule("d", "output", "T", Constant(0.1, 20.0), "stuck")])
    np.testing.assert_allclose(total[:3], total[:1].repeat(3, 0), rtol=0, atol=CONSERVED)
    made = np.linalg.norm(total[-1] - total[2])
    wheel = states[-1].h[1] - states[2].h[1] - 0.1 * 40  # taken up, less what the body felt
    assert abs(wheel) > 5
    # the pitch axis turns by less than a radian meanwhile: the vectors add to most of their sum
    assert 0.5 * abs(wheel) < made < 1.01 * abs(wheel)


def _friction(speed):
    stribeck = 0.03 + (0.037 - 0.03) * np.exp(-((speed / 5) ** 2))
    return 2.5e-4 * speed + stribeck * np.tanh(speed)


def _body(omega, h, torque, outside):
    return (outside - torque - np.cross(omega, INERTIA * omega + h)) / INERTIA


def _attitude(q, omega):
    w, v = q[0], q[1:]
    return np.concatenate([[-v @ omega / 2], (w * omega + np.cross(v, omega)) / 2])


def test_motion_is_that_of_scipys_integrator(build, conditions, wheel):
    """The same commands, period by period, into a body and wheels written a second time: motors
    (never at their limits here), friction through zero speed, and torques from outside."""
    disturbance = np.array([[0.02, 0.01, -0.04], [1.0, 4.0, 2.0]])
    satellite = build(wheel, disturbance=jnp.asarray(disturbance))
    steps, h = 120, np.array([2.0, 40.0, -3.0])
    named, during = conditions(wheel, steps)
    assert named.signals.faults == ()
    satellite = build(named, disturbance=jnp.asarray(disturbance))
    begin = start(satellite, jnp.asarray(SLEW), jnp.asarray(h), jnp.zeros(3))
    end, flown = fly(satellite, begin, during)
    orbital = np.sqrt(3.986004418e14 / 6918137.0**3)

    def rates(t, x, u):
        omega, h = x[4:7], x[7:]
        taken = u - _friction(h / 0.84)
        outside = disturbance[0] + disturbance[1] * np.sin(orbital * t)
        return np.concatenate([_attitude(x[:4], omega), _body(omega, h, taken, outside), taken])

    x = np.concatenate([begin.q, begin.omega, begin.h])
    low, high = h.copy(), h.copy()
    for k in range(steps):
        span = (0.25 * k, 0.25 * (k + 1))
        np.testing.assert_allclose(flown.momentum[k], x[7:], rtol=0, atol=1e-7)
        x = solve_ivp(
            rates, span, x, "DOP853", args=(np.asarray(flown.u[k]),), rtol=1e-10, atol=1e-13
        ).y[:, -1]
        low, high = np.minimum(low, x[7:]), np.maximum(high, x[7:])
    assert np.any(low * high < 0)  # one went through zero speed
    # friction turns round within 2 s: RK4 errs by 0.05^4/120 of its fifth derivative, 0.5 N*m/s^4
    np.testing.assert_allclose(end.h, x[7:], rtol=0, atol=1e-7)
    np.testing.assert_allclose(end.omega, x[4:7], rtol=0, atol=1e-10)  # that over 2500 kg*m^2
    np.testing.assert_allclose(end.q, x[:4], rtol=0, atol=1e-8)  # for up to 30 s


@pytest.fixture(scope="module")
def tumble(build, conditions, ideal_wheel):
    """{substeps: (omega, q, h)} of a fast free gyrostat after 5 s, and scipy's."""
    locked = ideal_wheel("0*u")
    omega, h = np.array([0.6, -0.5, 0.4]), np.array([1500.0, -1000.0, 800.0])
    found = {}
    for substeps in (1, 2, 4):
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
        errors = [np.abs(found[s][part] - exact[part]).max() for s in (1, 2, 4)]
        assert errors[2] > 1e-9  # well above the reference's own
        ratios = np.array(errors[:-1]) / errors[1:]
        # 16, but for the next order: 0.25 s * 0.8 rad/s = 0.2, and half of it
        np.testing.assert_allclose(ratios, 16, rtol=0.25)


def test_gyroscopic_torque_does_no_work(tumble):
    """A free gyrostat keeps its energy, so does this one to the order of its integrator."""
    found, _, omega = tumble

    def energy(rate):
        return INERTIA @ rate**2 / 2

    drift = [abs(energy(found[s][4:]) / energy(omega) - 1) for s in (1, 2, 4)]
    assert np.abs(found[4][4:] - omega).max() > 0.1  # it does tumble
    assert drift[2] < 1e-7
    assert drift[0] / drift[2] > 100  # 16^2, and no floor under it
