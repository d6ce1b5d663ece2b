"""Fault commands: both forms mean the same, and a bad one changes nothing."""

import json
import math

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.simulation.commands import Commands
from faultgauge.simulation.scenario import parse_scenario
from faultgauge.simulation.schedules import Constant, Ramp, truth

SCENARIO = """name = "s"
plant = "reaction_wheel"
seconds = 10
step = 1
[inputs.u]
source = "constant"
size = 0.1
[faults.drag]
enters = "state"
target = "h"
profile = "constant"
size = 0.5
start = 4
"""
FRICTION = ("friction", "state", "h", "add")


@pytest.fixture
def commands():
    return Commands(parse_scenario(SCENARIO))


@pytest.mark.parametrize(
    ("line", "same", "meant", "profile"),
    [
        ("inject friction 0.03", {"name": "friction", "size": 0.03}, FRICTION, Constant(0.03, 3.0)),
        (
            "inject friction 3e-2 ramp 5",
            {"name": "friction", "size": 0.03, "ramp": 5},
            FRICTION,
            Ramp(0.03, 3.0, 8.0),
        ),
        (
            "inject drag 1",
            {"name": "drag", "size": 1},
            ("drag", "state", "h", "add"),
            Constant(1.0, 3.0),
        ),
        (
            "inject u bias -0.2 ramp 5",
            {"name": "u", "kind": "bias", "size": -0.2, "ramp": 5},
            ("u_bias", "input", "u", "add"),
            Ramp(-0.2, 3.0, 8.0),
        ),
        (
            "inject input u gain 0.4",
            {"name": "u", "enters": "input", "kind": "gain", "size": 0.4},
            ("u_gain", "gain", "u", "add"),
            Constant(0.4, 3.0),
        ),
        (
            "inject hm gain 0.4",
            {"name": "hm", "kind": "gain", "size": 0.4},
            ("hm_gain", "output_gain", "hm", "add"),
            Constant(0.4, 3.0),
        ),
        (
            "inject hm stuck 7",
            {"name": "hm", "kind": "stuck", "size": 7},
            ("hm_stuck", "output", "hm", "stuck"),
            Constant(7.0, 3.0),
        ),
        (
            "inject T dropout",
            {"name": "T", "kind": "dropout"},
            ("T_dropout", "output", "T", "dropout"),
            Constant(1.0, 3.0),
        ),
    ],
)  # fmt: skip
def test_both_forms_mean_the_same(commands, line, same, meant, profile):
    text = commands.obey(line, 3.0).schedule
    assert (text.name, text.enters, text.target, text.effect) == meant
    assert text.profile == profile
    assert commands.schedules[text.name] == text
    again = Commands(parse_scenario(SCENARIO)).obey(json.dumps({"do": "inject", **same}), 3.0)
    assert again.schedule == text


def test_an_injection_takes_the_place_of_what_bore_its_name(commands):
    commands.obey("inject friction 0.1", 0.0)
    commands.obey("inject friction 0.3 ramp 4", 2.0)
    friction = commands.schedules["friction"]
    t = np.array([2.0, 3.0, 4.0, 6.0, 9.0])
    # from what it is to what it shall be, straight
    np.testing.assert_allclose(truth(friction, t), [0.1, 0.15, 0.2, 0.3, 0.3], rtol=1e-15)
    commands.obey("inject friction 0.0 ramp 2", 4.0)
    assert truth(commands.schedules["friction"], np.array([5.0])) == pytest.approx([0.1])
    commands.obey("inject u bias 1", 4.0)
    commands.obey("inject u_bias 2", 5.0)  # by the name that it was given
    assert commands.schedules["u_bias"].profile == Constant(2.0, 5.0, math.inf)


def test_clear_and_stop(commands):
    commands.obey("inject friction 0.1", 0.0)
    assert commands.obey("clear friction", 1.0).cleared == ("friction",)
    assert list(commands.schedules) == ["drag"], "what the scenario has planned goes on"
    commands.obey('{"do": "inject", "name": "u", "kind": "gain", "size": 0.5}', 1.0)
    assert commands.obey('{"do": "clear", "name": "all"}', 2.0).cleared == ("drag", "u_gain")
    assert commands.obey("clear all", 2.0).cleared == ()
    assert commands.obey("stop", 3.0).did == "stop"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("explode", "is no command; write inject NAME SIZE"),
        ("inject", "'name' is missing"),
        ("inject frction 1", "did you mean 'friction'?"),
        ("inject friction", "the size is missing"),
        ("inject friction much", "size 'much' is not a number"),
        ("inject friction 1 2", "'2' is one word too many"),
        ("inject friction nan", "size = nan: should be a finite number"),
        ("inject friction 1 ramp -1", "ramp = -1.0: should be greater than 0"),
        ("inject friction gain 0.1", "is no gain loss; write `inject INPUT gain SIZE`"),
        ("inject u 0.1", "write one of bias, gain, stuck, dropout"),
        ("inject h gain 0.1", "unknown input or output 'h'"),
        ("inject state h gain 0.1", "a state has no gain to lose; name an input or an output"),
        ("inject output u bias 0.1", "unknown output 'u'"),
        ("inject u dropout 1", "neither size nor ramp"),
        ("inject u stuck 1 ramp 2", "has no ramp"),
        ("clear friction", "unknown injected fault 'friction'"),
        ('{"do": "inject", "name": "friction", "sise": 1}', "did you mean 'size'?"),
        ('{"do": "inject", "name": "friction", "size": "1"}', "size = '1': should be a number"),
        ('{"do": "stop"', "is not a JSON object"),
    ],
)
def test_a_bad_command_is_one_sentence_and_changes_nothing(commands, line, said):
    before = dict(commands.schedules)
    with pytest.raises(InputError) as refusal:
        commands.obey(line, 1.0)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert commands.schedules == before


def test_a_name_of_two_channels_asks_which():
    text = SCENARIO.replace("reaction_wheel", "tank").replace("drag", "leak")
    text = text.replace('enters = "state"\ntarget = "h"\n', "")
    commands = Commands(parse_scenario(text))
    with pytest.raises(InputError, match="`inject output level"):
        commands.obey("inject level bias 0.1", 1.0)
    schedule = commands.obey("inject output level bias 0.1", 1.0).schedule
    assert (schedule.name, schedule.enters) == ("output_level_bias", "output")
