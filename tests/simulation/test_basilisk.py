"""A plant file against Basilisk's reaction wheel, by the benchmark of that name."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("Basilisk", reason="Basilisk is absent: pip install faultgauge[peers]")


@pytest.fixture(scope="module")
def wheel():
    path = Path(__file__).parents[2] / "benchmarks" / "basilisk_wheel.py"
    spec = importlib.util.spec_from_file_location("basilisk_wheel", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("case", ["coulomb", "stribeck"])
def test_speed_and_torque_are_basilisks(wheel, case):
    found = wheel.compare(case)
    # the hub's motion and rounding: the benchmark's docstring says how much of each
    assert wheel.TOLERANCE == 1e-9
    assert found["speed_max"] <= wheel.TOLERANCE
    assert found["torque_max"] <= wheel.TOLERANCE
    assert found["beyond_limit"] > 0.05  # the limit of the torque is compared as well
    if case == "coulomb":
        assert found["speed_from"] < -250
        assert found["speed_to"] > 250
        assert found["zero_crossings"] >= 2


def test_each_term_of_the_law_is_seen(wheel):
    """A hundredth off any constant of the friction is far beyond the tolerance."""
    for case, stated in wheel.CASES.items():
        u = wheel.torque(case)
        stated = {"Js": 0.119366, "limit": 1e-4, **stated}
        right, _ = wheel.ours(case, stated, u)
        for name in wheel.CASES[case]:
            wrong, _ = wheel.ours(case, stated | {name: 1.01 * stated[name]}, u)
            assert np.max(np.abs(wrong - right)) > 1e4 * wheel.TOLERANCE, name
