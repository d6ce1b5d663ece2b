"""A function of one unit on rows is what `jax.vmap` makes of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.simulation.side_by_side import rows, side_by_side, whole

UNITS = 5


def every(function, *args):
    return whole(side_by_side(function, *rows(args)))


def rotated(v, A):
    """Products, cross products, norms and sums, a constant matrix with zeros and ones."""
    B = jnp.concatenate([A @ v, jnp.zeros(1)])
    C = jnp.eye(4)[:3] @ B + jnp.cross(v, A[1]) / jnp.linalg.norm(v)
    return C, jnp.sum(A.T @ A, axis=1), jnp.where(v > 0, v, jnp.tanh(v)).max()


def looped(v, A):
    """A scan whose clock is the same for all, with a constant among what is given step by step."""

    def body(carried, now):
        t, x = carried
        u, dead = now
        x = x + 0.1 * (A @ x + jnp.sin(t) * u)
        x = jnp.where(jnp.isnan(dead), x, dead)
        return (t + 0.1, x), x[0]

    given = jnp.stack([v, 2 * v, -v]), jnp.full((3, 3), jnp.nan)
    (t, x), seen = jax.lax.scan(body, (jnp.zeros(()), v), given)
    return t, x, seen


def chosen(v, A):
    """The first of the largest, and an operation that no row knows: a sort."""
    return jnp.argmax(v), A[:, ::-1][1:], jnp.sort(v), jnp.stack([v[0], v[2]])


@pytest.mark.parametrize("function", [rotated, looped, chosen])
def test_rows_are_what_vmap_makes(function):
    rng = np.random.default_rng(0)
    v, A = jnp.asarray(rng.normal(size=(3, UNITS))), jnp.asarray(rng.normal(size=(3, 3, UNITS)))
    v = v.at[:, 0].set(1.0)  # of equals, the first
    expected = jax.vmap(function, in_axes=-1, out_axes=-1)(v, A)
    for a, b in zip(every(function, v, A), expected, strict=True):
        assert a.shape == b.shape
        # sums of three products of numbers of size 1, in another order
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-14)


def test_what_is_around_is_the_same_for_all():
    """Traced or known: 2 x + 1 with a 2 that is traced."""
    x = jnp.arange(4.0)

    @jax.jit
    def twice(two, x):
        return whole(side_by_side(lambda x: two * x + jnp.asarray(1.0), *rows((x,)), one=two / 2))

    np.testing.assert_array_equal(twice(jnp.asarray(2.0), x), [1, 3, 5, 7])


def test_a_long_sum_is_the_same_divided_by_one():
    rng = np.random.default_rng(1)
    a = jnp.asarray(rng.normal(size=(10, UNITS)))
    plain = whole(side_by_side(jnp.sum, *rows((a,))))
    divided = whole(side_by_side(jnp.sum, *rows((a,)), one=jnp.ones(())))
    np.testing.assert_array_equal(plain, divided)
    np.testing.assert_allclose(plain, np.sum(a, axis=0), rtol=1e-13)
