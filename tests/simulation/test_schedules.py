"""Schedules against arithmetic by hand."""

import numpy as np
import pytest

from faultgauge.plants.signals import Input, Output, Signals, State
from faultgauge.simulation.schedules import (
    Constant,
    Intermittent,
    Ramp,
    Schedule,
    Sine,
    Steps,
    grid,
    inject,
    truth,
)

SIGNALS = Signals(
    states=(State("h"), State("w")),
    inputs=(Input("u"),),
    outputs=(Output("T"), Output("h")),
)
T = np.arange(0.0, 1000.0, 50.0)
EQ17 = Steps((500.0, 600.0, 700.0, 800.0), (0.1, 0.15, 0.2, 0.0))
EQ19 = Steps((500.0, 550.0, 600.0, 650.0), (0.05, 0.08, 0.1, 0.0))


def test_steps_are_eq_17():
    expected = [0.0] * 10 + [0.1, 0.1, 0.15, 0.15, 0.2, 0.2] + [0.0] * 4
    np.testing.assert_array_equal(EQ17.sizes(T), expected)
    np.testing.assert_array_equal(EQ17.sizes(np.array([499.999, 799.999, 800.0])), [0, 0.2, 0])


def test_an_output_stuck_as_in_eq_19_is_dead_at_its_end():
    schedule = Schedule("f", "output", "T", EQ19, "stuck")
    held = inject([schedule], SIGNALS, T).stuck.y[:, 0]
    expected = [np.nan] * 10 + [0.05, 0.08, 0.1] + [0.0] * 7
    np.testing.assert_array_equal(held, expected)
    np.testing.assert_array_equal(truth(schedule, T), expected)


SHAPES = [  # profile, times, sizes, whether it is active
    (Constant(2.0), [-1, 0, 9e9], [0, 2, 2], [0, 1, 1]),
    (Constant(2.0, 10.0, 20.0), [9.9, 10, 19.9, 20], [0, 2, 2, 0], [0, 1, 1, 0]),
    (Ramp(-4.0, 10.0, 20.0), [0, 10, 12.5, 20, 30], [0, 0, -1, -4, -4], [0, 1, 1, 1, 1]),
    (
        Intermittent(3.0, 10.0, 4.0, 0.25, 19.0),
        [9, 10, 10.9, 11, 13.9, 14, 18, 18.9, 19, 22],
        [0, 3, 3, 0, 0, 3, 3, 3, 0, 0],
        [0, 1, 1, 0, 0, 1, 1, 1, 0, 0],
    ),
    (Sine(2.0, np.pi / 2.0, np.pi / 2.0), [0, 1, 2, 3], [2, 0, -2, 0], [1, 1, 1, 1]),
]


@pytest.mark.parametrize(("profile", "t", "sizes", "active"), SHAPES)
def test_shapes(profile, t, sizes, active):
    t = np.array(t, float)
    np.testing.assert_allclose(profile.sizes(t), sizes, atol=1e-15)  # sin(pi) is 1.2e-16
    np.testing.assert_array_equal(profile.active(t), np.array(active, bool))


@pytest.mark.parametrize("dt", [0.1, 0.3, 0.7, 1e-3])
def test_events_fall_on_the_samples_that_they_name(dt):
    """Three of 0.7 s are 2.0999999999999996 s in floating point: an event at 2.1 s is then due."""
    for k in range(1, 400):
        named = float(f"{k * dt:.6f}")
        t = grid(500, dt, 4)
        active = Constant(1.0, named).active(t)
        assert active.ravel().argmax() == 4 * k
    period = float(f"{5 * dt:.6f}")
    blinking = Intermittent(1.0, 0.0, period, 0.4).active(t[:, 0])
    np.testing.assert_array_equal(blinking, np.arange(500) % 5 < 2)


def test_overlapping_faults_add_up_in_the_plant_and_stay_apart_in_the_truth():
    schedules = [
        Schedule("a", "state", "w", Constant(1.0, 100.0)),
        Schedule("b", "state", "w", Ramp(4.0, 200.0, 400.0)),
    ]
    injection = inject(schedules, SIGNALS, T)
    assert [(f.name, f.enters, f.target) for f in injection.faults] == [
        ("a", "state", "w"),
        ("b", "state", "w"),
    ]
    at = np.searchsorted(T, [50, 150, 300, 500])
    np.testing.assert_array_equal(injection.f[at].sum(axis=1), [0, 1, 3, 5])
    np.testing.assert_array_equal(truth(schedules[1], T)[at], [0, 0, 2, 4])
    assert np.isnan(injection.stuck.dx).all()
    assert not injection.dropped.any()


@pytest.mark.parametrize("effect", ["stuck", "dropout"])
@pytest.mark.parametrize(
    ("enters", "target", "field", "channel"),
    [("state", "w", "dx", 1), ("input", "u", "u", 0), ("output", "h", "y", 1)],
)
def test_channels_that_hold(enters, target, field, channel, effect):
    schedule = Schedule("f", enters, target, Constant(0.7, 100.0, 200.0), effect)
    injection = inject([schedule], SIGNALS, T)
    active = (T >= 100) & (T < 200)
    assert injection.f.shape == (len(T), 0)
    held = getattr(injection.stuck, field)
    if (enters, effect) == ("output", "dropout"):
        np.testing.assert_array_equal(injection.dropped[:, channel], active)
        assert injection.dropped.sum() == active.sum()
        assert np.isnan(held).all()
    else:
        value = 0.7 if effect == "stuck" else 0.0
        np.testing.assert_array_equal(held[:, channel], np.where(active, value, np.nan))
        assert np.isfinite(held).sum() == active.sum()
    free = np.nan if effect == "stuck" else 0.0
    np.testing.assert_array_equal(
        truth(schedule, T), np.where(active, 0.7 if effect == "stuck" else 1.0, free)
    )


@pytest.mark.parametrize(("effect", "size"), [("add", 0.3), ("dropout", 1.0)])
def test_a_gain_is_lost_in_part_or_whole(effect, size):
    injection = inject([Schedule("f", "gain", "u", Constant(0.3, 100.0), effect)], SIGNALS, T)
    np.testing.assert_array_equal(injection.f[:, 0], np.where(T >= 100, size, 0.0))
    assert injection.faults[0].enters == "gain"


def test_the_later_of_two_that_hold_one_channel_holds_it():
    pair = [
        Schedule("a", "input", "u", Constant(1.0, 100.0, 300.0), "stuck"),
        Schedule("b", "input", "u", Constant(2.0, 200.0, 400.0), "stuck"),
    ]
    held = inject(pair, SIGNALS, np.array([150.0, 250.0, 350.0, 450.0])).stuck.u[:, 0]
    np.testing.assert_array_equal(held, [1, 2, 2, np.nan])
