"""Windows, sizes and plans."""

from collections import Counter

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.plants.signals import Fault
from faultgauge.rehearsal.design import Subject, doses_of, plans, windows_of
from faultgauge.rehearsal.ways import Way
from faultgauge.telemetry import Run

WAY = Way("u", is_input=True, is_loss=False)


def run(count, name="a", start=0.0):
    return Run(name, f"{name}.csv", start + np.arange(float(count)), {"u": np.arange(float(count))})


def subject(name="f", smallest=1.0, **limits):
    fault = Fault(name, "input", "u", **limits)
    return Subject(fault, WAY, smallest, doses_of(fault, smallest, None))


def test_long_runs_are_cut_into_equal_windows_and_short_ones_left_out():
    windows, short = windows_of([run(4500), run(300, "b"), run(150, "c")])
    assert [len(each.t) for each in windows] == [1500, 1500, 1500, 300]
    assert [each.name for each in windows] == ["a from 0 s", "a from 1500 s", "a from 3000 s", "b"]
    assert [float(each.t[0]) for each in windows[:3]] == [0.0, 1500.0, 3000.0]
    assert len(short) == 1
    assert "c: 150 samples" in short[0]


def test_only_short_runs_are_refused():
    with pytest.raises(InputError, match=r"c\.csv: 150 samples are too few"):
        windows_of([run(150, "c")])


def test_sizes_are_a_geometric_grid_within_the_limits():
    fault = Fault("f", "input", "u", min=-1.0)
    doses = doses_of(fault, 2.0, None)
    up = [each.size for each in doses if each.size > 0]
    assert up[0] == pytest.approx(0.5)
    assert up[-1] == pytest.approx(32.0)
    assert np.diff(np.log(up)) == pytest.approx(np.log(64) / 7)
    assert [e.size for e in doses if e.size < 0] == pytest.approx([-s for s in up if s <= 1.0])
    assert [e.times for e in doses] == pytest.approx([abs(e.size) / 2.0 for e in doses])
    assert doses_of(fault, None, None) == ()
    assert [(e.size, e.times) for e in doses_of(fault, 2.0, 3.0)] == [(3.0, 1.5)]


def test_plans_spread_evenly_and_onsets_lie_in_the_middle():
    windows = [run(500), run(500, "b", 1000.0)]
    found = plans([subject("f"), subject("g")], windows, 72, lambda plan: True, pairs=True)
    single = [each.doses[0] for each in found if len(each.doses) == 1]
    pairs = [each.doses for each in found if len(each.doses) == 2]
    assert set(Counter((e.fault, abs(e.size)) for e in single).values()) == {4}
    assert set(Counter(np.sign(e.size) for e in single).values()) == {32}
    assert Counter(tuple(e.times for e in pair) for pair in pairs) == {(4.0, 4.0): 4, (8.0, 8.0): 4}
    assert len({tuple(np.sign(e.size) for e in pair) for pair in pairs}) == 4
    assert set(Counter(each.window for each in found).values()) == {36}
    for each in found:
        t = windows[each.window].t
        for onset in each.onsets:
            assert onset in t
            assert 0.2 <= (onset - t[0]) / (t[-1] - t[0]) <= 0.81  # the sample after the draw
    again = plans([subject("f"), subject("g")], windows, 72, lambda plan: True, pairs=True)
    assert again == found


def test_a_budget_below_one_round_takes_of_everything():
    subjects = [subject("f"), subject("g")]
    found = plans(subjects, [run(500)], 6, lambda plan: True, pairs=False)
    assert Counter(each.doses[0].fault for each in found) == {"f": 3, "g": 3}


def test_what_is_not_legal_is_left_out_and_ends():
    assert plans([subject()], [run(500)], 10, lambda plan: False, pairs=False) == []
    found = plans([subject()], [run(500)], 10, lambda p: p.doses[0].size > 0, pairs=False)
    assert len(found) == 10


def test_a_pair_keeps_to_the_limits():
    subjects = [subject("f", min=0.0), subject("g", max=3.0, min=-3.0)]
    found = plans(subjects, [run(500)], 40, lambda plan: True, pairs=True)
    assert all(len(each.doses) == 1 for each in found)  # g of 4 times is beyond both limits
    subjects = [subject("f", min=0.0), subject("g", max=3.0)]
    pairs = [e.doses for e in plans(subjects, [run(500)], 40, lambda p: True, pairs=True)]
    both = [each for each in pairs if len(each) == 2]
    assert both
    assert all(f.size > 0 > g.size for f, g in both)
