"""One `estimate` makes a log ready once, and every filter goes along it once."""

import sys
from collections import Counter

import pytest

from faultgauge.detection.rows.judged import _start
from faultgauge.detection.rows.prepared import prepared
from faultgauge.identification.samples import in_effect
from faultgauge.observers.follow import follow
from faultgauge.verbs.estimate import estimate

# the bank; the free run of the residuals; the healthy filter with what a unit of each fault leaves
# in it, for what would not have shown, and the sum of that: none of them can say another's
ALONG = {"Watch": 1, "OpenLoop": 1, "_Healthy": 1, "_Unfolding": 1}


@pytest.fixture
def called(monkeypatch):
    """How often each was called, wherever it was imported."""
    counts = Counter()

    def spy(function):
        def counting(*arguments):
            name = type(arguments[0]).__name__ if function is follow else function.__name__
            counts[name] += 1
            return function(*arguments)

        for module in [m for name, m in sys.modules.items() if name.startswith("faultgauge.")]:
            if getattr(module, function.__name__, None) is function:
                monkeypatch.setattr(module, function.__name__, counting)

    for function in (in_effect, prepared, _start, follow):
        spy(function)
    return counts


def test_a_log_is_made_ready_and_gone_along_once(calibrated, tank, called):
    answer = estimate(calibrated.model, tank.log(3, tank.leak))
    assert answer.events
    answer.as_dict(), answer.sentences, answer.lines, answer.rows
    # dead times are found in the walk itself, and by `in_effect` no more
    assert called == {"prepared": 1, "_start": 1} | ALONG


def test_hindsight_makes_nothing_ready_anew(calibrated, tank, called):
    """What it goes along by itself are its windows."""
    answer = estimate(calibrated.model, tank.log(3, tank.leak), smooth=True)
    assert answer.hindsight()
    answer.as_dict(), answer.sentences
    assert called["prepared"] == called["Watch"] == called["_Healthy"] == 1
    assert called["in_effect"] == 0
