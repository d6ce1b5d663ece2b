"""Figures of a few rows, by hand."""

import math

import numpy as np
import pytest

from faultgauge.campaigns.outcome import LEVELS, trial_of
from faultgauge.campaigns.right import Right, right_of
from faultgauge.campaigns.schema import read_campaign
from faultgauge.campaigns.scoring import scored

from .conftest import judging
from .rows import row

RIGHT = {"leak": Right(("leak",), "leak"), "gauge": Right(("gauge", "unknown"), "gauge")}


@pytest.fixture(scope="module")
def found(files):
    plan = read_campaign(files / "campaign.toml")
    rows = [
        row(0),
        row(1, p=(0.25, 0.0, 0.0, 0.0)),
        row(2, "leak", "leak", p=(1.0, 0.0, 0.0, 0.0), after=3.0),
        row(3, "leak", "leak", p=(0.5, 0.0, 0.5, 0.0), after=5.0),
        row(4, "leak", "", p=(0.5, 0.5, 0.0, 0.0), after=7.0, possible="leak+gauge"),
        row(5, "leak", "weak", p=(0.0, 0.0, 1.0, 0.0), after=9.0, foretold=4.0),
        row(6, "gauge", "unknown", p=(0.0, 0.3, 0.0, 0.6), exact=True),
    ]
    right = RIGHT | {"silent": Right((), None)}
    return scored(plan, judging(), right, rows, ())


def test_names_that_count_as_right_become_one():
    told = row(6, "gauge", "unknown+leak")
    trial = trial_of(told, RIGHT)
    assert trial is not None
    assert trial.told == ("gauge", "leak")
    assert trial.answers[0].times == 4.0
    assert trial_of(row(0), RIGHT) is None


def test_alarms_by_their_level(found):
    below = LEVELS.index(3.0)
    whole, leak = found.curves[:2]
    assert (whole.name, leak.name) == ("all", "leak")
    assert [each.count for each in leak.detected] == [4] * (below + 1) + [0] * (
        len(LEVELS) - below - 1
    )
    assert leak.delay[0].value == 6.0  # of 3, 5, 7 and 9 s
    assert leak.delay[-1].value is None
    assert whole.delay[0].value == 7.0  # and of one that never comes
    # two false alarms in seven hours up to odds of e^2, then none
    assert [each.count for each in found.false] == [2 if level <= 2 else 0 for level in LEVELS]
    assert found.false[0].value == pytest.approx(2 / 7)


def test_who_was_named(found):
    table = found.isolation
    leak = dict(zip(table.answers, table.counts[table.kinds.index("leak")], strict=True))
    assert {name: count for name, count in leak.items() if count} == {
        "leak": 2,
        "weak": 1,
        "undecided": 1,
    }
    assert table.sets == {"leak": {"leak or gauge": 1}}


def test_separable_ones_are_those_that_were_foretold(found):
    """Leaks of 4 times the foretold size, named twice, undecided once; one of half of it."""
    assert (found.separable.exact.count, found.separable.exact.total) == (3, 3)
    assert (found.separable.below, found.separable.undecided) == (1, 1)
    assert (found.separable.apart.count, found.separable.apart.total) == (2, 5)


def test_scores_of_probabilities(found):
    """Sums of (p - truth)^2 and of -ln, run by run; gauge and unknown are one cause of run 6."""
    brier = [0.0, 2 * 0.25**2, 0.0, 2 * 0.5**2, 2 * 0.5**2, 2.0, 0.1**2 + 0.1**2]
    assert found.brier.value == pytest.approx(np.mean(brier))
    worst = -math.log(1e-9)
    log = [0.0, -2 * math.log(0.75), 0.0, *2 * [-2 * math.log(0.5)], 2 * worst, -2 * math.log(0.9)]
    assert found.log_score.value == pytest.approx(np.mean(log))
    assert found.brier.lo <= found.brier.value <= found.brier.hi


def test_how_often_it_was_so(found):
    """Of 34 probabilities 4 are one half, of which 2 are so, and 3 are one, one of them not so."""
    half, most = (
        next(each for each in found.reliability if each.low <= p < each.high) for p in (0.5, 0.99)
    )
    assert (half.said, half.share.count, half.share.total) == (0.5, 2, 4)
    assert sum(each.share.total for each in found.reliability) == 6 * 5 + 4
    assert (most.share.count, most.share.total) == (2, 3)


def test_intervals_and_sizes(found):
    leak = found.kinds[0]
    assert leak.covers.value == 0.9
    assert leak.width.value == pytest.approx(0.2)
    assert leak.delay.value is None  # of 3 s, 5 s and twice never
    assert leak.faults.predicted == 0.5
    assert leak.faults.by_size[0].found.count == 2
    assert (found.size_covered.count, found.size_covered.total) == (2, 2)


def test_what_counts_as_right_without_a_word(files, written):
    """A fault of the judge's name; one that enters at the same place; else something undeclared."""
    more = '[faults.offset]\nenters = "output"\ntarget = "x"\nsize = 1\n'
    more += '[faults.stuck]\nenters = "output"\ntarget = "x"\neffect = "stuck"\nsize = 1\n'
    path = written(("[faults.silent]", f"{more}[faults.silent]"))
    found = right_of(read_campaign(path), judging().plant.signals.faults)
    assert found == {
        "leak": Right(("leak",), "leak"),
        "gauge": Right(("gauge",), "gauge"),
        "offset": Right(("gauge",), "gauge"),
        "stuck": Right(("unknown",), None),
        "silent": Right((), None),
    }
