"""Coverage, counted by hand."""

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.excitation import coverage, sentence

# wanted: u in [-1, 1], h in [0, 10]; 4 x 4 cells of 0.5 by 2.5
LOW, HIGH = np.array([-1.0, 0.0]), np.array([1.0, 10.0])
POINTS = np.array(
    [
        [-1.0, 0.0],  # cell (0, 0): its lower corner belongs to it
        [-0.6, 2.4],  # cell (0, 0) again
        [0.0, 2.5],  # cell (2, 1)
        [1.0, 5.0],  # cell (3, 2): the upper edge of the box belongs to the last cell
        [0.9, 5.1],  # cell (3, 2) again
        [0.4, 12.0],  # outside the box
        [np.nan, 9.0],  # unknown
    ]
)


def test_by_hand():
    limits = np.array([[-1.0, 1.0], [-np.inf, 12.0]])
    found = coverage(POINTS, LOW, HIGH, cells=4, limits=limits)
    np.testing.assert_array_equal(found.reached, [[-1.0, 1.0], [0.0, 12.0]])
    np.testing.assert_array_equal(found.share, [1.0, 1.0])
    np.testing.assert_array_equal(found.at_limit, [2 / 6, 1 / 6])
    assert found.occupied == 3 / 16


def test_a_range_beside_the_wanted_one_is_no_share_of_it():
    found = coverage(np.array([[2.0, 2.5], [3.0, 5.0]]), LOW, HIGH)
    np.testing.assert_array_equal(found.share, [0.0, 0.25])
    assert (found.occupied, found.at_limit) == (0.0, None)


def test_a_limit_rounded_by_a_log_is_still_the_limit():
    points = np.array([[0.82], [0.8199999999999], [-0.8200000001], [0.819]])
    found = coverage(points, np.array([-1.0]), np.array([1.0]), 2, np.array([[-0.82, 0.82]]))
    np.testing.assert_array_equal(found.at_limit, [0.75])


def test_an_axis_without_limits_is_not_said_to_keep_them():
    limits = np.array([[-1.0, 1.0], [-np.inf, np.inf]])
    found = coverage(POINTS, LOW, HIGH, limits=limits)
    np.testing.assert_array_equal(found.at_limit, [2 / 6, np.nan])
    assert "h from 0 to 12 m (100 % of the wanted range);" in sentence(
        found, ["u", "h"], ["V", "m"]
    )


def test_a_grid_full_of_points_is_full():
    axis = (np.arange(20) + 0.5) / 20
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    assert coverage(points, np.zeros(3), np.ones(3)).occupied == 1.0


def test_the_sentence():
    limits = np.array([[-1.0, 1.0], [-np.inf, 12.0]])
    found = coverage(POINTS, LOW, HIGH, cells=4, limits=limits)
    assert sentence(found, ["u", "h"], ["V", ""]) == (
        "The record covers u from -1 to 1 V (100 % of the wanted range, 33 % of the samples at a "
        "limit) and h from 0 to 12 (100 % of the wanted range, 17 % of the samples at a limit); "
        "19 % of the cells of the wanted box hold a sample."
    )


def test_the_sentence_does_not_round_to_nothing_or_everything():
    found = coverage(np.array([[0.0], [0.999]]), np.array([0.0]), np.array([1.0]), cells=1000)
    assert "(99 % of the wanted range); less than 1 % of the cells" in sentence(found, ["x"], ["m"])


@pytest.mark.parametrize(
    ("points", "high", "words"),
    [
        (POINTS, np.array([-1.0, 10.0]), "low < high"),
        (POINTS, np.array([np.inf, 10.0]), "both finite"),
        (POINTS[-1:], HIGH, "the record has none"),
    ],
)
def test_refusals(points, high, words):
    with pytest.raises(InputError, match=words):
        coverage(points, LOW, high)
