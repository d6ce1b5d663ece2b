"""`--map NAME=EXPRESSION` and the names that columns go by."""

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry.mapping import alias, apply_maps, find_column, parse_maps
from faultgauge.telemetry.table import LogTable


def table(**columns) -> LogTable:
    arrays = {
        name: np.array(cells, dtype=object if isinstance(cells[0], str) else np.float64)
        for name, cells in columns.items()
    }
    return LogTable("log.csv", arrays, np.arange(len(next(iter(arrays.values())))) + 2)


def mapped(source: LogTable, *maps: str) -> LogTable:
    return apply_maps(source, parse_maps(maps))


def refusal(source: LogTable, *maps: str) -> str:
    with pytest.raises(InputError) as caught:
        mapped(source, *maps)
    return str(caught.value)


def test_a_map_renames_and_converts():
    rpm = [0.0, 1000.0, np.nan]
    result = mapped(table(t=[0, 1, 2], wheel_rpm=rpm), "h=wheel_rpm*0.104720*0.84")
    np.testing.assert_allclose(result.columns["h"], np.array(rpm) * 0.0879648, rtol=1e-12)
    assert list(result.columns) == ["t", "wheel_rpm", "h"]


def test_maps_see_the_file_and_not_each_other():
    result = mapped(table(t=[0, 1], u=[1, 2]), "u=u*10", "v=u+1", "d_h=2", "run=t")
    np.testing.assert_array_equal(result.columns["u"], [10, 20])
    np.testing.assert_array_equal(result.columns["v"], [2, 3])
    np.testing.assert_array_equal(result.columns["d_h"], [2, 2])
    np.testing.assert_array_equal(result.columns["run"], [0, 1])


def test_a_bare_name_renames_text():
    result = mapped(table(t=[0, 1], flight=["a", "b"]), "run=flight")
    assert list(result.columns["run"]) == ["a", "b"]


@pytest.mark.parametrize(
    ("name", "identifier"),
    [
        ("h", "h"),
        ("wheel speed [rpm]", "wheel_speed__rpm_"),
        ("motor.temp", "motor_temp"),
        ("2nd", "_2nd"),
        ("lambda", "lambda_"),
        ("ω", "ω"),
        ("\u2126", "\u03a9"),  # the ohm sign, which Python reads as a capital omega
    ],
)
def test_every_column_has_an_identifier(name, identifier):
    assert alias(name) == identifier
    result = mapped(table(**{"t": [0, 1], name: [3, 4]}), f"x=2*{identifier}")
    np.testing.assert_array_equal(result.columns["x"], [6, 8])
    assert find_column(result, identifier) == find_column(result, name) == name


def test_two_columns_for_one_name_are_refused_when_it_is_used():
    source = table(**{"t": [0, 1], "a b": [1, 2], "a.b": [3, 4], "c": [5, 6]})
    assert list(mapped(source, "x=c").columns["x"]) == [5, 6]
    message = refusal(source, "x=2*a_b")
    assert "log.csv" in message
    assert "'a b' and 'a.b'" in message
    assert find_column(source, "a b") == "a b"


def test_a_map_hides_what_goes_by_its_name():
    result = mapped(table(**{"t": [0, 1], "a b": [1, 2]}), "a_b=10*a_b")
    assert list(result.columns) == ["t", "a_b"]
    np.testing.assert_array_equal(result.columns["a_b"], [10, 20])


@pytest.mark.parametrize(
    ("maps", "words"),
    [
        (["wheel_rpm"], ["'wheel_rpm'", "NAME=EXPRESSION"]),
        (["2h=u"], ["'2h' is not a name", "'_2h'"]),
        (["=u"], ["'' is not a name"]),
        (["h=u", "h=2*u"], ["'h' twice"]),
    ],
)
def test_texts_that_are_no_maps(maps, words):
    with pytest.raises(InputError) as caught:
        parse_maps(maps)
    for word in words:
        assert word in str(caught.value)


def test_an_unknown_column_lists_them_and_suggests_one():
    message = refusal(table(t=[0, 1], wheel_rpm=[1, 2]), "h=wheel_rmp*2")
    for word in ["log.csv", "--map h", "'wheel_rmp'", "did you mean 'wheel_rpm'", "t, wheel_rpm"]:
        assert word in message


def test_a_formula_that_is_none_names_the_map():
    assert "--map h" in refusal(table(t=[0, 1], u=[1, 2]), "h=2*(u")
    assert "--map h" in refusal(table(t=[0, 1], u=[1, 2]), "h=d(u)")


def test_text_in_a_formula_names_row_and_cell():
    message = refusal(table(t=[0, 1], u=["1", "off"]), "h=2*u")
    for word in ["log.csv, row 3", "'u'", "'off'"]:
        assert word in message


@pytest.mark.parametrize(
    ("text", "found"), [("x=1/u", "inf in row 4"), ("x=log(u-1)", "nan in row 4")]
)
def test_a_value_that_is_no_number_names_the_row(text, found):
    # The empty cell in row 2 gives an empty cell; the zero in row 4 has no value.
    message = refusal(table(t=[0, 1, 2], u=[np.nan, 2, 0]), text)
    assert found in message
    assert "--map x" in message
    assert "'u'" not in message


@pytest.mark.parametrize("text", ["x=1/0", "x=(-8)**0.5", "x=10.0**400"])
def test_a_constant_without_a_value_is_refused(text):
    message = refusal(table(t=[0, 1]), text)
    assert "--map x" in message
    assert "finite real number" in message


def test_an_empty_cell_stays_empty_where_the_formula_would_hide_it():
    result = mapped(table(t=[0, 1], u=[np.nan, 2]), "x=u**0")
    np.testing.assert_array_equal(result.columns["x"], [np.nan, 1])
