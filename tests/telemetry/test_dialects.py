"""Text files as measuring programs of all countries write them."""

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry import inspect_runs, read_telemetry
from faultgauge.telemetry.headers import split_headers, unit_row
from faultgauge.telemetry.readers import read_table
from faultgauge.telemetry.table import is_text

from .conftest import refusal


@pytest.fixture
def log(tmp_path):
    def write(text, name="log.csv", encoding="utf-8"):
        (tmp_path / name).write_bytes(text.encode(encoding))
        return tmp_path / name

    return write


PLAIN = [[0.0, -0.25, 3.0], [1.5, 1e-3, np.nan], [2.0, 7.0, 4.0]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,u,x\n0,-0.25,3\n1.5,1e-3,\n2,7,4\n", None),
        ("t;u;x\n0;-0,25;3\n1,5;1e-3;\n2;7;4\n", "semicolons, numbers have decimal commas"),
        ("t;u;x\n0;-0.25;3\n1.5;1e-3;\n2;7;4\n", "semicolons, numbers have decimal points"),
        ("t\tu\tx\n0\t-0.25\t3\n1.5\t1e-3\t\n2\t7\t4\n", "tabs, numbers have decimal points"),
        ("t\tu\tx\n0\t-,25\t3\n1,5\t1E-3\t\n2\t7\t4\n", "tabs, numbers have decimal commas"),
        ("t|u|x\n0|-0.25|3\n1.5|1e-3|\n2|7|4\n", "bars, numbers have decimal points"),
        ('t;u;x\n"0";"-0,25";3\n"1,5";0,001;\n2;7;4\n', "semicolons, numbers have decimal commas"),
        ("sep=;\nt;u;x\n0;-0,25;3\n1,5;1e-3;\n2;7;4\n", "semicolons, numbers have decimal commas"),
    ],
    ids=["plain", "German", "semicolons", "tabs", "tabs and commas", "bars", "quotes", "sep="],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_one_table_in_all_dialects(log, text, said, encoding):
    table = read_table(log(text, encoding=encoding))
    assert list(table.columns) == ["t", "u", "x"]
    np.testing.assert_array_equal(np.column_stack(list(table.columns.values())), PLAIN)
    header = 2 if text.startswith("sep") else 1
    np.testing.assert_array_equal(table.rows, header + np.arange(1, 4))
    assert [said in each for each in table.readings] == ([True] if said else [])


def test_the_dialect_is_said_by_every_reading(log):
    path = log("t;u\n0;1,5\n1;2,5\n")
    sentence = f"{path}: cells are separated by semicolons, numbers have decimal commas."
    assert read_telemetry(path)[0].notes == (sentence,)
    assert sentence in inspect_runs(path).hints


def test_text_beside_decimal_commas(log):
    path = log("t;mode;u;v\n0;a, b;0,5;1\n1;c;ERR;2,5\n")
    table = read_table(path)
    assert list(table.columns["mode"]) == ["a, b", "c"]
    assert is_text(table.columns["u"])
    assert "row 3, column 'u': 'ERR' is not a number" in refusal(path, names=["u"])
    np.testing.assert_array_equal(table.columns["v"], [1, 2.5])


@pytest.mark.parametrize("cell", ["1.234,5", "1.234"])
def test_marks_between_thousands_are_refused(log, cell):
    message = refusal(log(f"t;u\n0;0,5\n1;{cell}\n"))
    assert f"row 3, column 'u': '{cell}' has a point where" in message


def test_a_header_of_windows(log):
    table = read_table(log("t;T [°C]\n0;1,5\n1;2,5\n", encoding="cp1252"))
    assert table.units == {"T": "°C"}
    assert "Windows-1252" in table.readings[1]


@pytest.mark.parametrize("units", ["s,V,degC", "[s],[V],[degC]", "(s),V,°C", "s,,degC", "-,V,°C"])
def test_a_row_of_units_beneath_the_header(log, units):
    table = read_table(log(f"t,u,T\n{units}\n0,1,20\n1,2,21\n"))
    np.testing.assert_array_equal(table.columns["T"], [20, 21])
    np.testing.assert_array_equal(table.rows, [3, 4])
    assert table.units["T"] in ("degC", "°C")
    assert table.units.get("u", "V") == "V"


@pytest.mark.parametrize(
    "cells",
    [
        ["0", "1"],
        ["", ""],
        ["2026-11-22 14:03", "A"],
        ["22.11.2026", "V"],
        ["idle", "A"],
        ["nan", "V"],
    ],
)
def test_no_row_of_units(cells):
    assert unit_row(cells) is None


def test_an_unknown_unit_among_known_ones_is_a_label():
    assert unit_row(["s", "V", "furlong"]) == ["s", "V", "furlong"]


@pytest.mark.parametrize(
    ("headers", "names", "units"),
    [
        (["T [degC]", "p (bar)", "U/V"], ["T", "p", "U"], ["degC", "bar", "V"]),
        (["q[m3/h]", "k (W/(m*K))", "v / m/s"], ["q", "k", "v"], ["m3/h", "W/(m*K)", "m/s"]),
        (["eta [%]", "cos phi [-]"], ["eta", "cos phi"], ["%", "1"]),
        (["x [raw]", "x [1]", "T (oil)"], ["x [raw]", "x [1]", "T (oil)"], [None] * 3),
        (["u (A)", "u (B)"], ["u (A)", "u (B)"], [None, None]),  # phases
        (["T [degC]", "T [degF]"], ["T [degC]", "T [degF]"], ["degC", "degF"]),
        (["T", "T [degC]"], ["T", "T [degC]"], [None, None]),
        (["rig/V", "rig/speed"], ["rig/V", "rig/speed"], [None, None]),  # folders
        (["/imu/V", "a/b/s"], ["/imu/V", "a/b/s"], [None, None]),
        (["p [bar]", "rig/a (V)"], ["p", "rig/a"], ["bar", "V"]),
    ],
)
def test_units_in_headers(headers, names, units):
    found = split_headers(headers)
    assert found.names == names
    assert [found.units.get(name) for name in names] == units


def test_a_column_is_known_by_its_whole_header_too(log):
    path = log("t [ms],wheel speed [rpm],p/bar\n0,1,5\n500,2,6\n1000,3,7\n")
    (run,) = read_telemetry(path, names=["wheel_speed", "p"])
    np.testing.assert_array_equal(run.t, [0, 0.5, 1])
    assert run.units == {"wheel_speed": "rpm", "p": "bar"}
    (run,) = read_telemetry(path, time="t [ms]", maps=["w=wheel_speed__rpm_*2"], names=["w"])
    np.testing.assert_array_equal(run.columns["w"], [2, 4, 6])


def test_degrees_are_brought_to_those_of_the_plant(log):
    """A reading by zero and scale; a bias of 9 degF, by scale, is one of 5 degC."""
    healthy, biased = (
        log("t,T [degF]\n0,32\n1,50\n2,212\n"),
        log("t,T [degF]\n0,41\n1,59\n2,221\n", "b.csv"),
    )
    runs = read_telemetry([healthy, biased], names=["T"], units={"T": "degC"})
    np.testing.assert_allclose(runs[0].columns["T"], [0, 10, 100], atol=1e-12)  # rounding
    np.testing.assert_allclose(runs[1].columns["T"] - runs[0].columns["T"], 5, rtol=1e-12)
    assert runs[0].notes == (f"{healthy}: converted to the plant's units: 'T' from degF to degC.",)
    assert runs[0].units == {"T": "degC"}
    (kelvin,) = read_telemetry(healthy, names=["T"], units={"T": "K"})
    np.testing.assert_allclose(kelvin.columns["T"], [273.15, 283.15, 373.15], rtol=1e-12)
    (rate,) = read_telemetry(
        log("t,d_T [degF/s]\n0,9\n1,18\n"), names=["d_T"], units={"d_T": "(degC)/s"}
    )
    np.testing.assert_allclose(rate.columns["d_T"], [5, 10], rtol=1e-12)


def test_a_folder_stands_for_the_logs_in_it(log, tmp_path):
    log("t,u\n0,1\n1,2\n", "b.csv")
    log("t;u\n0;1\n1;2\n", "a.txt")
    log("no log", ".hidden.csv")
    log("no log", "notes.md")
    assert [run.name for run in read_telemetry(tmp_path)] == ["a", "b"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="a folder without a log"):
        read_telemetry(tmp_path / "empty")
