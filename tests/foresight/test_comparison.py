"""`benchmarks/detectability.py`: what is set beside what."""

import importlib
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def script():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        yield importlib.import_module("detectability")


def test_ratios_and_their_figure(script):
    rows = [
        script.Compared("a", "bias", "V", 0.2, False, 0.1),
        script.Compared("a", "loss", "", None, False, 0.1),
        script.Compared("b", "leak", "m/s", 3.0, True, None),
    ]
    assert [each.ratio for each in rows] == [2.0, None, None]
    drawn = script.scatter(rows)
    assert "smallest size foretold (the fault's unit)" in drawn.svg
    assert "found 90 % of the time (the fault's unit)" in drawn.svg
