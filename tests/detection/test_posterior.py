"""Mixture quantiles against SciPy, and a model that holds no noise."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm

from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import Noise, noise_of
from faultgauge.detection.calibration.noise_estimation import estimate_noise
from faultgauge.detection.posterior.posterior import Mixture, mixture_quantiles
from faultgauge.errors import InputError
from faultgauge.observers.branches import BranchInfo
from faultgauge.telemetry import Run
from lags import PLANT, STEP, driven
from models import as_stated

COUNT, SIGMA, PROCESS = 2000, 0.1, 0.05
LAG = f"""{PLANT}
[faults.push]
enters = "state"
target = "x"
[faults.bias]
enters = "output"
target = "x"
rate = 0.01
prior_per_hour = 3.6
max = 0.5
min = -0.5
"""


def model(text=LAG):
    points = np.random.default_rng(0).uniform(-1, 1, (40, 2))
    return as_stated(text, points)


def healthy(seed, samples=COUNT):
    """Exact under the hold, with noise of state and sensor of known size."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, samples // 20), 20)
    x = driven(u, steps=PROCESS * np.sqrt(STEP) * rng.standard_normal(samples))
    y = x + SIGMA * rng.standard_normal(samples)
    return Run(f"{seed}", "lag.csv", STEP * np.arange(samples), {"u": u, "x": y})


def quantile(weights, means, sds, level):
    """By SciPy's root finder on the mixture's distribution function, with its step at 0."""

    def below(x, with_zero):
        parts = sum(w * norm.cdf(x, m, s) for w, m, s in zip(weights, means, sds, strict=True))
        return parts + (1 - sum(weights)) * with_zero

    if below(0.0, 0.0) < level <= below(0.0, 1.0):
        return 0.0
    zero = below(0.0, 0.0) < level
    return brentq(lambda x: below(x, zero) - level, -50.0, 50.0, xtol=1e-12)


@pytest.mark.parametrize(
    ("weights", "means", "sds"),
    [
        ([0.999, 0.0], [2.0, 0.0], [0.1, 1.0]),  # a fault for certain
        ([0.6, 0.1], [-1.0, 3.0], [0.3, 0.5]),  # three answers at once
        ([0.01, 0.001], [1.0, -1.0], [0.1, 0.1]),  # healthy: both are 0
        ([0.03, 0.0], [1.0, 0.0], [0.2, 1.0]),  # the upper one reaches into the fault
        ([0.2, 0.3], [0.1, -0.1], [5.0, 2.0]),  # on both sides of 0
    ],
)
def test_quantiles_of_the_mixture_are_scipys(weights, means, sds):
    lo, hi = mixture_quantiles(*(jnp.array([each]) for each in (weights, means, sds)))
    for found, level in ((lo[0], 0.025), (hi[0], 0.975)):
        # 36 halvings of at most 100: 1e-9; weights below 1e-4 are left out
        assert found == pytest.approx(quantile(weights, means, sds, level), abs=1e-6)


def test_a_model_without_noise_is_refused():
    with pytest.raises(InputError, match="faultgauge calibrate"):
        noise_of(model())
    with pytest.raises(InputError, match="at least 100 samples"):
        estimate_noise(model(), [healthy(1, 60)])


def test_an_estimate_and_its_interval_keep_to_the_faults_limits():
    """A bias for certain, 0.7 +- 2 in the filter, of which the file allows -0.5 to 0.5."""
    levels = [SIGMA], [PROCESS], [], [1e-4], [100.0], [1e-3], [5.0], [], []
    run = healthy(1, 100)
    bank = build_fault_bank(model(), [run], Noise(*(np.array(each) for each in levels)))
    held = bank.sets.index((1,))
    p, f, sd = np.zeros(len(bank.sets) + 1), *np.zeros((2, len(bank.sets) + 1, 2))
    p[held], f[held, 1], sd[held, 1] = 1.0, 0.7, 2.0
    nothing = jnp.ones((2, 2))
    said = BranchInfo(
        *(jnp.asarray(each) for each in (p, f, sd)),
        *(jnp.zeros(1), nothing, nothing, jnp.ones(2), jnp.zeros(2)),
        *(*jnp.zeros((3, len(p), 2)), jnp.zeros(2), jnp.zeros(1), jnp.zeros(3), jnp.zeros(())),
    )
    found = Mixture.of(bank).marginal(said, nothing > 0)
    assert (found.f[1], found.lo[1], found.hi[1]) == (0.5, -0.5, 0.5)


def test_the_width_of_a_fault_that_is_there_is_that_of_draws_of_it():
    """A push of 2.0 +- 0.1 (p 0.6), or of 2.5 +- 0.2 with a bias (0.35), or nothing at all."""
    levels = [SIGMA], [PROCESS], [], [1e-4], [100.0], [1e-3], [5.0], [], []
    bank = build_fault_bank(model(), [healthy(1, 100)], Noise(*(np.array(each) for each in levels)))
    p, f, sd = np.zeros(len(bank.sets) + 1), *np.zeros((2, len(bank.sets) + 1, 2))
    for each, *told in (((), 0.05, 0.0, 0.0), ((0,), 0.6, 2.0, 0.1), ((0, 1), 0.35, 2.5, 0.2)):
        at = bank.sets.index(each)
        p[at], f[at, 0], sd[at, 0] = told
    nothing = jnp.ones((2, 2))
    said = BranchInfo(
        *(jnp.asarray(each) for each in (p, f, sd)),
        *(jnp.zeros(1), nothing, nothing, jnp.ones(2), jnp.zeros(2)),
        *(*jnp.zeros((3, len(p), 2)), jnp.zeros(2), jnp.zeros(1), jnp.zeros(3), jnp.zeros(())),
    )
    found = Mixture.of(bank).marginal(said, nothing > 0)
    rng = np.random.default_rng(0)
    with_bias = rng.random(1_000_000) < 0.35 / 0.95
    drawn = np.where(with_bias, rng.normal(2.5, 0.2, 1_000_000), rng.normal(2.0, 0.1, 1_000_000))
    assert found.lo[0] == 0.0  # of all: p is below 0.975
    # a standard deviation of a million draws is known to a thousandth
    assert float(found.sd[0]) == pytest.approx(drawn.std(), rel=3e-3)
    assert float(found.f[0] / found.p[0]) == pytest.approx(drawn.mean(), rel=1e-3)
