"""What a step answers does not depend on how many samples come at once."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from faultgauge.observers.follow import CHUNK, follow


class Said(NamedTuple):
    y: Array
    both: Array


class Lag(eqx.Module):
    """x+ = x + tanh(u) dt - x^3 dt: enough operations for two programs to round differently."""

    gain: Float[Array, ""]

    def step(self, state: Array, u: Array, dt: Array) -> tuple[Array, Said]:
        x = state + dt * (self.gain * jnp.tanh(u) - state**3)
        return x, Said(x * 1.7, jnp.stack([x, u]))


@pytest.fixture(scope="module")
def record():
    rng = np.random.default_rng(0)
    return rng.normal(size=3 * CHUNK + 17), rng.uniform(0.01, 0.2, 3 * CHUNK + 17)


def test_one_by_one_in_pieces_and_all_at_once_give_the_same_bits(record):
    lag, total = Lag(jnp.asarray(0.9)), len(record[0])
    state, whole = follow(lag, jnp.asarray(0.1), record)
    for size in (1, 7, CHUNK, CHUNK + 1):
        x, parts = jnp.asarray(0.1), []
        for k in range(0, total, size):
            x, said = follow(lag, x, [each[k : k + size] for each in record])
            parts.append(said)
        assert x == state
        np.testing.assert_array_equal(np.concatenate([p.y for p in parts]), whole.y)
        np.testing.assert_array_equal(np.concatenate([p.both for p in parts]), whole.both)


class Noting(Lag):
    """Notes each time that it is compiled for."""

    noted: list[None] = eqx.field(static=True, default_factory=list)

    def step(self, state: Array, u: Array, dt: Array) -> tuple[Array, Said]:
        self.noted.append(None)
        return super().step(state, u, dt)


def test_one_program_whatever_the_first_state_was_made_of(record):
    # a first state of a Python number, whose type JAX takes for a weak one, and the array after it
    lag = Noting(jnp.asarray(0.9), _Once())
    state, _ = follow(lag, jnp.asarray(0.1), [each[:3] for each in record])
    once = len(lag.noted)
    assert once > 0
    follow(lag, state, record)
    assert len(lag.noted) == once


class _Once(list):
    """A list that is itself alone, so that it may be a part of a program's name."""

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        return self is other


def test_it_is_the_recursion(record):
    u, dt = record
    x, expected = 0.1, []
    for k in range(len(u)):
        x += dt[k] * (0.9 * np.tanh(u[k]) - x**3)
        expected.append(1.7 * x)
    said = follow(Lag(jnp.asarray(0.9)), jnp.asarray(0.1), record)[1]
    # a stable recursion: rounding of 2e-16 per step does not grow
    np.testing.assert_allclose(said.y, expected, rtol=0, atol=1e-13)
