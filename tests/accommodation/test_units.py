"""Which units are in use: by hand, sample by sample."""

import jax.numpy as jnp
import numpy as np

from faultgauge.accommodation.units import Units

DT = jnp.asarray(1.0)


def used(losses, spare_of=(-1, 0)):
    """Units in use after each sample; `losses` one row per sample."""
    units = Units(spare_of, floor=0.2, persistence=2.0)
    state, found = units.init(), []
    for loss in np.array(losses, float):
        state, active = units.step(state, jnp.asarray(loss), DT)
        found.append([bool(each) for each in active])
    return found


def test_the_spare_takes_over_for_good():
    lost, well = [1.0, 0.0], [0.0, 0.0]
    found = used([well, lost, lost, well, well, well])
    assert found[1] == [True, False]
    # from the second sample on; the prime that looks well again stays out
    assert found[2:] == [[False, True]] * 4


def test_a_loss_that_comes_and_goes_switches_nothing():
    lost, well = [1.0, 0.0], [0.0, 0.0]
    assert used([lost, well, lost, well, lost]) == [[True, False]] * 5


def test_part_of_a_loss_is_no_reason_to_switch():
    assert used([[0.79, 0.0]] * 10)[-1] == [True, False]


def test_where_the_spare_is_bad_too_nothing_is_in_use():
    assert used([[1.0, 1.0]] * 3)[-1] == [False, True]  # the spare has had one sample in use
    assert used([[1.0, 1.0]] * 4)[-1] == [False, False]


def test_an_idle_spare_is_not_judged():
    assert used([[0.0, 1.0]] * 10)[-1] == [True, False]
