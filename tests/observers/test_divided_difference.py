"""The divided-difference filter against a textbook Kalman filter, and what it does with samples
that no model expects."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from faultgauge.observers.divided_difference import (
    FAR,
    LOST,
    Belief,
    DividedDifferenceFilter,
    FilterNoise,
)
from faultgauge.plants.disturbed import Disturbed, Error
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant

LAG = """
name = "lag"
[states.x]
derivative = "u - 0.5*x"
[inputs.u]
hold = "zero"
{limits}
[outputs.x]
value = "x"
[outputs.sum]
value = "2*x + u"
[faults.push]
enters = "input"
target = "u"
rate = 0.01
[faults.bias]
enters = "output"
target = "x"
"""
A, TAU, SETTLING, SHARE, STEP = 0.5, 8.0, 1.5, 0.2, 0.4
SIGMA, PROCESS = (0.1, 0.3), (0.05, 0.04, 0.6, 0.0)
COUNT = 40
NOISE = FilterNoise(jnp.array(PROCESS), jnp.array([0.02, 0.0]), jnp.array(SIGMA))
START = jnp.array([0.5, 0, 0, 0.7, 0, 0, 0])  # x, d, r, h, push, bias, the push's growth
SPREAD = np.array([0.4, 0.1, 1.0, 0.0, 0.5, 0.0, 0.01])


def lane(text=LAG, limits=""):
    base = GrayBoxPlant.untrained(parse_plant(text.format(limits=limits)))
    error = Error(*(jnp.array([each]) for each in (TAU, SETTLING, SHARE)))
    plant = Disturbed.of(base, (0,), (0,), error, (), jnp.zeros(0), jnp.zeros((0, 0)))
    return DividedDifferenceFilter(plant, jnp.ones(4), jnp.full(2, 0.1), (0,), 1)


@eqx.filter_jit
def stepped(each, belief, before, u, y, dt):
    return each.step(belief, NOISE, before, u, y, dt)


def run(each, u, y):
    """Beliefs and likelihoods; the first sample comes at once."""
    belief, before, found = Belief(START, jnp.diag(SPREAD**2)), u[:1], []
    for k in range(len(u)):
        now, dt = jnp.asarray(u[k : k + 1]), jnp.asarray(STEP if k else 0.0)
        belief, said, *_ = stepped(each, belief, jnp.asarray(before), now, jnp.asarray(y[k]), dt)
        before = now
        found.append((belief, float(said)))
    return found


def textbook(u, y):
    """The Kalman filter of z' = F z + G u, both outputs at once; x by one Runge-Kutta step, along
    which d fades as an exponential does, and e = SHARE r h acts with its mean, where h is known;
    the second output sees e."""

    in_the_mean = (1 - np.exp(-2 * STEP / SETTLING)) * SETTLING / 2 / STEP
    faded = np.exp(-STEP / SETTLING)

    def moved(z, u, h):
        def rate(x, t):
            e = SHARE * h * z[2]
            return z[1] * np.exp(-t / TAU) + e * in_the_mean + z[4] + u - A * x

        first = rate(z[0], 0.0)
        second = rate(z[0] + STEP / 2 * first, STEP / 2)
        third = rate(z[0] + STEP / 2 * second, STEP / 2)
        last = rate(z[0] + STEP * third, STEP)
        after = np.array(z)
        after[0] += STEP / 6 * (first + 2 * second + 2 * third + last)
        after[1:4] *= np.exp(-STEP / TAU), faded, faded
        after[4] += STEP * z[6]  # a growth adds to its fault between steps, and acts from then on
        return after

    G = moved(np.zeros(7), 1.0, 0.0)
    q = np.array([*PROCESS, 0.02, 0.0, 0.0])
    mean, P, found = np.array(START), np.diag(SPREAD**2), []
    for k in range(len(u)):
        if k:
            F = np.stack([moved(unit, 0.0, mean[3]) for unit in np.eye(7)], axis=1)
            mean, P = F @ mean + G * u[k - 1], F @ P @ F.T + np.diag(q**2 * STEP)
            mean[3] += u[k] - u[k - 1]
        H = np.array([[1, 0, 0, 0, 0, 1, 0], [2, 0, SHARE * mean[3], 0, 1, 0, 0]])
        seen = np.isfinite(y[k])
        C, R = H[seen], np.diag(np.array(SIGMA)[seen] ** 2)
        e = y[k][seen] - C @ mean - np.array([0.0, u[k]])[seen]
        S = C @ P @ C.T + R
        K = np.linalg.solve(S, C @ P).T
        said = -0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2 * np.pi * S)[1])
        mean, P = mean + K @ e, P - K @ S @ K.T
        found.append((mean, P, said if seen.any() else 0.0))
    return found


@pytest.fixture(scope="module")
def signals():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, COUNT // 5), 5)
    x = np.zeros(COUNT)
    for k in range(COUNT - 1):
        x[k + 1] = np.exp(-A * STEP) * x[k] + (1 - np.exp(-A * STEP)) / A * u[k]
    y = np.stack([x, 2 * x + u], axis=1) + np.array(SIGMA) * rng.standard_normal((COUNT, 2))
    return u, y


@pytest.mark.parametrize("missing", [False, True])
def test_on_a_linear_plant_it_is_the_kalman_filter(signals, missing):
    """Differences of a linear function are exact, outputs taken in turn are outputs taken at once;
    forty steps of rounding, over differences of about 0.01, stay below 1e-9."""
    u, y = signals
    if missing:
        y = y.copy()
        y[5:9, 0] = y[7, 1] = y[20:24] = np.nan
    for (belief, said), (mean, P, wanted) in zip(run(lane(), u, y), textbook(u, y), strict=True):
        np.testing.assert_allclose(belief.mean, mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.P, P, rtol=1e-9, atol=1e-9)
        assert said == pytest.approx(wanted, rel=1e-9, abs=1e-9)


def test_a_glitch_moves_little_and_what_stays_is_believed(signals):
    """A sample that is e off has its variance raised to e^2 / FAR^2, so that the state moves by no
    more than K e = P H e / S = FAR^2 P H / e: a ten-thousandth of its own sd at e = -9999."""
    u, y = signals
    odd = y.copy()
    odd[20, 0] = -9999.0
    plain, spoiled = run(lane(), u, y), run(lane(), u, odd)
    without = y.copy()
    without[20, 0] = np.nan
    skipped = run(lane(), u, without)
    sd = float(np.sqrt(skipped[20][0].P[0, 0]))
    bound = FAR**2 * sd**2 / 9990.0
    assert bound < 0.01 * sd
    assert abs(float(spoiled[20][0].mean[0] - skipped[20][0].mean[0])) <= bound
    # 25 / 2 for the distance, and the logarithm of the factor by which its noise was raised
    assert plain[20][1] - spoiled[20][1] < FAR**2 / 2 + np.log(1e4 / (FAR * SIGMA[0])) + 3.0
    lasting = y.copy()
    lasting[20:, 0] += 3.0  # thirty standard deviations, on one of the two outputs, for good
    stayed = run(lane(), u, lasting)
    assert sum(p[1] - s[1] for p, s in zip(plain, stayed, strict=True)) > 50.0


def test_an_input_at_its_limit_takes_a_push_one_way_only():
    """u = 1 of at most 1: nothing upwards, RK4's (1 - exp(-A h)) / A = 0.36 downwards."""
    one = lane(limits="min = -1\nmax = 1")
    belief = Belief(START, jnp.diag(SPREAD**2 * np.array([1, 1, 1, 0, 0, 0, 0])))
    at, nothing = jnp.array([1.0]), jnp.full(2, jnp.nan)
    flow = stepped(one, belief, at, at, nothing, jnp.asarray(STEP))[2]
    assert float(flow.up[0, 0]) == 0.0
    # the fourth-order series: (A h)^5 / 120 A is below 1e-5
    assert float(flow.down[0, 0]) == pytest.approx((1 - np.exp(-A * STEP)) / A, abs=1e-5)
    between = jnp.array([0.0])
    flow = stepped(one, belief, between, between, nothing, jnp.asarray(STEP))[2]
    assert float(flow.up[0, 0]) == pytest.approx(float(flow.down[0, 0]), rel=1e-12)


def test_a_filter_that_blows_up_stays_and_says_so():
    """x' = exp(50 x) leaves all numbers within a step from x = 20 on."""
    wild = lane(LAG.replace("u - 0.5*x", "u + exp(50*x)"))
    belief = Belief(START.at[0].set(20.0), jnp.diag(SPREAD**2))
    zero = jnp.zeros(1)
    after, said, flow, look, seen = stepped(
        wild, belief, zero, zero, jnp.array([20.0, 40.0]), jnp.asarray(STEP)
    )
    assert float(said) == LOST
    np.testing.assert_array_equal(after.mean, belief.mean)
    np.testing.assert_array_equal(after.P, belief.P)
    np.testing.assert_array_equal(flow.A, np.eye(7))
    assert not np.asarray(look.C).any()
    assert np.isinf(np.asarray(seen.root)).all()


def test_a_sensor_behind_a_plant_trails_it():
    """x' = u - A x, s' = (x - s) / LAG, exactly (SciPy's matrix exponential), in steps of 0.02 s
    and a model without s: with a trail of LAG what the filter, that believes no sample, expects of
    the sensor is s, but for what an even way of x within a step makes of it (without, it is off by
    0.4)."""
    lag, dt, count = 0.5, 0.02, 400
    u = np.repeat(np.random.default_rng(2).uniform(-1, 1, 8), count // 8)
    step = expm(np.array([[-A, 0, 1], [1 / lag, -1 / lag, 0], [0, 0, 0]]) * dt)
    x = np.zeros((count, 2))
    for k in range(count - 1):
        x[k + 1] = (step @ np.append(x[k], u[k]))[:2]
    text = LAG.split("[outputs.sum]")[0] + "[faults" + LAG.split("[faults", 1)[1]
    base = GrayBoxPlant.untrained(parse_plant(text.format(limits="")))
    tau, settling, share, trail = (jnp.array([a]) for a in (TAU, SETTLING, 1e-9, lag))
    error = Error(tau, settling, share, trail=trail)
    nothing = jnp.zeros(0), jnp.zeros((0, 0))
    plant = Disturbed.of(base, (0,), (0,), error, (), *nothing, trailing=(0,))
    assert plant.signals.state_names[3] == "g(x)"
    each = DividedDifferenceFilter(plant, jnp.ones(5), jnp.full(2, 0.1), (), 1)
    belief = each.begin(jnp.zeros(5), jnp.full(5, 1e-9))
    noise = FilterNoise(jnp.full(5, 1e-9), jnp.zeros(2), jnp.ones(1))
    far = 0.0
    for k in range(1, count):
        inputs = jnp.asarray(u[k - 1 : k]), jnp.asarray(u[k : k + 1])
        y = jnp.full(1, np.nan)
        belief, *_ = eqx.filter_jit(each.step)(belief, noise, *inputs, y, jnp.asarray(dt))
        shown = eqx.filter_jit(each.look)(belief, inputs[1])[0]
        far = max(far, abs(float(shown[0]) - x[k, 1]))
    assert far < 1e-4


def test_a_plant_behind_a_lag_is_one_whose_input_comes_late():
    """x' = v - A x, v' = (u - v) / LAG, exactly (SciPy's matrix exponential), in steps of 0.02 s
    and a model without v: by a lean of -1 the filter, that believes no sample, is where the plant
    is, but for what the mean of a step and Runge-Kutta make of it (a thousandth of x's range of 2;
    without the lean it is off by 0.3)."""
    lag, dt, count = 0.5, 0.02, 400
    u = np.repeat(np.random.default_rng(2).uniform(-1, 1, 8), count // 8)
    step = expm(np.array([[-A, 1, 0], [0, -1 / lag, 1 / lag], [0, 0, 0]]) * dt)
    x = np.zeros((count, 2))
    x[0, 1] = u[0]
    for k in range(count - 1):
        x[k + 1] = (step @ np.append(x[k], u[k]))[:2]
    text = LAG.split("[outputs.sum]")[0] + "[faults" + LAG.split("[faults", 1)[1]
    base = GrayBoxPlant.untrained(parse_plant(text.format(limits="")))
    tau, settling, share, leaning = (jnp.array([a]) for a in (TAU, SETTLING, 1e-9, lag))
    error = Error(tau, settling, share, leaning=leaning, lean=jnp.array([-1.0]))
    plant = Disturbed.of(base, (0,), (0,), error, (), jnp.zeros(0), jnp.zeros((0, 0)), leaning=(0,))
    each = DividedDifferenceFilter(plant, jnp.ones(5), jnp.full(2, 0.1), (), 1)
    belief = each.begin(jnp.zeros(5), jnp.full(5, 1e-9))
    noise = FilterNoise(jnp.full(5, 1e-9), jnp.zeros(2), jnp.ones(1))
    far = 0.0
    for k in range(1, count):
        inputs = jnp.asarray(u[k - 1 : k]), jnp.asarray(u[k : k + 1])
        y = jnp.full(1, np.nan)
        belief, *_ = eqx.filter_jit(each.step)(belief, noise, *inputs, y, jnp.asarray(dt))
        far = max(far, abs(float(belief.mean[0]) - x[k, 0]))
    assert far < 2e-3


def beside_an_error(text, driven):
    """A filter of one fault, whose discrepancy acts on the state `driven`."""
    base = GrayBoxPlant.untrained(parse_plant(text))
    error = Error(*(jnp.array([each]) for each in (TAU, SETTLING, 1e-9)))
    plant = Disturbed.of(base, (driven,), (0,), error, (), jnp.zeros(0), jnp.zeros((0, 0)))
    scale = jnp.ones(len(plant.signals.states))
    return DividedDifferenceFilter(plant, scale, jnp.full(1, 0.1), (), 1)


FALLS = """
name = "two pendulums that fall"
[states.x]
derivative = "v"
exact = true
[states.v]
derivative = "16*x + y + u"
[states.y]
derivative = "w"
exact = true
[states.w]
derivative = "9*y + x"
[inputs.u]
hold = "zero"
[outputs.x]
value = "x"
[outputs.y]
value = "y"
[faults.bias]
enters = "output"
target = "x"
"""


def test_the_covariance_of_a_plant_that_is_unstable_comes_to_that_of_riccatis_equation():
    """Two pendulums fall, by e^4 and e^3 a second: what rounding makes asymmetric, of which no
    sample takes anything back, would grow by e^7, e^420 in 60 s. The predicted covariance is that
    of SciPy's DARE for the F of the filter's own Runge-Kutta step, whose series this is; d fades as
    an exponential does."""
    dt, sigma, noise = 0.01, 1e-4, (1e-6, 0.05, 1e-6, 0.05, 0.02, 0.0, 0.0)
    each = beside_an_error(FALLS, driven=1)
    start = jnp.array([1e-3, 1e-2, 1e-3, 1e-2, 1e-2, 0.0, 0.0])
    belief = each.begin(jnp.zeros(7), start)
    levels = FilterNoise(jnp.array(noise), jnp.zeros(1), jnp.full(2, sigma))
    step, none, still = eqx.filter_jit(each.step), jnp.zeros(1), jnp.zeros(2)
    for _ in range(6000):
        belief, *_ = step(belief, levels, none, none, still, jnp.asarray(dt))
    P = np.asarray(belief.P)[:5, :5]
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P).min() > 0
    rates = np.zeros((5, 5))
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, [0, 2, 4]], rates[3, [0, 2]], rates[4, 4] = (16.0, 1.0, 1.0), (1.0, 9.0), -1 / TAU
    term = F = np.eye(5)
    for k in range(1, 5):
        term = term @ rates * dt / k
        F = F + term
    Q, R = np.diag(np.array(noise[:5]) ** 2 * dt), np.eye(2) * sigma**2
    H = np.zeros((2, 5))
    H[0, 0] = H[1, 2] = 1.0
    predicted = solve_discrete_are(F.T, H.T, Q, R)
    gain = predicted @ H.T @ np.linalg.inv(H @ predicted @ H.T + R)
    # d acts along the step as its mean does there, which the series takes to dt^5
    wanted = predicted - gain @ H @ predicted
    width = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(
        P / np.outer(width, width), wanted / np.outer(width, width), atol=1e-5
    )


ROOT = """
name = "outflow"
[states.h]
derivative = "u - sqrt(h)"
[inputs.u]
hold = "zero"
[outputs.h]
value = "h"
[faults.bias]
enters = "output"
target = "h"
"""


def test_a_point_where_the_plant_is_no_number_is_left_to_the_other_side():
    """h = 0.01 +- 0.05: a root has no value below 0, and the slope is that upwards, by the same
    step of Runge and Kutta. A mean of which nothing is known leaves nothing behind that is no
    number."""
    dt = 1e-3
    each = beside_an_error(ROOT, driven=0)
    levels = FilterNoise(jnp.full(4, 1e-3), jnp.zeros(1), jnp.array([0.1]))
    start, u = jnp.array([0.05, 1e-9, 1e-9, 0.0]), jnp.array([0.2])
    belief = each.begin(jnp.array([0.01, 0.0, 0.0, 0.2]), start)

    @eqx.filter_jit
    def one(belief):
        return each.step(belief, levels, u, u, jnp.zeros(1), jnp.asarray(dt))

    _, said, flow, *_ = one(belief)

    def stepped(h):
        slope = lambda h: 0.2 - np.sqrt(h)  # noqa: E731
        a = slope(h)
        b = slope(h + a * dt / 2)
        c = slope(h + b * dt / 2)
        return h + dt / 6 * (a + 2 * b + 2 * c + slope(h + c * dt))

    slope = (stepped(0.06) - stepped(0.01)) / 0.05
    assert float(flow.A[0, 0]) == pytest.approx(slope, rel=1e-12)
    assert float(said) > LOST
    lost = belief._replace(mean=belief.mean.at[0].set(-1.0))
    after, said, flow, look, seen = one(lost)
    assert float(said) == LOST
    for part in (*after, *flow, *look, *seen):
        assert not np.isnan(np.asarray(part)).any()


def test_a_sample_that_comes_too_early_or_too_late_is_off_by_what_its_output_moves():
    """Of x and of 2 x + u: where x goes by `moved` in a step, an error of 0.3 s of the second's
    time is one of 0.3 * 2 moved / STEP in it, and the first is as it was."""
    each, belief = lane(), Belief(START, jnp.diag(SPREAD**2))
    given = jnp.array([0.9]), jnp.array([0.9]), jnp.array([0.4, 1.7]), jnp.asarray(STEP)
    predicted, _ = each.predict(belief, NOISE, *given[:2], given[3])
    moved = float(predicted.mean[0] - START[0])
    assert abs(moved) > 0.05
    late = NOISE._replace(jitter=jnp.array([0.0, 0.3]))
    *_, usual = each.step(belief, NOISE, *given)
    *_, seen = each.step(belief, late, *given)
    more = np.asarray(seen.usual) ** 2 - np.asarray(usual.usual) ** 2
    np.testing.assert_allclose(more, [0.0, (0.3 * 2 * moved / STEP) ** 2], rtol=1e-9, atol=1e-12)
