"""Levels near to others, by the slopes under these, beside the filter itself under each."""

import numpy as np
import pytest

from faultgauge.detection.calibration import innovation_likelihood
from faultgauge.detection.calibration.innovation_likelihood import Likelihood, healthy_stretches
from faultgauge.detection.calibration.nearby_levels import EXACT
from faultgauge.detection.calibration.noise_levels import first_guess, levels_of, logs_of, names_of
from faultgauge.detection.calibration.scoring import DIFFERENCES, _information
from faultgauge.telemetry import Run
from models import as_stated

TANKS = """
name = "two tanks"
[states.a]
derivative = "k*u*v - c*a"
[states.b]
derivative = "c*a - c*b - tanh(5*b)/50"
[inputs.u]
[inputs.v]
[outputs.a]
value = "a"
[outputs.b]
value = "b"
[outputs.sum]
value = "a + b + u/2"
[parameters]
k = { value = 0.2 }
c = { value = 0.3, min = 0 }
"""
STEP, COUNT = 0.5, 300
BESIDE = {
    "wander": [0, 0, 0.05], "wandering": [0, 0, 20.0], "late": [0, 0, 0.3], "lag": [0, 0, 3.0],
    "stray": [0, 0.02], "straying": [0, 5.0], "lean": [-0.6, 0], "leaning": [2.0, 0],
    "trail": [0, 0.8, 0], "zero": [0.05, 0, 0], "bend": [0.05, 0],
    "grip": [0, 0.02], "gripping": [0, 4.0], "slip": [0, 0.1],
    "travel": [0, 2.0], "jitter": [0, 0.05, 0],
    "doubt": [2.0, 0, 0, 1.5], "above": [1.2, -np.inf, -np.inf, 0.15],
}  # fmt: skip


def model():
    points = np.random.default_rng(0).uniform([0, -1, 0.5, 0.5], [2, 1, 1.5, 1.5], (60, 4))
    return as_stated(TANKS, points, (("a", 0), ("b", 0)), ("a", "b", "sum"))


def log(seed):
    """By Euler's method, which is the plant's own error here, with noise of every kind."""
    rng = np.random.default_rng(seed)
    u, v = (np.repeat(rng.uniform(0.5, 1.5, COUNT // 20), 20) for _ in range(2))
    a, b = np.full(COUNT, 0.5), np.full(COUNT, 0.3)
    for k in range(COUNT - 1):
        a[k + 1] = a[k] + STEP * (0.2 * u[k] * v[k] - 0.3 * a[k]) + 0.01 * rng.standard_normal()
        b[k + 1] = b[k] + STEP * (0.3 * (a[k] - b[k]) - np.tanh(5 * b[k]) / 50)
    y = {"a": a, "b": b, "sum": a + b + u / 2}
    y = {name: each + 0.02 * rng.standard_normal(COUNT) for name, each in y.items()}
    return Run(f"{seed}", "tanks.csv", STEP * np.arange(COUNT), {"u": u, "v": v, **y})


def told(beside, large, monkeypatch):
    """(names of levels, likelihoods under each a little larger), by slopes where a filter of more
    numbers than `large` has them."""
    monkeypatch.setattr(innovation_likelihood, "LARGE", large)
    runs = [log(0), log(1)]
    stretches = healthy_stretches(model(), runs)
    noise = first_guess(model(), runs, stretches)
    noise = noise._replace(**{name: np.array(each) for name, each in beside.items()})
    start = logs_of(noise)
    at = np.flatnonzero(np.isfinite(start))
    names = np.array(names_of(noise))[at]
    many = [noise]
    for k in at:
        more = start.copy()
        more[k] += DIFFERENCES[0]
        many.append(levels_of(more, noise))
    apart = np.array([False, *np.isin(names, EXACT)])
    batch = Likelihood.of(model(), runs, noise, stretches)
    first = batch.run_along(many[:1])[1]
    return names, batch.near(many, apart, first[0] if first else None)


@pytest.mark.parametrize(
    "beside", [pytest.param({}, marks=pytest.mark.study), BESIDE], ids=["usual", "all"]
)
def test_slopes_of_all_levels_are_those_of_the_filter_itself(beside, monkeypatch):
    """A slope that is off by a root of the information moves a step by a standard deviation of
    what is looked for: a tenth of that is borne, and what is of second order."""
    names, near = told(beside, 0, monkeypatch)
    _, exact = told(beside, 1000, monkeypatch)
    assert near.cost[0] == pytest.approx(exact.cost[0], rel=1e-9)
    slopes, wanted = ((each.cost[1:] - each.cost[0]) / DIFFERENCES[0] for each in (near, exact))
    M, own = (_information(each, DIFFERENCES[0]) for each in (near, exact))
    roots = np.sqrt(np.diagonal(own))
    for name, slope, right, root in zip(names, slopes, wanted, roots, strict=True):
        assert slope == pytest.approx(right, rel=0.03, abs=0.1 * root), name
    np.testing.assert_allclose(M / np.outer(roots, roots), own / np.outer(roots, roots), atol=0.05)
