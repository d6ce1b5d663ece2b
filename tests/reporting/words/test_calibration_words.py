"""What calibration says of constants."""

import numpy as np

from calibrations import for_bank
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.bank.uncertain_constants import constants_of
from faultgauge.reporting.calibration_chapter import _levels
from faultgauge.reporting.words.calibration import errors, summary, telling
from models import as_stated

LAG = """
name = "lag"
[states.x]
unit = "m"
derivative = "b*u - a*x"
[inputs.u]
[outputs.x]
value = "x"
unit = "m"
[parameters]
a = { value = 0.5, unit = "1/s" }
b = { value = 2 }
[faults.push]
enters = "input"
target = "u"
"""


def test_constants_that_the_bank_moves_are_said_wherever_they_leave_what_runs_differ_by():
    """a by 0.31, more than three times 0.1; b by 0.29, less. What the fit knew does not matter: the
    bank goes by the moved ones all the same."""
    points = np.random.default_rng(0).uniform(-1, 1, (60, 2))
    model = as_stated(LAG, points)
    names = constants_of(model).names
    one, shift = np.ones(1), {"a": 0.31, "b": 0.29}
    noise = Noise(
        one, one, np.zeros(0), one, one, one, one,
        np.full(2, 0.1), np.array([shift[name] for name in names]), np.zeros(2),
    )  # fmt: skip
    lines = summary(for_bank(model, noise, size={"push": 1.0}))
    (line,) = (each for each in lines if each.startswith("the healthy logs say"))
    assert line == "the healthy logs say a = 0.81 1/s (fit: 0.5), and the bank goes by them"


def test_a_state_that_sticks_is_said_with_how_much_how_long_and_until_where():
    points = np.random.default_rng(0).uniform(-1, 1, (60, 2))
    one = np.ones(1)
    noise = Noise(
        one, one, np.zeros(0), one, one, one, one, np.full(2, 0.1), np.zeros(2), np.zeros(2),
        grip=8.04 * one, gripping=1.2 * one, slip=0.135 * one, travel=one, jitter=0.4e-3 * one,
    )  # fmt: skip
    for text, of, rest in (
        (LAG, "8 m/s", "0.14 m"),
        (LAG.replace('unit = "m"', ""), "8 per second", "0.14"),
        (LAG.replace('unit = "m"', 'unit = "1"'), "8 per second", "0.14"),
    ):
        lines = summary(for_bank(as_stated(text, points), noise, size={"push": 1.0}))
        (line,) = (each for each in lines if "sticks" in each)
        assert line == (
            f"x sticks: near rest something that the file lacks holds it by about {of}, for "
            f"about 1.2 s at a time, and lets go from {rest} on. What is smaller shows only while "
            "it moves"
        )
        (line,) = (each for each in lines if "too early" in each)
        assert line == (
            "samples of x come too early or too late, by about 0.0004 s, and are off by what it "
            "moves meanwhile"
        )


def test_no_unit_is_said_of_a_plain_number():
    """ "1" and "-" are how files write that there is none."""
    points = np.random.default_rng(0).uniform(-1, 1, (60, 2))
    one = np.ones(1)
    noise = Noise(
        one, one, np.zeros(0), one, one, one, one, np.full(2, 0.1), np.array([0.31, 0]),
        np.zeros(2), wander=0.5 * one, wandering=one, stray=0.25 * one, straying=one,
        zero=0.031 * one,
    )  # fmt: skip
    text = LAG.replace('unit = "m"', 'unit = "-"').replace('unit = "1/s"', 'unit = "1"')
    text = text.replace("[inputs.u]", '[inputs.u]\nunit = "1"')
    said = "\n".join(summary(for_bank(as_stated(text, points), noise, size={"push": 1.0})))
    for part in ("off by about 1 per second in d(x)", "x wanders by 0.5 beside", "a = 0.81 (fit"):
        assert part in said
    assert "u strays by 0.25 from what the log says" in said
    assert "the zero of x is off by about 0.031, another way in each run" in said
    assert "what a change of u does is off by about 100 % of it, for about 1 s" in said


def test_a_constant_that_was_fitted_to_zero_has_no_share_of_it_to_be_said():
    """A friction that ends at its lower limit, 0, is a common result of `fit`."""
    points = np.random.default_rng(0).uniform(-1, 1, (60, 2))
    one, text = np.ones(1), LAG.replace("value = 0.5", "value = 0")
    noise = Noise(
        one, one, np.zeros(0), one, one, one, one, np.full(2, 0.1), np.zeros(2), np.zeros(2)
    )
    said = "\n".join(summary(for_bank(as_stated(text, points), noise, size={"push": 1.0})))
    assert "what was fitted differs from run to run by about" in said
    assert "a 0.1 1/s" in said
    assert "b 0.1 (5 %)" in said
    assert "a 0.1 1/s (" not in said


def test_what_no_size_would_show_is_said_beside_what_may_drift():
    points = np.random.default_rng(0).uniform(-1, 1, (60, 2))
    slow = as_stated(LAG.replace("b = { value = 2 }", 'b = { value = 2, vary = "slow" }'), points)
    (line,) = telling(slow, {"push": None})
    assert line == (
        "had a fault begun in the middle of the longest log, push of any size to be expected would "
        'not have shown. b may drift (vary = "slow") and take up what push would do; of what does '
        'not drift within a log, say vary = "run"'
    )
    (line,) = telling(as_stated(LAG, points), {"push": None})
    assert line.endswith("would not have shown")
    (line,) = telling(slow, {"push": 0.2})
    assert line.endswith("push below 0.2 would not have shown")


def test_what_outlasts_the_logs_is_said_by_how_far_it_moves_in_them():
    """Of a walk that forgets within 50 times the logs' 1e4 s: sqrt(2 / 50) = 0.2 of its size."""
    points = np.random.default_rng(0).uniform(-1, 1, (60, 2))
    one, long = np.ones(1), np.full(1, 5e5)
    noise = Noise(
        one, one, np.zeros(0), 3 * one, long, one, one, np.full(2, 0.1), np.zeros(2), np.zeros(2),
        wander=one, wandering=long, stray=2 * one, straying=long,
    )  # fmt: skip
    said = errors(for_bank(as_stated(LAG, points), noise))
    assert said[:3] == [
        "the model is off by about 0.6 m/s in 2.8 h in d(x), and for longer than these logs last",
        "x wanders by 0.2 m in 2.8 h beside what the model says, and for longer than these logs "
        "last",
        "u strays by 0.4 in 2.8 h from what the log says, and for longer than these logs last",
    ]


def test_a_network_differs_from_run_to_run_as_a_whole():
    """By 4 %, and healthy logs have 1.2 times what was fitted: five times as far off."""
    text = LAG.replace("- a*x", "- drag(x)") + "[networks.drag]\nhidden = 1\n"
    model = as_stated(text, np.random.default_rng(0).uniform(-1, 1, (60, 2)))
    names = constants_of(model).names
    one, of = np.ones(1), {"a": 0.1, "b": 0.1, "drag": 0.04}
    noise = Noise(
        one, one, np.zeros(0), one, one, one, one, np.array([of[n] for n in names]),
        np.array([0, 0, 0.2]), np.zeros(3),
    )  # fmt: skip
    said = errors(for_bank(model, noise._replace(share=0.1 * one)))  # as usual: nothing is said
    assert said[1:] == [
        "what was fitted differs from run to run by about a 0.1 1/s (20 %), b 0.1 (5 %), all of "
        "drag 4 %",
        "the healthy logs say drag = 1.2 times what was fitted, and the bank goes by them",
    ]
    rows = {row[0]: row[1:] for row in _levels(for_bank(model, noise), noise).rows}
    assert rows["all of drag, from run to run"] == ("4.00 %", "mean is 1.2 times what was fitted")
    assert rows["a, from run to run"] == (
        "0.1\N{NO-BREAK SPACE}1/s",
        "mean differs from the fit by 0\N{NO-BREAK SPACE}1/s",
    )
