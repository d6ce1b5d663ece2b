"""When a fault is acted upon, and which units are in use: by hand, sample by sample."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.accommodation.alarm import Alarm
from faultgauge.accommodation.estimator import Estimate
from faultgauge.accommodation.units import Units

DT = jnp.asarray(1.0)


def engaged(sizes, sd=0.0, unexplained=1.0):
    """Whether the one fault is engaged after each sample, 1 s apart."""
    alarm = Alarm(limits=jnp.array([1.0]), persistence=3.0, settling=2.0)
    state, found = alarm.init(), []
    for size in sizes:
        estimate = Estimate(
            jnp.zeros(1), jnp.array([float(size)]), jnp.array([sd]), jnp.asarray(unexplained)
        )
        state, acted = alarm.step(state, estimate, DT)
        found.append(bool(acted[0]))
    return np.array(found)


def test_a_steady_fault_is_acted_upon_once_it_has_settled_and_lasted():
    # the slow follower leaves exp(-k/2) of a step after k samples: below a quarter from k = 3 on,
    # so that three samples on end speak for it at k = 3, 4, 5
    assert list(np.flatnonzero(engaged([2.0] * 8))) == [4, 5, 6, 7]


def test_a_fault_below_its_limit_is_left_alone():
    assert not engaged([0.99] * 30).any()


def test_a_spike_is_left_alone():
    assert not engaged([0, 0, 5, 5, 0, 0, 0, 5, 5, 0, 0]).any()


def test_an_estimate_that_still_grows_is_left_alone():
    # it doubles every sample: it always is more than a quarter ahead of its follower
    assert not engaged(2.0 ** np.arange(15)).any()


def test_an_uncertain_estimate_is_left_alone():
    assert not engaged([2.0] * 20, sd=0.7).any()  # 2.0 < 3 * 0.7
    assert engaged([2.0] * 20, sd=0.6).any()


def test_what_no_declared_fault_explains_is_left_alone():
    assert not engaged([2.0] * 20, unexplained=5.0).any()


def test_it_is_released_below_half_its_limit_and_not_before():
    held = [2.0] * 10
    assert engaged([*held, *[0.6] * 20])[-1]
    # three samples below 0.5, the third of them releases
    assert list(np.flatnonzero(~engaged([*held, *[0.4] * 5])[10:])) == [2, 3, 4]


def test_a_negative_fault_counts_as_much():
    assert np.array_equal(engaged([2.0] * 8), engaged([-2.0] * 8))


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


@pytest.mark.parametrize("limit", [0.5, 2.0])
def test_the_limit_is_in_the_units_of_the_fault(limit):
    alarm = Alarm(limits=jnp.array([limit]), persistence=1.0, settling=0.1)
    state = alarm.init()
    one = Estimate(jnp.zeros(1), jnp.ones(1), jnp.zeros(1), jnp.ones(()))
    for _ in range(5):
        state, acted = alarm.step(state, one, DT)
    assert bool(acted[0]) == (limit < 1.0)
