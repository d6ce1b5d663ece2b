"""What is told of many units at once is what each is told alone."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from faultgauge.simulation.lanes import BY_NUMPY, lanes_last

KNOWN = np.array([[2.0, 0.5, -1.0], [0.0, 1.0, 3.0], [4.0, -2.0, 0.25]])
TIMES = np.array([[1.0, 0.0], [0.5, -2.0]])


def _small(x: Array, P: Array) -> Array:
    """Elementwise, products, sums, joins, with numbers that are the same for all units."""
    y = jnp.where(x > 0, KNOWN @ jnp.ones(3), jnp.exp(-x)) + jnp.max(P, axis=0)
    return jnp.concatenate([y, jnp.sum(P[:, None] * KNOWN[..., None], axis=(0, 1)), x[::2]])


def _placed(x: Array, P: Array) -> tuple[Array, ...]:
    """Places that are known: diagonals, gathers, what is put, added and multiplied there."""
    put = jnp.zeros(5).at[1:4].set(x).at[np.array([4, 0])].add(x[:2])
    scaled = P.at[1:].multiply(x[0])
    far = x[np.array([2, 0, 0, 1, 2, 2])]
    return jnp.diagonal(P), put, scaled, far, jnp.stack([x, P[1]], axis=1), jnp.diag(x)


def _twice(x: Array, P: Array) -> Array:
    """Two at one place, which is left to JAX."""
    return jnp.zeros(3).at[np.array([1, 1, 2])].add(x) + P[0]


def _looped(x: Array, P: Array) -> tuple[Array, Array]:
    """A loop, a choice by what is each unit's own, a solution: JAX's own ways."""
    end, said = jax.lax.scan(lambda c, k: (c * 0.5 + x, c[0] * k), x, jnp.arange(9.0))
    branch = jax.lax.cond(x[0] > 0, lambda: jnp.linalg.solve(P, x), lambda: -x)
    return end + branch, said


def _written_out(x: Array, P: Array) -> tuple[Array, Array]:
    """A loop of few turns and a sum of few terms, which have no loop, and a sum of many."""
    end, said = jax.lax.scan(
        lambda c, k: (c * 0.5 + x, jnp.sum(c) * k), x, jnp.arange(3.0), reverse=True
    )
    return end, said + jnp.sum(jnp.outer(TIMES[0], x)[0]) + jnp.sum(jnp.resize(x, 99))


def _inner(x: Array, P: Array) -> Array:
    """A batch within a unit, over the last axis."""
    return jax.vmap(lambda column: jnp.tanh(column) @ x, in_axes=1)(P[:, :2] @ TIMES)


@pytest.mark.parametrize("function", [_small, _placed, _twice, _looped, _written_out, _inner])
def test_many_are_told_what_each_is_told_alone(function: Callable) -> None:
    random = np.random.default_rng(3)
    x, P = random.normal(size=(7, 3)), random.normal(size=(7, 3, 3)) + 3 * np.eye(3)
    last = jnp.asarray(np.moveaxis(x, 0, -1)), jnp.asarray(np.moveaxis(P, 0, -1))
    many = jax.jit(lambda *given: lanes_last(function, *given))(*last)
    for k in range(7):
        alone = function(jnp.asarray(x[k]), jnp.asarray(P[k]))
        for got, own in zip(jax.tree.leaves(many), jax.tree.leaves(alone), strict=True):
            # the same sums, which may be rounded otherwise
            np.testing.assert_allclose(got[..., k], own, rtol=1e-13, atol=1e-14)


def test_what_is_the_same_for_all_is_told_for_each() -> None:
    found = lanes_last(lambda x: (jnp.arange(2.0), x + 1), jnp.zeros((3, 4)))
    assert [each.shape for each in found] == [(2, 4), (3, 4)]
    np.testing.assert_array_equal(found[0], [[0.0] * 4, [1.0] * 4])


ONE, TWO = np.array([[1.5, -2.0, 3.0], [0.0, 4.0, -5.5]]), np.array([[2.0, -2.0, 1.0]] * 2)
OPERATIONS = {
    "add": (lambda a, b: a + b, ONE, TWO),
    "broadcast_in_dim": (lambda a: jax.lax.broadcast_in_dim(a, (4, 2, 3), (1, 2)), ONE),
    "concatenate": (lambda a, b: jnp.concatenate([a, b], axis=1), ONE, TWO),
    "convert_element_type": (lambda a: a.astype(jnp.float32), ONE),
    "eq": (lambda a, b: a == b, ONE, TWO),
    "iota": (lambda a: a + jax.lax.broadcasted_iota(float, (2, 3), 1), ONE),
    "lt": (lambda a, b: a < b, ONE, TWO),
    "select_n": (lambda a, b: jax.lax.select_n(a < b, a, b), ONE, TWO),
    "slice": (lambda a: jax.lax.slice(a, (0, 0), (2, 3), (1, 2)), ONE),
    "squeeze": (lambda a: jax.lax.squeeze(a, (0,)), ONE[None]),
    "transpose": (lambda a: jax.lax.transpose(a, (1, 0)), ONE),
}


@pytest.mark.parametrize("name", BY_NUMPY)
def test_numpy_says_of_known_numbers_what_jax_does(name):
    of, *given = OPERATIONS[name]
    (eqn,) = [e for e in jax.make_jaxpr(of)(*given).eqns if e.primitive.name == name]
    before = [np.less(ONE, TWO), ONE, TWO] if name == "select_n" else given[: len(eqn.invars)]
    told = BY_NUMPY[name](*map(np.asarray, before), **eqn.params)
    wanted = eqn.primitive.bind(*map(jnp.asarray, before), **eqn.params)
    of_its_type = np.asarray(told, eqn.outvars[0].aval.dtype)  # as where it is called
    np.testing.assert_array_equal(of_its_type, wanted, strict=True)
