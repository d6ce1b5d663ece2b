"""A bench gives what `simulate` gives, whoever says when a fault begins; and it keeps time."""

from dataclasses import replace

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.simulation import pacing
from faultgauge.simulation.pacing import Pacer
from faultgauge.simulation.realtime import Session
from faultgauge.simulation.run_scenario import simulate
from faultgauge.simulation.scenario import parse_scenario

LOOP = """name = "wheel"
plant = "reaction_wheel"
seconds = 30
step = 0.5
seed = 3
[inputs.u]
source = "noise"
sigma = 0.2
low = 0.05
high = 0.8
[inputs.u.feedback.hm]
kp = 0.01
[noise]
hm = 0.05
T = 0.001
[disturbances.unbalance]
enters = "state"
target = "h"
profile = "sine"
size = 0.01
frequency = 0.1
"""
FLIGHT = """name = "pitch wheel"
plant = "reaction_wheel"
seconds = 15
step = 0.25
[satellite]
axis = "pitch"
[noise]
hm = 0.002
"""
FASTEST = 1e9


def run(scenario, commands, speed=FASTEST):
    """(session, rows emitted, complaints) with `commands` as {sample: lines}."""
    session, rows, complaints, polls = Session(scenario, speed), [], [], []

    def poll():
        polls.append(None)
        return commands.get(len(polls) - 1, [])

    session.run(poll, rows.append, complaints.append)
    return session, rows, complaints


def assert_same(found, expected):
    np.testing.assert_array_equal(found.t, expected.t)
    assert list(found.columns) == list(expected.columns)
    for name, values in expected.columns.items():
        # two compiled programs of one formula; 60 samples of a loop that forgets
        scale = np.nanmax(np.abs(values), initial=1.0)
        np.testing.assert_allclose(found.columns[name], values, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("text", [LOOP, FLIGHT])
def test_without_commands_the_log_is_that_of_simulate(text):
    scenario = parse_scenario(text)
    session, rows, _ = run(scenario, {})
    assert_same(session.log(), simulate(scenario))
    assert [row["t"] for row in rows] == session.log().t.tolist()
    assert list(rows[0])[-1] == "true_friction", "what may be injected has a column from the start"


@pytest.mark.parametrize("text", [LOOP, FLIGHT])
def test_an_injection_is_the_fault_that_a_scenario_would_have_planned(text):
    scenario = parse_scenario(text)
    k, step = 20, scenario.step
    lines = [
        "inject friction 0.2 ramp 2", "inject u bias 0.05", "inject u gain 0.1",
        "inject hm stuck 3", "inject T dropout",
    ]  # fmt: skip
    start = f"start = {k * step}\n"
    constant = 'profile = "constant"\n'
    tables = {
        "friction": f'profile = "ramp"\nsize = 0.2\nend = {k * step + 2}\n',
        "u_bias": f'enters = "input"\ntarget = "u"\nsize = 0.05\n{constant}',
        "u_gain": f'enters = "gain"\ntarget = "u"\nsize = 0.1\n{constant}',
        "hm_stuck": f'enters = "output"\ntarget = "hm"\neffect = "stuck"\nsize = 3\n{constant}',
        "T_dropout": f'enters = "output"\ntarget = "T"\neffect = "dropout"\n{constant}',
    }
    planned = text + "".join(f"[faults.{n}]\n{body}{start}" for n, body in tables.items())
    session, rows, complaints = run(scenario, {k: lines})
    assert complaints == []
    assert_same(session.log(), simulate(parse_scenario(planned)))
    assert [(r["sample"], r["t"], r["name"]) for r in session.injections] == [
        (k, k * step, name) for name in tables
    ]
    assert session.injections[0]["size"] == 0.2
    assert session.injections[0]["ramp"] == 2.0
    assert rows[k]["true_friction"] == 0.0
    assert rows[k + 1]["true_friction"] == pytest.approx(0.1 * step)
    assert not any("u_bias" in name for name in rows[-1]), "the stream's columns stand"


def test_clear_ends_a_fault_and_stop_the_run():
    commands = {5: ["inject friction 0.2", "nonsense"], 9: ["clear friction"], 12: ["stop"]}
    session, rows, complaints = run(parse_scenario(LOOP), commands)
    truth = session.log().columns["true_friction"]
    assert truth.tolist() == [0.0] * 5 + [0.2] * 4 + [0.0] * 3
    assert len(rows) == 12
    assert len(complaints) == 1
    assert [r["did"] for r in session.injections] == ["inject", "clear", "stop"]


def test_rows_between_those_of_the_log_are_simulated_but_not_given_out():
    scenario = replace(parse_scenario(LOOP), log_every=4)
    session, rows, _ = run(scenario, {6: ["inject friction 0.2"]})
    assert len(rows) == 15
    assert len(session.pacer.late) == 60
    planned = LOOP + '[faults.friction]\nprofile = "constant"\nsize = 0.2\nstart = 3.0\n'
    assert_same(session.log(), simulate(replace(parse_scenario(planned), log_every=4)))


def test_what_leaves_all_bounds_is_said():
    with pytest.raises(InputError, match="leaves all bounds at t = "):
        run(parse_scenario(LOOP), {3: ["inject friction 1e308"]})
    with pytest.raises(InputError, match="a sample would last"):
        Session(parse_scenario(LOOP), 1e-300)
    for speed in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="positive factor"):
            Session(parse_scenario(LOOP), speed)


class Clock:
    """A clock that only sleeping and working move."""

    def __init__(self, monkeypatch):
        self.now = 50.0
        monkeypatch.setattr(pacing.time, "perf_counter", self.read)
        monkeypatch.setattr(pacing.time, "sleep", self.work)

    def read(self):
        self.now += 1e-6
        return self.now

    def work(self, seconds):
        self.now += seconds


def test_deadlines_are_absolute_and_nothing_is_left_out(monkeypatch):
    clock, pacer = Clock(monkeypatch), Pacer(0.1)
    released = []
    for k in range(10):
        pacer.wait_for_work()
        clock.work(0.25 if k == 3 else 0.002)
        pacer.wait()
        released.append(clock.now)
        pacer.done()
    start = released[0]
    assert start == pytest.approx(50.005, abs=1e-4)  # the lead of the first
    late = np.array(released) - start - 0.1 * np.arange(10)
    # the fourth is 0.25 s - 5 ms of lead late, the next two catch up, the rest are on time
    expected = [0, 0, 0, 0.245, 0.147, 0.049, 0, 0, 0, 0]
    np.testing.assert_allclose(late, expected, atol=1e-4)
    kept = pacer.punctuality()
    assert (kept.samples, kept.overruns) == (10, 2)
    assert kept.greatest == pytest.approx(0.245, abs=1e-4)
    assert kept.p50 == pytest.approx(0.0, abs=1e-4)
    assert "2 overruns" in kept.sentence()


def test_accommodation_against_the_clock_is_refused():
    text = LOOP.replace("[disturbances", '[accommodation]\npolicy = "estimate"\n[disturbances', 1)
    with pytest.raises(InputError, match="accommodation"):
        Session(parse_scenario(text), 1.0)
