"""When an explanation is no longer told, by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.detection.posterior.consistency import Consistency, limit_of
from faultgauge.observers.branches import BranchInfo

P = np.array([0.1, 0.6, 0.2, 0.1])  # none, two sets, something undeclared
WINDOW = 10.0


def told(times, nis):
    each = Consistency(np.array([2.0, 1.5]), np.asarray(WINDOW))
    state, found = each.init(), []
    for t, own in zip(times, nis, strict=True):
        rest = [jnp.zeros(1)] * 12
        said = BranchInfo(jnp.asarray(P), *rest, nis=jnp.array(own))
        state, said = each.step(state, jnp.asarray(t), said)
        found.append(np.asarray(said.p))
    return np.array(found)


def test_limits_are_three_times_as_far_above_the_median_as_the_worst():
    nis = np.array([[1.0, 0.5], [1.2, 0.5], [0.9, 0.6], [1.0, 0.7], [2.0, 0.6]])
    np.testing.assert_allclose(limit_of(nis), [1.0 + 3 * 1.0, 0.6 + 3 * 0.1])


@pytest.mark.parametrize("nis", [[2.1, 0.0], [0.0, 1.6]])
def test_beyond_a_limit_nothing_explains_and_declared_faults_are_not_told_for_a_while(nis):
    """In either window; afterwards for 10 s, the longer window, and then as before."""
    times = [0.0, 5.0, 6.0, 16.0, 16.1]
    found = told(times, [[1.9, 1.4], nis, *[[1.0, 1.0]] * 3])
    np.testing.assert_allclose(found[0], P)
    np.testing.assert_allclose(found[1], [0, 0, 0, 1.0])
    np.testing.assert_allclose(found[2], [0.1, 0, 0, 0.9])
    np.testing.assert_allclose(found[3], P if times[3] > 15 else [0.1, 0, 0, 0.9])
    np.testing.assert_allclose(found[4], P)


def test_what_comes_and_goes_for_long_is_not_over_for_as_long():
    """Seen at 0, 8, 16 and 24 s: nothing is told until 48 s, as it lasted for 24 s."""
    times = [0.0, 8.0, 16.0, 24.0, 30.0, 47.9, 48.1, 60.0]
    seen = [0.0, 8.0, 16.0, 24.0]
    found = told(times, [[3.0, 1.0] if t in seen else [1.0, 1.0] for t in times])
    kept = np.isclose(found, P).all(axis=1)
    np.testing.assert_array_equal(kept, [False] * 6 + [True] * 2)


def test_without_limits_all_is_told():
    each = Consistency(np.full(2, np.inf), np.asarray(WINDOW))
    said = BranchInfo(jnp.asarray(P), *[jnp.zeros(1)] * 12, nis=jnp.array([1e9, 1e9]))
    np.testing.assert_allclose(each.step(each.init(), jnp.asarray(0.0), said)[1].p, P)
