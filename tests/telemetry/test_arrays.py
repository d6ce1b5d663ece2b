"""Which arrays of a file make a table, and which channels of several clocks one row."""

from pathlib import Path

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry.readers.arrays import array_table
from faultgauge.telemetry.readers.join import Channel, join

PATH = Path("log.mat")


def names(**arrays) -> list[str]:
    return list(array_table(PATH, arrays, {}).columns)


def test_vectors_of_one_length():
    table = array_table(
        PATH,
        {"t": np.arange(4.0), "u": np.ones((4, 1)), "v": np.ones((1, 4), int), "g": np.array(2.5)},
        {"u": "V", "v": ""},
    )
    assert list(table.columns) == ["t", "u", "v"]
    assert table.columns["v"].dtype == np.float64
    assert table.units == {"u": "V", "v": ""}
    assert table.rows.tolist() == [1, 2, 3, 4]
    assert table.notes == ()


def test_a_matrix_is_as_many_columns_whichever_way_it_lies():
    tall = np.arange(8.0).reshape(4, 2)
    for matrix in (tall, tall.T):
        table = array_table(PATH, {"t": np.arange(4.0), "x": matrix}, {"x": "m"})
        np.testing.assert_array_equal(table.columns["x_0"], tall[:, 0])
        np.testing.assert_array_equal(table.columns["x_1"], tall[:, 1])
        assert table.units == {"x_0": "m", "x_1": "m"}
    square = np.arange(4.0).reshape(2, 2)
    table = array_table(PATH, {"t": np.arange(2.0), "x": square}, {})
    np.testing.assert_array_equal(table.columns["x_0"], square[:, 0])  # rows are samples


def test_the_length_of_the_time_counts():
    time, fine = np.arange(5.0), np.arange(100.0) ** 2
    assert names(**{"rig.time": time, "y": time, "a": fine, "b": fine, "c": fine}) == [
        "rig.time",
        "y",
    ]
    # every length has a time, or none: the one with most columns
    assert names(t=time, y=time, w=time, time=fine, z=fine) == ["t", "y", "w"]
    assert names(y=time, a=fine, b=fine) == ["a", "b"]


def test_a_choice_that_is_not_ours_is_refused():
    with pytest.raises(InputError, match=r"log\.mat.*5 samples: t, y; 100 samples: time, z.*own"):
        names(t=np.arange(5.0), y=np.ones(5), time=np.arange(100.0), z=np.ones(100))


@pytest.mark.parametrize(
    "arrays",
    [
        {},
        {"gain": np.array(1.0)},
        {"volume": np.ones((3, 4, 5))},
        {"spectrum": np.ones(5, dtype=complex)},
        {"image": np.ones((300, 400))},
    ],
)
def test_nothing_to_read(arrays):
    with pytest.raises(InputError, match=r"log\.mat holds no vector"):
        array_table(PATH, arrays, {})


def test_what_does_not_fit_is_named():
    arrays = {"t": np.arange(4.0), "k": np.ones(3), "image": np.ones((300, 400)), "g": np.ones(())}
    (note,) = array_table(PATH, arrays, {}).notes
    assert "not made of 4 samples" in note
    assert "image (300 x 400), k (3)." in note


def test_dates_and_durations_become_seconds():
    start = np.datetime64("2026-03-01T12:00:00", "us")
    table = array_table(
        PATH,
        {
            "time": start + np.array([0, 250_000, 1_000_000]),
            "lag": np.array([1500, 0, "NaT"], "m8[ms]"),
            "day": np.array(["2026-03-01", "2026-03-02", "NaT"], "M8[D]"),
        },
        {},
    )
    assert table.columns["time"].tolist() == [0, 0.25, 1]
    np.testing.assert_array_equal(table.columns["lag"], [1.5, 0, np.nan])
    np.testing.assert_array_equal(table.columns["day"], [0, 86400, np.nan])


def test_channels_are_joined_on_time():
    fast = np.arange(6) / 10
    text = np.array(["on", "off"], dtype=object)
    table = join(
        PATH,
        [
            Channel("x", fast, np.arange(6), "m"),
            Channel("p", fast[::2] + 1e-7, np.arange(6.0).reshape(3, 2)),  # rounded clock
            Channel("mode", np.array([0.05, 0.5]), text),
            Channel("once", np.array([0.1]), np.array([1.0])),
        ],
    )
    np.testing.assert_allclose(table.columns["t"], [0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5], rtol=1e-15)
    nan = np.nan
    np.testing.assert_array_equal(table.columns["x"], [0, nan, 1, 2, 3, 4, 5])
    np.testing.assert_array_equal(table.columns["p_1"], [1, nan, nan, 3, nan, 5, nan])
    assert table.columns["mode"].tolist() == ["", "on", "", "", "", "", "off"]
    assert table.units == {"t": "s", "x": "m"}
    assert "once" in table.notes[0]


def test_a_channel_whose_time_stands_still_is_refused():
    with pytest.raises(InputError, match=r"log\.mat, channel 'x'.*sample 2 \(1 s\)"):
        join(PATH, [Channel("x", np.array([0.0, 1.0, 1.0]), np.arange(3.0))])
    with pytest.raises(InputError, match="no channel"):
        join(PATH, [])
