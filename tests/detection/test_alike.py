"""Faults that no data tell apart share what is said of any of them, by hand arithmetic."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.detection.posterior.alike import Alike
from faultgauge.observers.branches import BranchInfo
from faultgauge.plants.signals import Fault

# a heater's bias and a leak, of which -2 do what one of the bias does; a sensor's
FAULTS = (
    Fault("bias", "input", "Q", "", -30.0, 30.0),
    Fault("leak", "state", "T", "", -15.0, 15.0),
    Fault("gauge", "output", "T", "", -5.0, 5.0),
)
SETS = ((), (0,), (1,), (2,), (0, 2), (1, 2))


def alike(pairs=((0, 1, -2.0),), faults=FAULTS):
    return Alike.of(faults, SETS, pairs)


def said(p, size=(-6.0, 3.0, 1.0), sd=(0.5, 0.2, 0.1)):
    f, wide = np.tile(size, (7, 1)), np.tile(sd, (7, 1))
    onset = np.array([[100.0, 3.0], [40.0, 4.0], [7.0, 1.0]])
    ever = np.array([0.9, 0.2, 0.3])
    rest = np.zeros(2), np.zeros((3, 2))
    behind = np.zeros(3), *np.zeros((3, 7, 3)), np.zeros(3), np.zeros(1), np.zeros(3), np.zeros(())
    return BranchInfo(*map(jnp.asarray, (np.array(p), f, wide, *rest, onset, ever, *behind)))


def test_each_is_as_likely_and_has_the_size_that_does_the_same():
    given = said([0.01, 0.6, 0.2, 0.02, 0.1, 0.05, 0.02])
    found = alike().told(given)
    assert found.p == pytest.approx([0.01, 0.4, 0.4, 0.02, 0.075, 0.075, 0.02])
    # 0.75 of the bias' own -6 and 0.25 of the leak's 3, which is a bias of -1.5
    mean = 0.75 * -6 + 0.25 * -1.5
    square = 0.75 * (36 + 0.25) + 0.25 * (2.25 + 0.1**2)
    assert found.f[1, 0] == pytest.approx(mean)
    assert found.sd[1, 0] == pytest.approx(np.sqrt(square - mean**2))
    assert found.f[2, 1] == pytest.approx(-2 * mean)
    # beside the sensor's fault, which is what it was, two thirds and one
    assert found.f[4, :] == pytest.approx([(2 * -6 - 1.5) / 3, 3.0, 1.0])
    assert found.f[5, 1:] == pytest.approx([(2 * 12 + 3) / 3, 1.0])
    # one of the two began: 0.7 and 0.25 of likelihood
    w = 0.7 / 0.95
    assert found.onset[0] == pytest.approx(found.onset[1])
    assert found.onset[1, 0] == pytest.approx(w * 100 + (1 - w) * 40)
    assert found.onset[2] == pytest.approx([7.0, 1.0])
    assert found.ever == pytest.approx([0.55, 0.55, 0.3])


def test_what_is_beyond_its_limits_is_not_it():
    """A bias of -9 is a leak of 18, and no leak is larger than 15."""
    given = said([0.01, 0.9, 0.05, 0.0, 0.0, 0.0, 0.04], size=(-9.0, 18.0, 0.0))
    found = alike().told(given)
    assert found.p == pytest.approx([0.01, 0.95, 0.0, 0.0, 0.0, 0.0, 0.04])


def test_where_no_two_are_alike_nothing_changes():
    given = said([0.01, 0.6, 0.2, 0.02, 0.1, 0.05, 0.02])
    assert alike(pairs=()).told(given) is given


def test_a_third_is_like_both():
    """The size of the third goes by the first, whatever way they were compared."""
    faults = (*FAULTS[:2], Fault("draught", "state", "T", "", -90.0, 90.0))
    given = said([0.1, 0.3, 0.3, 0.3, 0.0, 0.0, 0.0], size=(1.0, -2.0, -10.0), sd=(0.0, 0.0, 0.0))
    found = alike(((0, 1, -2.0), (0, 2, -10.0), (1, 2, 5.0)), faults).told(given)
    assert found.p[1:4] == pytest.approx([0.3] * 3)
    assert found.f[3, 2] == pytest.approx(-10.0)
    assert found.sd[3, 2] == pytest.approx(0.0, abs=1e-6)
