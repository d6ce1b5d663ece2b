"""Tables: what goes in comes back, in either format."""

import csv
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry import Run
from faultgauge.telemetry.clock import Clock
from faultgauge.telemetry.writing import as_table, write_table

COLUMNS = {
    "run": ["a", "a"],
    "t": [0.0, 0.1],
    "f_leak": [None, -1.25e-7],
    "status": ["NOT_JUDGED", "HEALTHY"],
    "reason": ["not sampled", ""],
}


def test_csv_comes_back_with_empty_cells_for_none(tmp_path):
    write_table(COLUMNS, tmp_path / "e.csv")
    rows = list(csv.reader((tmp_path / "e.csv").read_text().splitlines()))
    assert rows == [
        list(COLUMNS),
        ["a", "0", "", "NOT_JUDGED", "not sampled"],
        ["a", "0.1", "-1.25e-07", "HEALTHY", ""],
    ]


def test_parquet_comes_back_as_it_was(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    write_table(COLUMNS, tmp_path / "e.parquet")
    assert parquet.read_table(tmp_path / "e.parquet").to_pydict() == COLUMNS


def test_a_log_with_a_clock_keeps_its_time(tmp_path):
    """So that rows can be joined to the export that they come from."""
    run = Run("a", "a.csv", np.array([0.0, 0.5]), {"x": np.array([1.0, np.nan])})
    assert list(as_table(run)) == ["t", "x"]
    columns = as_table(replace(run, clock=Clock(datetime(2026, 5, 1, 23, 59, 59, 750_000))))
    assert columns == {
        "t": [0.0, 0.5],
        "time": ["2026-05-01T23:59:59.750000", "2026-05-02T00:00:00.250000"],
        "x": [1.0, None],
    }
    parquet = pytest.importorskip("pyarrow.parquet")
    write_table(columns, tmp_path / "e.parquet")
    assert parquet.read_table(tmp_path / "e.parquet").to_pydict() == columns


def test_no_label_is_a_formula(tmp_path):
    """To a spreadsheet a cell that begins with one of these is a program; a number is not."""
    labels = ["=1+1", "+1+1", "-x", "@SUM(A1)", "\t=1", "-1.5", "a=1", ""]
    write_table({"run": labels, "t": [-1.0] * len(labels)}, tmp_path / "e.csv")
    rows = list(csv.reader((tmp_path / "e.csv").read_text().splitlines()))[1:]
    expected = ["'=1+1", "'+1+1", "'-x", "'@SUM(A1)", "'\t=1", "-1.5", "a=1", ""]
    assert rows == [[label, "-1"] for label in expected]


def test_an_unknown_ending_and_a_missing_folder_are_refused():
    with pytest.raises(InputError, match=r"legal: \.csv, \.csv\.gz, \.parquet"):
        write_table(COLUMNS, Path("e.xls"))
    with pytest.raises(InputError, match="does not exist"):
        write_table(COLUMNS, Path("nowhere") / "e.csv")
