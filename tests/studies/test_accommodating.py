"""Accommodation in the attitude loop: margins by linear algebra, a lost wheel in flight."""

import numpy as np
import pytest

from faultgauge.accommodation.perturbed import Perturbed
from faultgauge.observers.gains import ackermann, bandwidth_poles
from faultgauge.simulation.satellite.observatory import INERTIA, SLEW, run_satellite
from faultgauge.simulation.schedules import Schedule
from faultgauge_studies.paper.accommodating import setting
from faultgauge_studies.paper.accommodating.array import held, loss, satellite
from faultgauge_studies.paper.accommodating.margins import CORNERS, crossover, lag
from faultgauge_studies.paper.accommodating.pyramid import AXES, BIAS, WITHIN
from faultgauge_studies.paper.bench import set_up
from faultgauge_studies.paper.cases import ONSET

W, ZETA, PERIOD, PITCH_INERTIA = 0.1, 0.9, 0.25, INERTIA[1]


@pytest.mark.parametrize("gain", [0.5, 1.0, 2.0])
def test_the_loop_crosses_over_where_its_gain_is_one(gain):
    s = 1j * crossover(gain)
    assert abs(gain * (2 * ZETA * W * s + W**2) / s**2) == pytest.approx(1.0)


def test_the_lag_is_thirty_degrees_to_half_a_period():
    for gain, angle in CORNERS.values():
        turned = lag(gain, angle) * PERIOD * crossover(gain)
        assert turned == pytest.approx(angle, abs=PERIOD / 2 * crossover(gain) + 1e-12)


def slowest(gain, delay, bandwidth, zeta):
    """The largest |eigenvalue| of one axis under PD control and an observer whose estimate is
    taken off at once, with `gain` and `delay` between command and wheel. Written out by hand:
    angle, rate, momentum, its estimate, the fault's, and the last commands."""
    A = np.array([[1.0, PERIOD], [0.0, 1.0]])
    L = ackermann(A, np.array([1.0, 0.0]) @ A, bandwidth_poles(2, bandwidth, zeta, PERIOD))

    def step(v):
        angle, rate, h, h_hat, f, *past = v
        h_hat = h_hat + PERIOD * (past[0] + f)
        e = h_hat - h
        h_hat, f = h_hat - L[0] * e, f - L[1] * e
        past = [-PITCH_INERTIA * (W**2 * angle + 2 * ZETA * W * rate) - f, *past[:-1]]
        torque = gain * past[-1]
        turn = PERIOD * rate + PERIOD**2 / 2 * torque / PITCH_INERTIA
        rate = rate + PERIOD * torque / PITCH_INERTIA
        return np.array([angle + turn, rate, h + PERIOD * torque, h_hat, f, *past])

    n = 6 + delay
    M = np.stack([step(row) for row in np.eye(n)], axis=1)
    size = np.abs(np.linalg.eigvals(M) - 1.0)
    # momentum itself is an integrator that nothing holds: its eigenvalue is 1
    return np.abs(np.delete(np.linalg.eigvals(M), np.argmin(size))).max()


@pytest.mark.parametrize("corner", [(1.0, 0.0), *CORNERS.values()])
def test_the_linear_loop_is_stable_in_every_corner(corner):
    found = slowest(corner[0], lag(*corner), setting.BANDWIDTH, setting.ZETA)
    assert found < 0.998  # a time constant of 125 s at most


def test_a_quicker_estimate_would_not_be():
    worst = max(slowest(gain, lag(gain, angle), 0.8, 1.01) for gain, angle in CORNERS.values())
    assert worst > 1.0


def test_a_perturbed_policy_multiplies_and_delays():
    import jax.numpy as jnp

    from faultgauge.simulation.policy import Policy

    class Through(Policy):
        def init(self, x, u):
            return ()

        def step(self, state, wanted, y, dt):
            return state, wanted, ()

    policy = Perturbed(Through(), jnp.asarray(2.0), jnp.asarray(2), 4)
    state, found = policy.init(jnp.zeros(1), jnp.zeros(1)), []
    for k in range(1, 6):
        state, u, _ = policy.step(state, jnp.array([float(k)]), jnp.zeros(1), jnp.asarray(1.0))
        found.append(float(u[0]))
    assert found == [0.0, 0.0, 2.0, 4.0, 6.0]


@pytest.fixture(scope="module")
def flown():
    """A pyramid of like wheels; the second is lost in hold."""
    bench = set_up(0)
    model = setting.calibrated(bench.learned.model, bench.wheel, bench.seed)
    flying = satellite([bench.wheel] * 4, [model] * 4, AXES, (-1,) * 4)
    schedules: list[list[Schedule]] = [[*bench.inner] for _ in range(4)]
    schedules[1].append(loss(ONSET))
    return run_satellite(flying, 1000.0, 0, schedules, SLEW, [float(x) for x in BIAS])


@pytest.mark.study
def test_a_pyramid_points_again_after_the_loss_of_a_wheel(flown):
    found = held(flown, ONSET)
    assert found["back_after_s"] < WITHIN
    assert found["decided_after_s"] < 60.0
    assert found["rank"] == 3.0
    assert found["largest_momentum"] < 0.84 * 314.16
    assert found["largest_command"] <= 0.82


@pytest.mark.study
def test_only_the_lost_wheel_is_given_up(flown):
    used = np.asarray(flown.info.used)
    assert used[flown.t < ONSET].all()
    assert list(used[-1]) == [True, False, True, True]
    assert np.all(flown.u[-1000:, 1] == 0.0)


@pytest.mark.study
def test_torque_on_the_body_is_that_of_the_controller(flown):
    """Before the loss the four wheels, friction and all, put on the body what one axis needs: the
    disturbance of 1 to 4 mN*m, not their own 50 mN*m of friction."""
    quiet = (flown.t > 400) & (flown.t < ONSET)
    body = np.asarray(flown.torque)[quiet] @ AXES.T
    assert np.abs(body.mean(axis=0)).max() < 6e-3
