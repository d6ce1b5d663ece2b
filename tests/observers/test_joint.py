"""The joint observer against an optimal filter written in NumPy, pole placement, and its words."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import odeint
from scipy.linalg import solve_discrete_are

from faultgauge.errors import InputError
from faultgauge.observers.joint import design_joint
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant

DT, BANDWIDTH, SIGMA = 0.1, 0.5, 0.02
TWO = """name = "two integrators"
[states.a]
derivative = "3*u - 0.2*a"
[states.b]
derivative = "a"
[inputs.u]
[outputs.a]
value = "a"
[outputs.b]
value = "b"
[faults.push]
enters = "state"
target = "a"
[faults.loss]
enters = "gain"
target = "u"
"""
INTEGRATOR = """name = "integrator"
[states.h]
derivative = "u"
[inputs.u]
[outputs.h]
value = "h"
[faults.push]
enters = "state"
target = "h"
"""


def build(text, sigma, u=1.0):
    plant = GrayBoxPlant.untrained(parse_plant(text))
    n = len(plant.signals.states)
    rng = np.random.default_rng(0)
    points = OperatingPoints(np.zeros((50, n)), u * rng.standard_normal((50, 1)))
    return design_joint(plant, points, DT, BANDWIDTH, np.asarray(sigma, float), DT)


def run(observer, u, y):
    """(final state, infos) over a record from rest."""

    @eqx.filter_jit
    def go(u, y):
        state = observer.init(jnp.zeros(y.shape[1]), u[0])

        def body(state, now):
            state, info = observer.step(state, state.u, now[1], jnp.asarray(DT))
            return state._replace(u=now[0]), info

        return jax.lax.scan(body, state, (u, y))

    return go(jnp.asarray(u), jnp.asarray(y))


def test_estimates_are_those_of_the_optimal_linear_filter():
    """NumPy's own Kalman filter on the exact discrete plant, additive fault alone."""
    text = TWO.split("[faults.loss]")[0]
    observer = build(text, [SIGMA, 5 * SIGMA])
    rng = np.random.default_rng(1)
    samples = 200
    u = rng.standard_normal((samples, 1))
    from scipy.signal import cont2discrete

    F = np.array([[-0.2, 0, 1], [1, 0, 0], [0, 0, 0]])
    B = np.array([[3.0], [0], [0]])
    A, Bd, *_ = cont2discrete((F, B, np.eye(3), np.zeros((3, 1))), DT)
    C = np.eye(2, 3)
    R = np.diag([SIGMA, 5 * SIGMA]) ** 2
    Q = np.zeros((3, 3))
    Q[2, 2] = float(observer.walk[0]) * DT
    z, P = np.zeros(3), np.diag([(5 * SIGMA) ** 2, (5 * SIGMA) ** 2, 0.0])
    y = rng.standard_normal((samples, 2)) * [SIGMA, 5 * SIGMA]
    y[90:] += np.array([0.5, 0.2])
    expected = []
    for k in range(samples):
        last = u[max(k - 1, 0)]  # the command before the first sample is the first one
        z = A @ z + Bd @ last
        P = A @ P @ A.T + Q
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        z, P = z + K @ (y[k] - C @ z), (np.eye(3) - K @ C) @ P
        expected.append([*z, np.sqrt(P[2, 2])])
    _, info = run(observer, u, y)
    found = np.concatenate([info.x, info.f, info.sd], axis=1)
    # RK4 of 0.1 s at a rate of 0.2/s: an error of (0.02)^5/120 per step
    assert np.asarray(found) == pytest.approx(np.array(expected), abs=1e-8)


def test_the_bandwidth_places_a_butterworth_pair():
    """Steady-state Kalman gains of an integrator with a random walk, by SciPy's Riccati equation:
    the closed poles are those of s^2 + sqrt(2) w s + w^2 up to the sampling (w DT = 0.05)."""
    observer = build(INTEGRATOR, [SIGMA])
    A = np.array([[1, DT], [0, 1]])
    Q = np.diag([0, float(observer.walk[0]) * DT])
    P = solve_discrete_are(A.T, np.array([[1.0], [0.0]]), Q, np.array([[SIGMA**2]]))
    K = P[:, 0] / (P[0, 0] + SIGMA**2)
    poles = np.log(np.linalg.eigvals((np.eye(2) - np.outer(K, [1, 0])) @ A)) / DT
    assert np.abs(poles) == pytest.approx(BANDWIDTH, rel=0.05)
    assert poles.real == pytest.approx(-BANDWIDTH / np.sqrt(2), rel=0.05)


def simulated(samples, push, loss, u, noise=True):
    """Exact samples of TWO with faults from 10 s on, by steps of 1 ms."""
    rng = np.random.default_rng(2)
    x, found = np.zeros(2), []
    for k in range(samples):
        found.append(x + noise * SIGMA * rng.standard_normal(2))
        on = k * DT >= 10
        for _ in range(100):
            rate = 3 * u[k, 0] * (1 - loss * on) - 0.2 * x[0] + push * on
            x = x + DT / 100 * np.array([rate, x[0]])
    return np.array(found)


def test_two_faults_at_once_are_told_apart():
    samples = 600
    u = np.sin(0.7 * DT * np.arange(samples))[:, None]
    y = simulated(samples, push=0.4, loss=0.3, u=u)
    _, info = run(build(TWO, [SIGMA, SIGMA]), u, y)
    late = np.asarray(info.f)[-100:]
    # five standard deviations of what the filter itself claims
    spread = np.asarray(info.sd)[-1]
    assert np.abs(late.mean(axis=0) - [0.4, 0.3]) == pytest.approx(0, abs=5 * spread.max())
    assert spread.max() < 0.05
    assert np.asarray(info.unexplained)[-1] < 4


def test_a_fault_that_is_not_declared_stays_unexplained():
    samples = 400
    u = np.sin(0.7 * DT * np.arange(samples))[:, None]
    y = simulated(samples, push=0.0, loss=0.0, u=u)
    y[200:, 1] += 1.0 * DT * np.arange(200)  # the second sensor drifts
    _, info = run(build(TWO, [SIGMA, SIGMA]), u, y)
    assert np.asarray(info.unexplained)[150:200].max() < 4 < np.asarray(info.unexplained)[-1]


def test_a_loss_is_uncertain_while_its_input_rests():
    samples = 400
    u = np.where(np.arange(samples) < 200, 1.0, 0.0)[:, None]
    y = simulated(samples, push=0.0, loss=0.0, u=u)
    sd = np.asarray(run(build(TWO, [SIGMA, SIGMA]), u, y)[1].sd)[:, 1]
    assert sd[-1] > sd[199]


def test_missing_samples_leave_the_estimate_where_it_is():
    observer = build(INTEGRATOR, [SIGMA])
    u = np.zeros((50, 1))
    y = np.full((50, 1), np.nan)
    _, info = run(observer, u, y)
    assert float(np.abs(info.f).max()) == 0.0
    assert np.all(np.diff(np.asarray(info.sd)[:, 0]) > 0)


def test_faults_that_look_alike_are_refused_by_name():
    text = TWO.replace('[faults.loss]\nenters = "gain"\ntarget = "u"', "") + (
        '[faults.other]\nenters = "input"\ntarget = "u"\n'
    )
    with pytest.raises(InputError, match="push, other move the measured outputs alike"):
        build(text, [SIGMA, SIGMA])


def test_a_fault_that_shows_nowhere_is_refused_by_name():
    with pytest.raises(InputError, match="'loss' moves none of the measured outputs"):
        build(TWO, [SIGMA, SIGMA], u=0.0)


@pytest.mark.parametrize("jump", [0.6, -0.3])
def test_a_share_of_a_parameter_is_read_as_such(jump):
    """x' = u - (1 + f) c x in SciPy, c = 0.4; noise-free, so the estimate settles on f."""
    text = INTEGRATOR.replace('"u"', '"u - c*h"', 1).split("[faults.push]")[0]
    text += "[parameters]\nc = { value = 0.4 }\n"
    text += '[faults.drag]\nenters = "parameter"\ntarget = "c"\nrelative = true\n'
    plant = GrayBoxPlant.untrained(parse_plant(text))
    x = np.linspace(1.0, 3.0, 50)[:, None]
    observer = design_joint(plant, OperatingPoints(x, x), DT, BANDWIDTH, np.array([SIGMA]), DT)
    t, u = np.arange(600) * DT, np.ones((600, 1))
    y = odeint(lambda h, _: 1 - (1 + jump) * 0.4 * h, 0.0, t, rtol=1e-10, atol=1e-12)
    _, info = run(observer, u, y)
    # 60 s are 30 time constants of the observer; RK4 steps of 0.1 s err by 1e-8
    np.testing.assert_allclose(info.f[-1], [jump], atol=1e-4)
