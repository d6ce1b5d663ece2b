"""Rows that need no answer keep their state, whatever they hold."""

import jax
import jax.numpy as jnp
import numpy as np

from faultgauge.observers.rows import where_needed


def answered(state, needed):
    def of(state, given):
        return state + given, jnp.log(state)

    return where_needed(of, needed, state, jnp.ones_like(state))


def test_only_rows_that_are_needed_go_on_and_answer():
    state = jnp.array([1.0, np.nan, np.e])
    after, said = answered(state, jnp.isfinite(state))
    np.testing.assert_array_equal(after, [2, np.nan, 1 + np.e])
    np.testing.assert_allclose(said, [0, 0, 1])


def test_many_at_once():
    state = jnp.array([[1.0, 2.0], [3.0, 4.0]])
    needed = jnp.array([[True, False], [False, True]])
    after, _ = jax.vmap(answered)(state, needed)
    np.testing.assert_array_equal(after, [[2, 2], [3, 5]])
