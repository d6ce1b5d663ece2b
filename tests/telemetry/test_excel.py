"""Spreadsheets: a table is found where people put it, with merged headers, units and remarks."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry import read_telemetry
from faultgauge.telemetry.readers import read_table, stem

from .workbooks import write_workbook

ROWS = [[0.5 * k, 10.0 + k, 20 - k] for k in range(5)]


def test_a_plain_sheet(tmp_path):
    path = write_workbook(tmp_path / "log.xlsx", {"Tabelle1": [["t", "u", "x [bar]"], *ROWS]})
    (run,) = read_telemetry(path, names=["u", "x"])
    assert (run.name, run.notes) == ("log", ())
    np.testing.assert_array_equal(run.t, [0, 0.5, 1, 1.5, 2])
    np.testing.assert_array_equal(run.columns["x"], [20, 19, 18, 17, 16])
    assert run.units == {"x": "bar"}


def test_merged_headers_a_title_a_row_of_units_and_remarks(tmp_path):
    rows = [
        ["Test bench 7", None, None],
        ["Operator", "Smith", None],
        ["Serial", 7, None],
        [],
        ["Pump test of the day", None, None],
        ["Time", "Pump", None],
        [None, "flow", "speed"],
        ["[s]", "[L/min]", "rpm"],
        *ROWS,
        [],
        [None, None, None, "checked"],
    ]
    path = write_workbook(tmp_path / "log.xlsx", {"Data": rows}, "A1:C1 A5:C5 A6:A7 B6:C6")
    table = read_table(path)
    assert list(table.columns) == ["Time", "Pump flow", "Pump speed"]
    assert table.units == {"Time": "s", "Pump flow": "L/min", "Pump speed": "rpm"}
    np.testing.assert_array_equal(table.rows, [9, 10, 11, 12, 13])
    np.testing.assert_array_equal(table.columns["Pump flow"], [10, 11, 12, 13, 14])
    assert table.notes[0].endswith("left out: column D.")


def test_a_sheet_is_named_behind_the_file(tmp_path):
    sheets = {
        "Notes": [["made by", "Smith"]],
        "Mon": [["t", "u"], [0, 1], [1, 2]],
        "Tue": [["t", "u"], [0, 3], [1, 4]],
    }
    path = write_workbook(tmp_path / "log.xlsx", sheets)
    (first,) = read_telemetry(path, names=["u"])
    assert first.columns["u"].tolist() == [1, 2]
    assert "sheet 'Mon' is read, the first with a table, and not 'Notes', 'Tue'" in first.notes[0]
    monday, tuesday = read_telemetry([f"{path}#Mon", f"{path}#Tue"], names=["u"])
    assert (monday.name, tuesday.name, tuesday.notes) == ("log:Mon", "log:Tue", ())
    assert tuesday.columns["u"].tolist() == [3, 4]
    assert stem(Path("a/b.XLSX#Tue")) == "b:Tue"
    with pytest.raises(InputError, match=r"no sheet 'Wed'; it has 'Notes', 'Mon', 'Tue'"):
        read_table(Path(f"{path}#Wed"))
    with pytest.raises(InputError, match="no table in sheet 'Notes'; a log needs a row of column"):
        read_table(Path(f"{path}#Notes"))
    with pytest.raises(InputError, match="same file"):
        read_telemetry([f"{path}#Mon", f"{path}#Mon"])


def test_dates_empty_cells_and_numbers_kept_as_text(tmp_path):
    begin = datetime(2026, 11, 22, 14, 3, 7)
    when = [begin + timedelta(seconds=30 * k) for k in range(4)]
    cells = [
        ["time", "u", "v"],
        *([w, None if k == 2 else k, f"{k},5"] for k, w in enumerate(when)),
    ]
    (run,) = read_telemetry(write_workbook(tmp_path / "log.xlsx", {"a": cells}), time="time")
    # days in float64 are good to a microsecond
    np.testing.assert_allclose(run.t, [0, 30, 60, 90], atol=1e-5)
    assert abs(run.clock.begun - begin) < timedelta(milliseconds=1)
    np.testing.assert_array_equal(run.columns["u"], [0, 1, np.nan, 3])
    np.testing.assert_array_equal(run.columns["v"], [0.5, 1.5, 2.5, 3.5])


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([["t", "u", "u"], [0, 1, 2], [1, 2, 3]], "2 columns are called 'u'"),
        ([[0, 1], [1, 2], [2, 3]], "no table in sheet 'a'"),
        ([["t", "u"], [0, 1]], "no table"),
        ([["t", "u"], [0, 1], [1, "ERR"], [2, 3]], "row 3, column 'u': 'ERR' is not a number"),
    ],
)
def test_refusals(tmp_path, rows, words):
    path = write_workbook(tmp_path / "log.xlsx", {"a": rows})
    with pytest.raises(InputError) as caught:
        read_telemetry(path, names=["u"])
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
