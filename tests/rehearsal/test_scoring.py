"""What a judgement makes of what was injected, by hand."""

import numpy as np
import pytest

from faultgauge.rehearsal.design import Dose, RehearsalPlan
from faultgauge.rehearsal.judging import Event, Judgement
from faultgauge.rehearsal.rehearse import score
from faultgauge.rehearsal.scoring import fault_result, figures, large, pair_results


def event(fault, told, end, size=1.0, half=0.2, onset=None):
    at = told if onset is None else onset
    sized = (None, None, None) if fault == "unknown" else (size, size - half, size + half)
    return Event(fault, told, end, *sized, at, at - 1.0, at + 1.0)


def judged(*events, alarms=()):
    return Judgement(events, alarms, 1.0, 0.25)


def trial(said, *doses, onsets=(10.0,)):
    plan = RehearsalPlan(0, tuple(Dose(name, size, times) for name, size, times in doses), onsets)
    return score(0, "w", plan, said)


def test_found_named_exactly_and_sized():
    said = judged(event("f", 12.0, 30.0, 1.1, onset=10.5), alarms=((11.0, 30.0),))
    found = trial(said, ("f", 1.0, 5.0))
    answer = found.answers[0]
    assert (found.found, found.exact, found.alarmed, found.unknown) == (True, True, True, False)
    assert answer.delay == 2.0
    assert answer.error == pytest.approx(0.1)
    assert (answer.size_covered, answer.onset_covered) == (True, True)
    assert found.not_judged == 0.25


def test_an_event_before_the_onset_is_a_false_alarm_and_finds_nothing():
    found = trial(judged(event("f", 8.0, 30.0)), ("f", 1.0, 5.0))
    assert (found.found, found.exact, found.false_before, found.alarmed) == (False, False, 1, False)


def test_wrong_names_and_unknown_are_kept_apart():
    said = judged(event("f", 12.0, 30.0), event("g", 15.0, 20.0), event("unknown", 11.0, 12.0))
    found = trial(said, ("f", 1.0, 5.0))
    assert (found.found, found.exact, found.wrong, found.unknown) == (True, False, ("g",), True)


def test_the_first_event_dates_and_the_longest_one_sizes():
    said = judged(event("f", 12.0, 13.0, 3.0, onset=15.0), event("f", 20.0, 90.0, 1.3))
    answer = trial(said, ("f", 1.0, 5.0)).answers[0]
    assert (answer.delay, answer.estimate) == (2.0, 1.3)
    assert (answer.size_covered, answer.onset_covered) == (False, False)


def test_a_pair_is_found_when_both_are():
    doses = (("f", 1.0, 4.0), ("g", -2.0, 4.0))
    one = trial(judged(event("f", 12.0, 30.0)), *doses, onsets=(10.0, 20.0))
    both = judged(event("f", 12.0, 30.0), event("g", 21.0, 30.0, -2.0))
    two = trial(both, *doses, onsets=(10.0, 20.0))
    assert (one.found, one.exact, two.found, two.exact) == (False, False, True, True)
    (pair,) = pair_results([one, two])
    assert (pair.names, pair.times, pair.figures.trials) == (("f", "g"), 4.0, 2)
    assert (pair.figures.found.count, pair.figures.instead) == (1, {"f": 1})
    assert large([one, two]) == []


def test_figures_are_medians_of_what_was_found():
    trials = [
        trial(judged(event("f", 10.0 + k, 30.0, 1.0 + 0.1 * k)), ("f", 1.0, 5.0))
        for k in range(1, 4)
    ]
    trials.append(trial(judged(), ("f", 1.0, 3.0)))
    found = figures(trials, 1.0)
    assert (found.found.count, found.found.total) == (3, 4)
    assert found.error_median == pytest.approx(0.2)
    assert found.error_p90 == pytest.approx(0.28)  # 0.1, 0.2, 0.3: 0.8 of the way to the last
    assert found.delay_median == 2.0
    assert (found.size_covered.count, found.size_covered.total) == (2, 3)
    assert found.instead == {"nothing": 1}
    assert len(large(trials)) == 3
    unnamed = trial(judged(alarms=((11.0, 30.0),)), ("f", 1.0, 3.0))
    assert figures([unnamed], 1.0).instead == {"an alarm without a name": 1}


@pytest.mark.parametrize(
    ("along", "found", "ratio", "within"),
    [(1.0, 2, 1.6, False), (1.2, 2, 4 / 3, True), (2.0, 1, 0.5, False), (0.5, 1, 2.0, None)],
)
def test_what_was_found_against_the_sheet(along, found, ratio, within):
    """Sizes 1 and 1.6, of which the larger alone is found, or both: then 1 or less would do."""
    seen = judged(event("f", 12.0, 30.0))
    trials = [
        trial(judged() if found == 2 and size == 1.0 else seen, ("f", size, 5.0))
        for size in (1.0, 1.6)
    ]
    # 0 of 1 and 1 of 1: 90 % are reached at 1.6^0.9
    size = 1.6**0.9 if found == 2 else 1.0
    result = fault_result("f", "", 1.0, trials, along)
    assert result.ratio == pytest.approx(size / along)
    assert result.within is within
    assert ratio == pytest.approx(size / along, rel=0.06)


def test_many_sizes_are_gathered_in_groups_of_as_many():
    sizes = np.geomspace(1, 10, 24)
    result = fault_result("f", "", 1.0, [trial(judged(), ("f", size, 1.0)) for size in sizes])
    assert [row.trials for row in result.by_size] == [2] * 12
    assert result.by_size[0].size == pytest.approx((sizes[0] + sizes[1]) / 2)
    assert result.smallest is None
