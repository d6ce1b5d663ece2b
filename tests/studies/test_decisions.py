"""The studies of the bank's decisions on one seed each: that they measure what they say."""

import pytest

from decision_studies.hindsight import linear_hindsight
from decision_studies.naming import left_out, named, rig_bank
from decision_studies.optimal import against_kalman, linear_bank
from decision_studies.rig import rig, window
from decision_studies.tank import leak_found

pytestmark = pytest.mark.study

SHORT = 1500.0  # s of each of two healthy logs: the study takes 4000, here they need only suffice


def test_where_the_kalman_filter_is_optimal_the_bank_is_as_good():
    found = against_kalman(linear_bank(), 3)
    # 1800 samples after the onset, correlated over about 100: ratios scatter by some percent
    assert found.bank <= 1.2 * found.kalman
    assert 0.8 < found.coverage <= 1.0
    assert 0 <= found.delay < 30


def test_a_window_is_drawn_from_its_seed_and_its_fault_is_where_it_says():
    first, again = window(5, ("sensor_a",)), window(5, ("sensor_a",))
    assert first.run.content_hash == again.run.content_hash
    moved = first.run.columns["ya"] - first.without("sensor_a").columns["ya"]
    onset, size = first.onsets["sensor_a"], first.faults["sensor_a"]
    assert moved[first.run.t < onset] == pytest.approx(0.0, abs=1e-12)
    assert moved[first.run.t >= onset] == pytest.approx(size, abs=1e-12)


def test_the_rig_is_named_hidden_and_left_out():
    verdicts = named(rig_bank(seconds=SHORT), 1)
    assert len(verdicts) == 1 + 10 + 3
    assert [v.exact for v in verdicts[:11]] == [True] * 11
    # a heater at its limit hides its own bias and silences nothing else
    assert [v.status for v in verdicts[11:13]] == ["HEALTHY"] * 2
    assert all(v.wide and not v.visible for v in verdicts[11:])


def test_a_kind_of_fault_that_is_left_out_is_unknown():
    assert "sensor_b" not in rig("sensor_b").signals.fault_names
    (verdict,) = left_out({"sensor_b": rig_bank("sensor_b", SHORT)}, 1)
    assert verdict.unknown >= 0.5
    assert not verdict.blamed


def test_hindsight_is_scored_against_the_bound():
    found = linear_hindsight(linear_bank(walk=None), 3)
    assert found.named
    assert abs(found.error) < 4  # of the bound's standard deviations: one normal error
    # size and onset are nearly apart here: telling the onset moves the size by less than its sd
    assert 0 < abs(found.told_onset - found.error) < 1
    assert found.delay > 0


def test_a_model_with_an_error_of_its_own_gives_intervals_that_hold_the_truth():
    """The fitted tank errs by half a percent, which its noise alone would put at 0.25 %."""
    found = leak_found(1)
    assert found is not None
    assert found.sized
    assert found.early == 0
    assert 0.0025 < found.width < 0.05
