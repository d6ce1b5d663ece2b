"""Logs of Basilisk's wheel with faults against our own simulator's, by the benchmark of them."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("Basilisk", reason="Basilisk is absent: pip install faultgauge[peers]")


@pytest.fixture(scope="module")
def bench():
    path = Path(__file__).parents[2] / "benchmarks" / "basilisk_faults.py"
    spec = importlib.util.spec_from_file_location("basilisk_faults", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("kind", ["", "coulomb", "viscous", "motor_gain", "tachometer"])
def test_in_a_hub_that_stands_still_both_simulators_give_the_same_log(bench, kind):
    """Loop, noises and faults are the same in both: what is left is rounding and the hub's motion,
    Js/1e12 of the speed, 2e-11 rad/s, which the loop does not let grow. A thousandth of the
    smallest friction, 5e-7 N*m, is 8e-5 rad/s after the loop's 20 s."""
    plan = bench.planned(bench.HEALTHY, 0, kind)
    mine, theirs = bench.ours(plan), bench.basilisk(plan, scans=False)
    for name in ("u", "y"):
        assert np.max(np.abs(mine.columns[name] - theirs.columns[name])) < 1e-9, name
    assert np.count_nonzero(np.diff(np.sign(mine.columns["y"]))) >= 1  # through zero
    assert np.mean(np.abs(mine.columns["u"]) == bench.U_MAX) < 0.02


def test_a_hub_that_moves_shows_in_the_log(bench):
    """It does what the plant file lacks, by far more than rounding and less than the sensor."""
    plan = bench.planned(bench.HEALTHY, 0)
    mine, theirs = bench.ours(plan), bench.basilisk(plan)
    off = np.abs(mine.columns["y"] - theirs.columns["y"])
    assert 1e-4 < np.max(off) < 10 * bench.TACHOMETER
