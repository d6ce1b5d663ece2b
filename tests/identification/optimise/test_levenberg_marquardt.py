"""Levenberg-Marquardt against SciPy, published minima and analytic Jacobians."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares, nnls

from faultgauge.identification.optimise.levenberg_marquardt import (
    CONVERGED,
    FAILED,
    NOT_CONVERGED,
    VALIDATION_STOP,
    Options,
    levenberg_marquardt,
    normal_equations,
)

# Problems. A residual reads one sample; `xp` lets SciPy run the same formula in plain NumPy.
RNG = np.random.default_rng(7)
T = np.linspace(0, 4, 60)
NOISE = 0.05 * RNG.normal(size=60)
DESIGN = RNG.normal(size=(60, 4))
BARD = np.array(
    [0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39]
)
BARD_U = np.arange(1.0, 16.0)
KOWALIK = np.array(
    [0.1957, 0.1947, 0.1735, 0.16, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246]
)
KOWALIK_U = np.array([4, 2, 1, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625])


def decay(p, s, xp):
    return p[0] * xp.exp(-p[1] * s[0]) + p[2] - s[1]


def saturation(p, s, xp):
    return p[0] * s[0] / (p[1] + s[0]) - s[1]


def logistic(p, s, xp):
    return p[0] / (1 + xp.exp(-p[1] * (s[0] - p[2]))) - s[1]


def peak(p, s, xp):
    return p[0] * xp.exp(-(((s[0] - p[1]) / p[2]) ** 2)) + p[3] + p[4] * s[0] - s[1]


def wave(p, s, xp):
    return p[0] * xp.exp(-p[1] * s[0]) * xp.sin(p[2] * s[0] + p[3]) - s[1]


def linear(p, s, xp):
    return p[0] * s[0] + p[1] * s[1] + p[2] * s[2] + p[3] * s[3] - s[4]


def network(p, s, xp):
    return p[0] * xp.tanh(p[1] * s[0] + p[2]) + p[3] * xp.tanh(p[4] * s[0] + p[5]) + p[6] - s[1]


def rosenbrock(p, s, xp):
    """Rosenbrock's valley; the last sample's constant keeps the minimum off zero."""
    return s[0] * (1 - p[0]) + s[1] * 10 * (p[1] - p[0] ** 2) + s[2]


def bard(p, s, xp):
    return p[0] + s[0] / (s[1] * p[1] + s[2] * p[2]) - s[3]


def kowalik(p, s, xp):
    return p[0] * (s[0] ** 2 + s[0] * p[1]) / (s[0] ** 2 + s[0] * p[2] + p[3]) - s[1]


def made(formula, truth, noise, *inputs):
    """Samples of `formula` at `truth` with additive `noise`."""
    return (*inputs, formula(truth, (*inputs, 0.0), np) + noise)


UNIT, NIL = np.eye(3), np.zeros(3)
PROBLEMS = {
    "decay": (decay, made(decay, (2, 1.5, 0.5), NOISE, T), (1, 1, 0)),
    "decay, exact": (decay, made(decay, (2, 1.5, 0.5), 0, T), (1, 1, 0)),
    "saturation": (saturation, made(saturation, (3, 0.7), NOISE, T), (1, 1)),
    "logistic": (logistic, made(logistic, (2, 3, 1.5), NOISE, T), (1, 1, 1)),
    "peak": (peak, made(peak, (2, 1.5, 0.4, 0.3, -0.1), NOISE, T), (1, 1.2, 0.8, 0, 0)),
    "wave": (wave, made(wave, (2, 0.4, 4, 0.3), 2 * NOISE, T), (1, 0.1, 3.8, 0)),
    "linear": (linear, made(linear, (1, -2, 3, 0.5), NOISE, *DESIGN.T), (0, 0, 0, 0)),
    "network": (
        network,
        made(network, (1, 3, -3, 0.7, -2, 6, 0.2), NOISE / 5, T),
        (0.5, 2, -3, 0.5, -2, 5, 0),
    ),
    "rosenbrock": (rosenbrock, (UNIT[0], UNIT[1], NIL), (-1.2, 1)),
    "rosenbrock, large residual": (rosenbrock, (UNIT[0], UNIT[1], 3 * UNIT[2]), (-1.2, 1)),
    "bard": (bard, (BARD_U, 16 - BARD_U, np.minimum(BARD_U, 16 - BARD_U), BARD), (1, 1, 1)),
    "kowalik": (kowalik, (KOWALIK_U, KOWALIK), (0.25, 0.39, 0.415, 0.39)),
}
# J. J. More, B. S. Garbow, K. E. Hillstrom, "Testing unconstrained optimization software",
# ACM TOMS 7 (1981), problems 8 and 15; six figures are given.
PUBLISHED = {"bard": 8.21487e-3, "kowalik": 3.07505e-4}


@functools.cache
def residual_of(formula):
    """One function per formula, so that its compiled program is found again."""

    def residual(theta, sample):
        return jnp.stack([formula(theta, sample, jnp)])

    return residual


def solve(formula, samples, starts, *, validation=None, lower=None, upper=None, **options):
    starts = jnp.atleast_2d(jnp.asarray(starts, float))
    free = np.full(starts.shape[1], np.inf)
    return levenberg_marquardt(
        residual_of(formula),
        starts,
        tuple(map(jnp.asarray, samples)),
        None if validation is None else tuple(map(jnp.asarray, validation)),
        jnp.asarray(-free if lower is None else lower, float),
        jnp.asarray(free if upper is None else upper, float),
        Options(**{"max_trials": 1000, **options}),
    )


def scipy_cost(formula, samples, start, **options):
    tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "jac": "3-point", "max_nfev": 5000}
    found = least_squares(
        lambda p: formula(p, samples, np), np.asarray(start, float), **{**tight, **options}
    )
    return 2 * found.cost, found.x


@pytest.mark.parametrize("name", PROBLEMS)
def test_cost_is_scipys(name):
    formula, samples, start = PROBLEMS[name]
    ours = solve(formula, samples, start)
    reference, _ = scipy_cost(formula, samples, start, method="lm")
    first = float(np.sum(formula(start, samples, np) ** 2))
    # At a minimum the cost is flat: a parameter error of 1e-5 shows as 1e-10. Where the minimum
    # is zero both end in rounding, so the bound is 1e-20 of the first cost instead.
    assert float(ours.cost[0]) == pytest.approx(reference, rel=1e-8, abs=1e-20 * first)
    assert int(ours.status[0]) == CONVERGED
    assert np.all(np.diff(np.asarray(ours.history[0, : int(ours.trials[0]), 0])) <= 0)


@pytest.mark.parametrize("name", PUBLISHED)
def test_cost_is_the_published_one(name):
    formula, samples, start = PROBLEMS[name]
    cost = float(solve(formula, samples, start).cost[0])
    assert cost == pytest.approx(PUBLISHED[name], rel=2e-6)  # half of the sixth figure


def test_cost_belongs_to_the_parameters():
    formula, samples, start = PROBLEMS["peak"]
    found = solve(formula, samples, start)
    cost = np.sum(formula(np.asarray(found.theta[0]), samples, np) ** 2)
    assert float(found.cost[0]) == pytest.approx(cost, rel=1e-13)  # 60 squares: rounding only
    assert float(found.validation_cost[0]) == float(found.cost[0])  # no validation set given


@pytest.mark.parametrize("bound", [0.9, 0.3])
def test_bounds_are_respected_and_the_rest_is_optimal(bound):
    """Decay held below its true rate of 1.5: amplitude and offset have to make up for it."""
    formula, samples, _ = PROBLEMS["decay"]
    upper = np.array([np.inf, bound, np.inf])
    lower = np.array([0, 0.1, -np.inf])
    ours = solve(formula, samples, (1, 0.2, 0), lower=lower, upper=upper)
    reference, x = scipy_cost(formula, samples, (1, 0.2, 0), bounds=(lower, upper), method="dogbox")
    assert np.all(ours.theta[0] >= lower)
    assert np.all(ours.theta[0] <= upper)
    assert float(ours.theta[0][1]) == bound
    # what is left is linear in two parameters: 1e-8 of cost is where dogbox itself stops
    assert float(ours.cost[0]) == pytest.approx(reference, rel=1e-8)
    np.testing.assert_allclose(ours.theta[0], x, rtol=1e-4)  # flat minimum: sqrt of the above


def test_non_negative_least_squares():
    """Correlated columns, half of the parameters on their bound: the minimum NNLS finds."""
    rng = np.random.default_rng(5)
    design = rng.normal(size=(60, 4)) + 2 * rng.normal(size=(60, 1))
    target = design @ [1.0, -2.0, 3.0, -0.5] + rng.normal(size=60)
    x, norm = nnls(design, target)
    assert 0 < np.count_nonzero(x) < 4
    found = solve(linear, (*design.T, target), np.ones(4), lower=np.zeros(4))
    assert float(found.cost[0]) == pytest.approx(norm**2, rel=1e-12)  # a quadratic: rounding
    np.testing.assert_array_equal(np.asarray(found.theta[0]) == 0, x == 0)


def test_starts_outside_the_bounds_are_moved_inside():
    formula, samples, _ = PROBLEMS["saturation"]
    found = solve(formula, samples, (50, -3), lower=[0, 0.5], upper=[10, 5])
    reference, _ = scipy_cost(formula, samples, (1, 1), method="lm")
    assert float(found.cost[0]) == pytest.approx(reference, rel=1e-8)  # as above


def root(p, s, xp):
    return xp.sqrt(p[0]) * s[0] - 0.1 + p[1] * s[1]


ROOT = (np.array([1.0, 0.0]), np.array([0.0, 1.0]))


def test_failed_start_leaves_the_others_alone():
    good = solve(root, ROOT, [(2.0, 1.0), (1.0, 0.0), (3.0, 1.0)])
    mixed = solve(root, ROOT, [(2.0, 1.0), (-1.0, 0.0), (3.0, 1.0)])
    assert int(mixed.status[1]) == FAILED
    assert int(mixed.trials[1]) == 0
    np.testing.assert_array_equal(mixed.theta[1], [-1.0, 0.0])
    for k in (0, 2):  # the same program on the same numbers: the same bits
        assert int(mixed.status[k]) == CONVERGED
        np.testing.assert_array_equal(mixed.theta[k], good.theta[k])
        np.testing.assert_array_equal(mixed.history[k], good.history[k])


def test_step_into_non_finite_cost_is_rejected():
    """From p = 4 the Gauss-Newton step leads to p = -3.6, where the root is not a number."""
    with np.errstate(invalid="ignore"):
        assert np.isnan(root((4 - 1.9 / 0.25, 0.0), ROOT, np)).any()
    found = solve(root, ROOT, (4.0, 0.0))
    assert float(found.history[0, 0, 0]) == pytest.approx(1.9**2 + 0.1**2, rel=1e-15)
    # sqrt(p) = 0.1 and p1 = 0.1 exactly; the residual is solved to rounding, p to twice that
    np.testing.assert_allclose(found.theta[0], [0.01, 0.1], rtol=1e-9)


def wiggly(p, s, xp):
    """Ten sines: far too many for the samples below."""
    total = -s[1]
    for k in range(10):
        total = total + p[2 * k] * xp.sin((k + 1) * s[0]) + p[2 * k + 1] * xp.tanh(s[0] * (k - 4.5))
    return total


@functools.cache
def overfitted(max_fail):
    rng = np.random.default_rng(3)
    x, dense = np.sort(rng.uniform(-2, 2, 24)), np.linspace(-2, 2, 101)
    training = (x, np.sin(2 * x) + 0.3 * rng.normal(size=24))
    validation = (dense, np.sin(2 * dense))
    start = np.zeros(20)
    found = solve(wiggly, training, start, validation=validation, max_fail=max_fail, tau=10.0)
    return found, validation


def test_validation_stop_returns_the_best_validation_point():
    found, validation = overfitted(max_fail=4)
    trials = int(found.trials[0])
    cost, valid = np.asarray(found.history[0, :trials]).T
    accepted = np.isfinite(valid)
    assert int(found.status[0]) == VALIDATION_STOP
    best = int(np.nanargmin(valid))
    assert float(found.validation_cost[0]) == valid[best]
    assert float(found.cost[0]) == cost[best]
    assert np.count_nonzero(accepted[best + 1 :]) == 4  # max_fail steps in vain, then the stop
    assert cost[-1] < cost[best]  # training cost still fell: this is what the stop is for
    again = np.sum(wiggly(np.asarray(found.theta[0]), validation, np) ** 2)
    assert again == pytest.approx(valid[best], rel=1e-12)  # 101 squares: rounding only
    assert np.all(np.isnan(np.asarray(found.history[0, trials:])))


def test_patience_finds_a_validation_point_that_is_no_worse():
    impatient, _ = overfitted(max_fail=4)
    patient, _ = overfitted(max_fail=50)
    assert float(patient.validation_cost[0]) <= float(impatient.validation_cost[0])
    assert int(patient.trials[0]) > int(impatient.trials[0])


def test_trials_cap():
    formula, samples, start = PROBLEMS["rosenbrock"]
    found = solve(formula, samples, start, max_trials=3)
    assert int(found.status[0]) == NOT_CONVERGED
    assert int(found.trials[0]) == 3
    assert found.history.shape == (1, 3, 2)
    first = np.sum(formula(start, samples, np) ** 2)
    assert float(found.cost[0]) < first  # what was gained is kept


equations = jax.jit(normal_equations, static_argnums=0)


def bench_network(samples=200, hidden=3):
    """Numbers for a 2-3-1 network and its analytic Jacobian (parameters, samples)."""
    rng = np.random.default_rng(11)
    p, y = rng.normal(size=(samples, 2)), rng.normal(size=samples)
    W, b, v, c = rng.normal(size=(hidden, 2)), rng.normal(size=hidden), rng.normal(size=hidden), 0.3
    a = np.tanh(p @ W.T + b)
    inner = v * (1 - a**2)
    J = np.concatenate(
        [(inner[:, :, None] * p[:, None, :]).reshape(samples, -1), inner, a, np.ones((samples, 1))],
        axis=1,
    ).T
    theta = np.concatenate([W.ravel(), b, v, [c]])
    return theta, (p, y), a @ v + c - y, J


def network_residual(theta, sample):
    p, y = sample
    W, b, v, c = theta[:6].reshape(3, 2), theta[6:9], theta[9:12], theta[12]
    return (v @ jnp.tanh(W @ p + b) + c - y)[None]


def test_normal_equations_are_the_analytic_ones():
    theta, samples, r, J = bench_network()
    cost, A, g = equations(network_residual, jnp.asarray(theta), tuple(map(jnp.asarray, samples)))
    # sums of 200 products of size 1: a few hundred roundings
    assert float(cost) == pytest.approx(r @ r, rel=1e-12)
    np.testing.assert_allclose(A, J @ J.T, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(g, J @ r, rtol=1e-11, atol=1e-11)


def test_equations_stacked_are_samples_side_by_side():
    """Two equations per sample, and one equation over twice the samples, are one problem."""

    def two(theta, sample):
        p, y = sample
        return jnp.concatenate(
            [network_residual(theta, (p, y)), 3 * network_residual(theta, (-p, y))]
        )

    def one(theta, sample):
        p, y, weight = sample
        return weight * network_residual(theta, (p, y))

    theta, (p, y), _, _ = bench_network()
    twice = (np.concatenate([p, -p]), np.concatenate([y, y]), np.repeat([1.0, 3.0], len(y)))
    stacked = equations(two, jnp.asarray(theta), (jnp.asarray(p), jnp.asarray(y)))
    flat = equations(one, jnp.asarray(theta), tuple(map(jnp.asarray, twice)))
    for a, b in zip(stacked, flat, strict=True):  # the same 400 products in another order
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-10)


def test_equal_calls_compile_once():
    """The second call on the same shapes must not trace the residual again."""
    calls = []

    def counted(theta, sample):
        calls.append(1)
        return (theta[0] * sample[0] - sample[1])[None]

    samples = (jnp.arange(5.0), 2 * jnp.arange(5.0))
    free = jnp.full(1, jnp.inf)
    counts = []
    for start in (1.0, 5.0):
        jax.block_until_ready(
            levenberg_marquardt(counted, jnp.array([[start]]), samples, None, -free, free)
        )
        counts.append(len(calls))
    assert counts[0] == counts[1] > 0
