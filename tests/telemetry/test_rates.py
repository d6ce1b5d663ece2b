"""Columns of different rates on common rows: what is filled, and what never is."""

import math

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry import as_sampled, cut, inspect_runs, read_telemetry, segments
from faultgauge.telemetry.rates import align
from faultgauge.telemetry.runs import joined

NAN = np.nan


def sparse(count: int, rows, values) -> np.ndarray:
    column = np.full(count, NAN)
    column[rows] = values
    return column


def test_a_slow_sensor_is_interpolated_and_a_slow_input_held():
    t = np.arange(41) / 100
    slow = sparse(41, slice(0, 41, 10), [0.0, 10.0, 20.0, 10.0, 0.0])
    columns = {"fast": np.sin(t), "y": slow, "u": slow}
    found = align(t, columns, held=("u",))
    assert found.kept.all()
    assert found.filled == ("y", "u")
    k = np.arange(41.0)
    # y rises by 1 a row to row 20 and falls again; interpolation rounds in the last bits
    np.testing.assert_allclose(found.columns["y"], 20 - np.abs(k - 20), atol=1e-13)
    np.testing.assert_array_equal(found.columns["u"], slow[(np.arange(41) // 10) * 10])
    np.testing.assert_array_equal(found.columns["fast"], np.sin(t))


def test_nothing_is_filled_outside_the_samples_nor_across_a_gap():
    t = np.arange(101.0)
    rows = [10, 20, 30, 70, 80, 90]  # a hole of four steps of its own
    found = align(t, {"x": t, "y": sparse(101, rows, 1.0)})
    expected = np.zeros(101, dtype=bool)
    expected[10:31] = expected[70:91] = True
    np.testing.assert_array_equal(np.isfinite(found.columns["y"]), expected)
    rows = [10, 20, 50, 60, 70, 80, 90]  # three steps are none
    filled = align(t, {"x": t, "y": sparse(101, rows, 1.0)}).columns["y"]
    assert np.isfinite(filled[10:91]).all()


def test_a_dropout_of_a_full_rate_sensor_stays():
    t = np.arange(100.0)
    x = t.copy()
    x[[7, 40, 41, 60]] = NAN
    for columns in (
        {"u": t, "x": x},
        {"x": x},
        {"x": x, "slow": sparse(100, slice(0, 100, 10), 1)},
    ):
        found = align(t, columns)
        np.testing.assert_array_equal(found.columns["x"], x)
        assert found.kept.all()


def test_scattered_cells_are_no_rate():
    rng = np.random.default_rng(0)
    t = np.arange(1000.0)
    x = np.where(rng.random(1000) < 0.3, 1.0, NAN)  # lengths of holes are geometric
    np.testing.assert_array_equal(align(t, {"u": t, "x": x}).columns["x"], x)


def test_rows_become_those_of_the_fastest_of_several_clocks():
    fast, slow = np.arange(200) / 100, 0.003 + np.arange(20) / 10
    t = np.union1d(fast, slow)
    columns = {
        "y": sparse(len(t), np.searchsorted(t, fast), fast**2),
        "z": sparse(len(t), np.searchsorted(t, slow), 2 * slow),
    }
    found = align(t, columns)
    np.testing.assert_array_equal(t[found.kept], fast)
    np.testing.assert_array_equal(found.columns["y"], fast**2)
    inside = (fast > slow[0]) & (fast < slow[-1])
    np.testing.assert_allclose(found.columns["z"][inside], 2 * fast[inside], rtol=1e-13)
    assert np.isnan(found.columns["z"][~inside]).all()


def test_the_cells_that_stand_for_samples_are_the_nearest_to_them():
    fast = np.arange(41) / 100
    # a row 0 before the first sample is empty, and a fifth sample comes after the last row
    for shift, rows in (
        (0.0, [0, 10, 20, 30, 40]),
        (0.003, [10, 20, 30]),
        (0.007, [1, 11, 21, 31]),
    ):
        slow = shift + np.arange(5) / 10
        t = np.union1d(fast, slow)
        columns = {
            "y": sparse(len(t), np.searchsorted(t, fast), fast),
            "z": sparse(len(t), np.searchsorted(t, slow), slow),
        }
        found = align(t, columns)
        assert set(found.sampled) == {"z"}
        cells = found.sampled["z"] & np.isfinite(found.columns["z"])
        np.testing.assert_array_equal(np.flatnonzero(cells), rows)


def test_two_clocks_of_one_rate():
    first, second = np.arange(50) / 10, 0.01 + np.arange(50) / 10
    t = np.union1d(first, second)
    columns = {
        "a": sparse(len(t), np.searchsorted(t, first), first),
        "b": sparse(len(t), np.searchsorted(t, second), second),
    }
    found = align(t, columns)
    np.testing.assert_array_equal(t[found.kept], first)
    np.testing.assert_allclose(found.columns["b"][1:], first[1:], rtol=1e-13)
    assert np.isnan(found.columns["b"][0])


@pytest.fixture
def log(tmp_path):
    slow = [str(k) if k % 10 == 0 else "" for k in range(101)]
    lines = [f"{k / 100},{math.sin(k / 20)},{slow[k]},{slow[k]}" for k in range(101)]
    (tmp_path / "log.csv").write_text("\n".join(["t,y,u,z", *lines]))
    return tmp_path / "log.csv"


def test_a_log_of_two_rates_has_complete_rows(log):
    (run,) = read_telemetry(log, names=["u"], optional=["y", "z"], held=["u"])
    assert segments(run, ["y", "u", "z"]) == [slice(0, 101)]
    np.testing.assert_array_equal(run.columns["u"], np.arange(101) // 10 * 10)
    np.testing.assert_allclose(run.columns["z"], np.arange(101.0), rtol=1e-13)


def test_a_run_knows_its_samples_in_parts_too(log):
    (run,) = read_telemetry(log, names=["u"], optional=["y", "z"], held=["u"])
    assert set(run.sampled) == {"z"}  # an input is known in between
    parts = [cut(run, slice(0, 45)), cut(run, slice(45, 101))]
    for each, rows in (
        (run, range(0, 101, 10)),
        (parts[1], range(5, 56, 10)),
        (joined(parts), range(0, 101, 10)),
    ):
        left = as_sampled(each, "z", each.t, each.columns["z"])
        np.testing.assert_array_equal(np.flatnonzero(np.isfinite(left)), rows)
        assert as_sampled(each, "y", each.t, each.columns["y"]) is each.columns["y"]


def test_inspection_names_the_slow_column(log):
    hints = inspect_runs(log).hints
    assert any("'z' has a sample every 0.1 s" in hint for hint in hints)
    assert not any("'y' has a sample" in hint for hint in hints)


def test_a_required_column_without_a_common_row_is_refused(tmp_path):
    rng = np.random.default_rng(1)
    stamps = np.sort(rng.uniform(0, 1, 12)) ** 3  # at no rate at all
    rows = [f"{k / 100},{k}," for k in range(100)] + [f"{t!r},,1" for t in stamps.tolist()]
    rows.sort(key=lambda row: float(row.split(",")[0]))
    (tmp_path / "log.csv").write_text("\n".join(["t,y,u", *rows]))
    with pytest.raises(InputError, match=r"log\.csv.*'u'.*irregular"):
        read_telemetry(tmp_path / "log.csv", names=["u"], optional=["y"], held=["u"])
    (run,) = read_telemetry(tmp_path / "log.csv", optional=["y", "u"])
    assert set(run.columns) == {"y"}
