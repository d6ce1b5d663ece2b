"""Dead time in logs, against arithmetic by hand and interpolation by NumPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from faultgauge.errors import InputError
from faultgauge.telemetry.dead_time import delayed
from faultgauge.telemetry.runs import Run

NAN = np.nan


def run(t, **columns):
    arrays = {name: np.array(values, float) for name, values in columns.items()}
    return Run("a", "a.csv", np.array(t, float), arrays)


def shifted(t, u, delay, *, held):
    return delayed(run(t, u=u), {"u": delay}, {"u"} if held else ()).columns["u"]


@pytest.mark.parametrize("held", [True, False])
def test_whole_steps_move_the_column(held):
    t, u = [0, 1, 2, 3, 4], [5, 7, 6, 9, 8]
    np.testing.assert_array_equal(shifted(t, u, 2.0, held=held), [NAN, NAN, 5, 7, 6])


@pytest.mark.parametrize("start", [0.0, 1.7e9])
@pytest.mark.parametrize("held", [True, False])
@given(count=st.integers(1, 18), step=st.sampled_from([0.1, 0.001, 1 / 3, 60.0]))
def test_whole_steps_survive_the_rounding_of_time(start, held, count, step):
    t = start + step * np.arange(20)
    u = np.random.default_rng(0).normal(size=20)
    found = shifted(t, u, count * step, held=held)
    expected = np.concatenate([np.full(count, NAN), u[:-count]])
    np.testing.assert_array_equal(found, expected)


def test_a_held_input_keeps_its_last_value():
    found = shifted([0, 1, 2, 3], [5, 7, 6, 9], 0.25, held=True)
    np.testing.assert_array_equal(found, [NAN, 5, 7, 6])
    found = shifted([0, 1, 2, 3], [5, 7, 6, 9], 1.75, held=True)
    np.testing.assert_array_equal(found, [NAN, NAN, 5, 7])


def test_another_input_runs_straight():
    found = shifted([0, 1, 2, 3], [5, 7, 6, 9], 0.25, held=False)
    np.testing.assert_array_equal(found, [NAN, 6.5, 6.25, 8.25])


@pytest.mark.parametrize("held", [True, False])
@given(seed=st.integers(0, 1000), delay=st.floats(0.01, 9.0))
def test_uneven_times(held, seed, delay):
    """Against np.interp, and against the last sample that is not later."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.6, 1.4, 15))
    u = rng.normal(size=15)
    found = shifted(t, u, delay, held=held)
    sought = t - delay
    # within a thousandth of a step a sample counts as met: nothing to compare with there
    clear = np.min(np.abs(sought[:, None] - t), axis=1) > 0.002
    known = sought >= t[0]
    if held:
        expected = np.array([u[t <= when][-1] for when in sought[clear & known]])
    else:
        expected = np.interp(sought[clear & known], t, u)
    np.testing.assert_allclose(found[clear & known], expected, rtol=0, atol=1e-12)  # rounding
    assert np.all(np.isnan(found[clear & ~known]))


@pytest.mark.parametrize("held", [True, False])
def test_what_was_commanded_in_a_gap_is_not_known(held):
    t = [0, 1, 2, 3, 10, 11, 12, 13]
    found = shifted(t, np.arange(8), 1.5, held=held)
    assert np.isnan(found).tolist() == [True, True, False, False, True, True, False, False]
    # at its edges it is
    np.testing.assert_array_equal(shifted(t, np.arange(8), 1.0, held=held)[3:6], [2, NAN, 4])


def test_empty_cells():
    t, u = [0, 1, 2, 3, 4], [5, NAN, 6, 9, 8]
    np.testing.assert_array_equal(shifted(t, u, 1.0, held=True), [NAN, 5, NAN, 6, 9])
    np.testing.assert_array_equal(shifted(t, u, 1.0, held=False), [NAN, 5, NAN, 6, 9])
    np.testing.assert_array_equal(shifted(t, u, 0.5, held=True), [NAN, 5, NAN, 6, 9])
    np.testing.assert_array_equal(shifted(t, u, 0.5, held=False), [NAN, NAN, NAN, 7.5, 8.5])


def test_the_rest_stays():
    first = run([0, 1, 2], u=[1, 2, 3], v=[4, 5, 6], y=[7, 8, NAN])
    second = delayed(first, {"u": 1.0, "v": 0.0}, {"u", "v"})
    assert (second.name, second.source) == ("a", "a.csv")
    np.testing.assert_array_equal(second.t, first.t)
    np.testing.assert_array_equal(second.columns["u"], [NAN, 1, 2])
    for name in ("v", "y"):
        np.testing.assert_array_equal(second.columns[name], first.columns[name])
    np.testing.assert_array_equal(first.columns["u"], [1, 2, 3])
    assert delayed(first, {}, ()).content_hash == first.content_hash


@pytest.mark.parametrize("delay", [2.0, 50.0])
def test_a_delay_that_leaves_nothing_is_refused(delay):
    with pytest.raises(InputError) as caught:
        shifted([0, 1, 2], [1, 2, 3], delay, held=True)
    assert str(caught.value) == (
        f"a.csv: run 'a' lasts 2 s, no longer than the delay of input 'u', {delay:g} s; correct "
        "the delay or give a longer run."
    )
