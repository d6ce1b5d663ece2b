"""`benchmarks/detectability.py`: what is set beside what."""

import importlib
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def script():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        yield importlib.import_module("detectability")


def test_ratios_and_their_figure(script):
    rows = [
        script.Compared("a", "bias", "V", 0.2, False, 0.1, 0.4),
        script.Compared("a", "loss", "", None, False, 0.1, None),
        script.Compared("b", "leak", "m/s", 3.0, True, None, 1.0),
    ]
    assert [each.ratio(each.along) for each in rows] == [2.0, None, None]
    assert rows[0].ratio(rows[0].middle) == 0.5
    drawn = script.scatter(rows)
    assert "smallest size foretold (the fault's unit)" in drawn.svg
    assert "found 90 % of the time (the fault's unit)" in drawn.svg


def test_what_no_window_shows_counts_as_the_largest(script):
    assert script._quantile([1.0, None, 3.0], 0.5) == 3.0
    assert script._quantile([None, None, 3.0], 0.5) is None
    assert script._quantile(np.arange(1.0, 11.0).tolist(), 0.9) == 10.0
