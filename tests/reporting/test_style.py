"""Units, labels and a palette that survives a grey printer."""

import itertools

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from faultgauge.reporting.style import (
    BAND,
    MEASURED,
    PREDICTED,
    SERIES,
    STRANGE,
    axis_label,
    pretty_unit,
    quantity,
    short,
    time_axis,
    upright_label,
)


def lightness(color: str) -> float:
    """CIE 1976 L*, 0 black to 100 white."""
    rgb = np.array(to_rgb(color))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    y = float(linear @ [0.2126, 0.7152, 0.0722])
    return 116.0 * y ** (1.0 / 3.0) - 16.0 if y > 0.008856 else 903.3 * y


def test_neighbouring_curves_differ_in_lightness():
    for one, other in itertools.pairwise(SERIES):
        # 20 steps of L* is about the distance between two stops of a five-step grey wedge.
        assert abs(lightness(one["color"]) - lightness(other["color"])) > 20.0


@pytest.mark.parametrize(
    ("one", "other"), [(MEASURED, PREDICTED), (MEASURED, STRANGE), (BAND, PREDICTED)]
)
def test_what_lies_on_each_other_differs_in_lightness(one: str, other: str):
    assert abs(lightness(one) - lightness(other)) > 20.0


def test_no_two_curves_share_their_dashes():
    assert len({str(look["linestyle"]) for look in SERIES}) == len(SERIES)


@pytest.mark.parametrize(
    ("unit", "read"),
    [
        ("N*m*s", "N·m·s"),
        ("rad/s**2", "rad/s²"),
        ("m^-10", "m⁻¹⁰"),
        (" rpm ", "rpm"),
        ("", ""),
        ("1", "1"),
    ],
)
def test_units_as_they_are_read(unit: str, read: str):
    assert pretty_unit(unit) == read


def test_label_without_a_unit_is_the_name_alone():
    assert axis_label("speed", "") == "speed"
    assert axis_label("speed", "rad/s") == "speed (rad/s)"


def test_quantity():
    assert quantity(0.0012345, "N*m") == "0.00123\u00a0N·m"
    assert quantity(0.05, "1") == quantity(0.05, "") == "0.05"


def test_long_names_are_cut():
    assert len(short("x" * 500)) < 50
    assert short("x" * 500).endswith("…")


def test_upright_labels_are_wrapped_between_words():
    assert upright_label("torque on the wheel's housing", "N*m") == (
        "torque on the wheel's\nhousing (N·m)"
    )
    assert upright_label("Water_outlet_temperature", "degF", 20) == (
        "Water_outlet_\ntemperature (degF)"
    )
    assert upright_label("x" * 30, "V") == f"{'x' * 24}\n{'x' * 6} (V)"


@pytest.mark.parametrize(
    ("length", "unit"), [(0.0, "s"), (600.0, "s"), (86400.0, "h"), (30 * 86400.0, "d")]
)
def test_time_unit_follows_the_length_of_the_log(length: float, unit: str):
    assert time_axis(np.array([5.0, 5.0 + length]))[1] == unit
