"""Sizes at which a fault does something else: a limit's reach against SciPy's integrals, and one
that is told from a loss of gain."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from faultgauge.detection.bank import large_faults as at_large
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import Noise
from faultgauge.observers.follow import follow
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.telemetry import Run
from models import as_stated

A, STEP, SIGMA, PROCESS, SIZE, COUNT = 0.5, 0.5, 0.02, 1e-3, 1e-3, 600
TEXT = """
name = "clipped"
[states.x]
derivative = "clip(u, -L, L) - 0.5*x"
[inputs.u]
hold = "zero"
[outputs.x]
value = "x"
[parameters]
L = { value = 1, fixed = true }
[faults.limit]
enters = "parameter"
target = "L"
relative = true
min = -0.9
max = 0
[faults.gain]
enters = "gain"
target = "u"
[faults.push]
enters = "state"
target = "x"
[detection]
max_simultaneous = 1
"""
LIMIT, GAIN, PUSH = range(3)
EVEN = np.linspace(-1, 1, 2001)  # inputs of the training envelope, all as likely


def model():
    points = np.stack([0 * EVEN, EVEN], axis=1)
    return as_stated(TEXT, points)


def bank(log):
    driven = np.array([SIZE]), np.array([50.0])
    nothing = np.array([1e-9]), np.array([5.0]), np.zeros(0), np.zeros(0)
    levels = np.array([SIGMA]), np.array([PROCESS]), np.zeros(0), *driven, *nothing
    return build_fault_bank(model(), [log], Noise(*levels), 5000.0)


def run(seed, onset, loss):
    """Exact under the hold; from `onset` on the input is cut off at 1 - `loss`."""
    rng = np.random.default_rng(seed)
    u = np.clip(0.35 * rng.standard_normal(COUNT), -1, 1)
    limit = np.where(np.arange(COUNT) < onset, 1.0, 1 - loss)
    fade, x = np.exp(-A * STEP), np.zeros(COUNT)
    noise = PROCESS * np.sqrt(STEP) * rng.standard_normal(COUNT)
    for k in range(COUNT - 1):
        felt = np.clip(u[k], -limit[k], limit[k])
        x[k + 1] = fade * x[k] + (1 - fade) / A * felt + noise[k]
    y = x + SIGMA * rng.standard_normal(COUNT)
    return Run("r", "r.csv", STEP * np.arange(COUNT), {"u": u, "x": y})


def cosine(p, q):
    """Of what limits that are lower by p and q cut off inputs that are even in 0..1."""

    def together(a, b):
        low = 1 - min(a, b)
        return quad(lambda u: (u - (1 - a)) * (u - (1 - b)), low, 1)[0]

    return together(p, q) / np.sqrt(together(p, p) * together(q, q))


def test_sizes_that_do_the_same_are_those_of_scipys_integrals():
    sizes = np.array([0.2, 0.3, 0.5, 0.9])
    faults = np.zeros((4, 3))
    faults[:, LIMIT] = -sizes
    x, u = np.zeros((len(EVEN), 1)), EVEN[:, None]
    plant = with_faults(model().plant, model().plant.signals.faults)
    effects = np.asarray(
        at_large._effects(plant, jnp.asarray(x), jnp.asarray(u), jnp.asarray(faults))
    )
    length = np.linalg.norm(effects, axis=1)
    found = effects @ effects.T / np.outer(length, length)
    expected = [[cosine(p, q) for q in sizes] for p in sizes]
    # 2001 points stand for the integral: the edge of what is cut off is known to a thousandth
    np.testing.assert_allclose(found, expected, atol=5e-3)


def test_every_size_of_a_limit_is_near_one_that_is_followed_and_what_is_linear_has_none():
    each = bank(run(0, COUNT, 0.0))
    filter = each.modes.filter
    owner, reach = np.array(filter.far), np.asarray(filter.reach)
    low, high = (np.asarray(limit)[-len(owner) :] for limit in each.modes.prior[1:3])
    assert np.all((low <= reach) & (reach <= high))
    assert set(owner) == {LIMIT, GAIN}  # a push is as its size
    assert np.all(reach[owner == GAIN] < 0)  # and so is a loss of gain: more of it is cut off
    low, high, reach = (sorted(limit[owner == LIMIT]) for limit in (low, high, reach))
    assert low[0] == -0.9  # the limit of the fault
    np.testing.assert_allclose(high[:-1], low[1:])  # no gap and no overlap
    probe = float(filter.probe[LIMIT])
    followed = [probe, *-np.array(reach)]
    for size in np.linspace(probe, 0.9, 50):
        # sizes between those of the grid, of which each is 4 % larger than the one before
        assert max(cosine(size, other) for other in followed) > at_large.ALIKE - 0.02


SMALLER = (pytest.param(each, marks=pytest.mark.study) for each in (0.35, 0.6))


@pytest.mark.parametrize("loss", [*SMALLER, 0.8])
def test_a_limit_is_told_from_a_loss_of_gain(loss):
    onset = 300
    log = run(1, onset, loss)
    each = bank(log)
    u, y = log.columns["u"][:, None], log.columns["x"][:, None]
    size = len(each.modes.filter.scale)
    start = each.modes.init(
        jnp.zeros(size), jnp.asarray(np.r_[0.1, SIZE, np.zeros(size - 2)]), jnp.asarray(u[0])
    )
    _, info = follow(each.modes, start, (u, y, np.r_[0.0, np.full(COUNT - 1, STEP)]))
    limit = each.sets.index((LIMIT,))
    assert info.p[onset - 20 : onset, 0].min() > 0.9
    assert info.p[-1, limit] > 0.99
    told, sd = info.f[-1, limit, LIMIT], info.sd[-1, limit, LIMIT]
    assert told == pytest.approx(-loss, abs=4 * sd + 1e-3)
    assert sd < 0.02
