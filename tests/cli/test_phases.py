"""Every moment of a command belongs to one phase, the innermost."""

import builtins
import re
from itertools import count

import pytest

from faultgauge import phases
from faultgauge.phases import phase, profiled


@pytest.fixture
def ticks(monkeypatch):
    """A clock that goes on by a second at each look."""
    monkeypatch.setattr(phases, "process_time", count(1.0).__next__)


def told(said):
    return {
        name: float(s) for s, name in re.findall(r"([0-9.]+) s +[0-9]+%  (.*)", "\n".join(said))
    }


def test_the_innermost_phase_counts(ticks):
    said = []
    with profiled(said.append), phase("outer"), phase("inner"):
        pass
    # looks: start 1, into outer 2, into inner 3, out 4, out 5, end 6
    assert told(said) == {"starting Python": 1, "the rest": 2, "outer": 2, "inner": 1}
    assert said[0].startswith("6.00 s of processor time")


def test_without_a_profile_nothing_is_looked_at(ticks):
    with phase("outer"):
        pass
    assert phases.process_time() == 1.0


def test_what_fails_is_told_too_and_imports_are_as_before():
    usual, said = builtins.__import__, []
    with pytest.raises(KeyError), profiled(said.append), phase("failing"):
        raise KeyError
    assert "failing" in told(said)
    assert builtins.__import__ is usual


def test_a_command_says_where_its_time_went(call, workshop):
    said = call("inspect", workshop.healthy, "--profile")
    assert not said.code
    assert {"starting Python", "the rest"} <= told(said.err.splitlines()).keys()
    assert "--profile" not in call("inspect", workshop.healthy).err
