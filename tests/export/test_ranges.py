"""Where integers are said to lie, they lie, whatever a program is given."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.export.compile import ExportedStep, print_step
from faultgauge.export.program import trace
from faultgauge.export.ranges import narrowed, span_of

TABLE = np.array([3, -1, 7, 0])


def turned(k):
    return jax.lax.scan(lambda c, j: (c + (j > k), c), jnp.asarray(0), jnp.arange(5))


def less(j, turn):
    return jnp.where(j >= turn, j - turn, j)


FUNCTIONS = {
    "argmax": (lambda x, k: jnp.argmax(x), (0, 3)),
    "a place counted from the end": (lambda x, k: jnp.argmin(x) - 4, (-4, -1)),
    "a table": (lambda x, k: jnp.asarray(TABLE)[jnp.argmax(x)], (-1, 7)),
    "limits": (lambda x, k: jnp.clip(k, -2, 5) * 3 - 1, (-7, 14)),
    "rest": (lambda x, k: jax.lax.rem(jnp.abs(jnp.clip(k, -9, 9)), jnp.asarray(4)), (0, 3)),
    "quotient": (lambda x, k: jax.lax.div(jnp.argmax(x), jnp.asarray(2)), (0, 1)),
    "sums": (lambda x, k: jnp.sum(x > k, axis=0), (0, 4)),
    "sides": (lambda x, k: jnp.sign(jnp.clip(k, 0, 3)) - 1, (-1, 0)),
    "choice": (lambda x, k: jnp.where(x[0] > 0, jnp.clip(k, 2, 4), 9), (2, 9)),
    "a place less a turn": (lambda x, k: less(jnp.argmax(x), 2), (0, 1)),
    "on one side of a limit": (lambda x, k: jnp.where(k < 3, 3, k), (3, 2**63)),
    "0 or no number": (lambda x, k: jnp.sum(0.0 * x * k - 0.0 * x) > 1e-9, (0, 0)),
    "above 0 or no number": (lambda x, k: jnp.any(jnp.where(k > 2, 0.0 / x, 0) < -1e-9), (0, 0)),
    "conditions": (lambda x, k: jax.lax.cond(k > 2, lambda: 5, lambda: -1), (-1, 5)),
    "cells": (lambda x, k: jnp.asarray(TABLE).at[jnp.argmax(x)].set(12), (-1, 12)),
    "a loop": (lambda x, k: turned(k)[1] * 0 + jnp.argmax(x), (0, 3)),
}


def found(function):
    program = trace(function, jnp.zeros(4), jnp.asarray(0))
    narrowed(program)
    (out,) = program.body.outputs
    return span_of(out)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_results_lie_where_they_are_said_to(name):
    function, (least, most) = FUNCTIONS[name]
    low, high = found(function)
    assert least <= low.min()
    assert high.max() <= most
    rng = np.random.default_rng(0)
    once = jax.jit(function)
    for _ in range(100):
        said = once(rng.standard_normal(4) * rng.choice([1.0, np.nan]), rng.integers(-9, 9))
        assert np.all((low <= said) & (said <= high))


def test_a_real_number_of_a_loop_is_not_what_it_began_with():
    def carried(x, k):
        total = jax.lax.scan(lambda c, j: (c + x[0], c), jnp.asarray(0.0), jnp.arange(5))[0]
        return total > 0.5

    low, high = found(carried)
    assert (low, high) == (0, 1)


def test_what_grows_from_turn_to_turn_may_be_any_number():
    low, high = found(lambda x, k: turned(k)[0] + 0 * k)
    assert low.min() < -1e18
    assert high.max() > 1e18


def test_what_wraps_around_may_be_any_number():
    low, high = found(lambda x, k: jnp.clip(k, 0, 2**40) * 2**40)
    assert low.min() < -1e18
    assert high.max() > 1e18


def test_only_what_comes_from_outside_is_kept_within_an_array():
    table = jnp.asarray([0.5, 1.5, 3.5, 0.0])

    def step(state, sample):
        return state, {"own": table[jnp.argmax(sample["x"])], "given": table[sample["k"]]}

    sample = {"x": jnp.zeros(4), "k": jnp.asarray(0)}
    text = print_step(ExportedStep(step, jnp.zeros(()), sample, {}), "one").step
    own = next(line for line in text.splitlines() if "out->own" in line)
    assert "?" not in own
    assert text.count("fg_at(") == 1
