"""What a fleet tells of its units, against numbers that were drawn."""

import numpy as np
import pytest

from faultgauge.identification.population import Law, population
from faultgauge.plants.spec import Parameter

GAIN, OFFSET = Parameter("gain", 1.0, min=0.0), Parameter("offset", 0.0)


def drawn(seed, units, spread):
    random = np.random.default_rng(seed)
    e = random.standard_normal((units, 2))
    return np.stack([2.0 * np.exp(spread * e[:, 0]), -3.0 + spread * e[:, 1]], axis=1)


def test_mean_and_spread_of_many_units():
    """300 units tell a spread to 4 %, and a mean to a seventeenth of it; four times that here."""
    found = population([GAIN, OFFSET], drawn(0, 300, 0.2), np.full((300, 2), 1e-4)).laws
    assert abs(np.log(found["gain"].center / 2)) < 4 * 0.2 / 17
    assert found["gain"].spread == pytest.approx(0.2, rel=0.16)
    assert found["offset"].spread == pytest.approx(0.2, rel=0.16)
    assert found["gain"].error == pytest.approx(0.2 / 300**0.5, rel=0.2)


def test_what_is_not_known_well_counts_less():
    """A quarter of the units is known to 1, the others to 0.01: the mean is theirs."""
    values, errors = drawn(1, 40, 0.05), np.full((40, 2), 0.01)
    values[:10, 1] += np.random.default_rng(2).standard_normal(10)
    errors[:10, 1] = 1.0
    law = population([GAIN, OFFSET], values, errors).laws["offset"]
    assert law.center == pytest.approx(values[10:, 1].mean(), abs=0.01)
    assert law.spread < 0.1


@pytest.mark.parametrize("seed", range(5))
def test_one_contaminated_log_of_five_is_outvoted(seed):
    """Its constant is off by half, five spreads: the mean moves by less than its error, and the
    plain mean would move by 1.8 of it, log(1.5) / 5 / 0.1 sqrt(5)."""
    values, errors = drawn(seed, 5, 0.1), np.full((5, 2), 0.01)
    clean = population([GAIN, OFFSET], values, errors)
    values[2] *= 1.5
    dirty = population([GAIN, OFFSET], values, errors)
    for name in ("gain", "offset"):
        law = clean.laws[name]
        assert abs(law.off(dirty.laws[name].center)) * law.spread < law.error, name
    assert dirty.unlike[2] > 0.9
    assert np.delete(dirty.unlike, 2).max() < 0.1


def test_fewer_than_four_units_tell_nothing():
    values = drawn(0, 5, 0.1)
    values[:2, 1] = np.nan
    found = population([GAIN, OFFSET], values, np.full((5, 2), 0.01))
    assert set(found.laws) == {"gain"}
    assert np.all(found.unlike < 0.5)


def test_how_far_a_unit_is_off():
    assert Law(2.0, 0.1, 0.01, log=True).off(2.0 * np.exp(0.3)) == pytest.approx(3)
    assert Law(2.0, 0.1, 0.01, log=False).off(1.8) == pytest.approx(-2)
