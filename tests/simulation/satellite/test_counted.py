"""Random numbers by counting: known answers, and the distribution."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from faultgauge.simulation.satellite.counted import normal, threefry, uniform

FULL = 0xFFFFFFFF


@pytest.mark.parametrize(
    ("key", "counter", "words"),
    [  # known answers of Random123 1.14, kat_vectors, threefry2x32 with 20 rounds
        ((0, 0), (0, 0), (0x6B200159, 0x99BA4EFE)),
        ((FULL, FULL), (FULL, FULL), (0x1CB996FC, 0xBB002BE7)),
        ((0x13198A2E, 0x03707344), (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0)),
    ],
)
def test_known_answers(key, counter, words):
    found = threefry(*(tuple(map(jnp.uint32, pair)) for pair in (key, counter)))
    assert tuple(map(int, found)) == words


def test_normal_numbers_of_many_seeds_are_normal():
    """And of neighbouring seeds and places uncorrelated: 3 standard errors of 40,000 pairs."""
    found = jax.vmap(lambda seed: jnp.stack([normal(seed, np.uint32(k), 10) for k in (0, 1)]))(
        jnp.arange(2000, dtype=jnp.uint32)
    )
    z = np.asarray(found).ravel()
    assert scipy.stats.kstest(z, "norm").pvalue > 1e-3
    for a, b in ((found[1:], found[:-1]), (found[:, 0], found[:, 1])):
        r = np.corrcoef(np.ravel(a), np.ravel(b))[0, 1]
        assert abs(r) < 3 / np.sqrt(np.size(a))


def test_uniform_numbers_lie_inside():
    found = uniform(jnp.uint32(3), np.uint32(FULL), 5)
    assert found.shape == (5,)
    assert found.min() > 0
    assert found.max() < 1
