"""Triangles by hand."""

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.excitation import triangles


def test_two_triangles_of_eight_samples():
    one = [0.0, 1.0, 2.0, 1.0, 0.0, -1.0, -2.0, -1.0]
    np.testing.assert_array_equal(triangles(16, 2.0), one * 2)


def test_the_slope_is_the_same_everywhere():
    x = triangles(1000, 150.0, cycles=2)
    # 4 * 150 * 2 / 1000 = 1.2 a sample; rounding of 150
    np.testing.assert_allclose(np.abs(np.diff(x)), 1.2, rtol=0, atol=1e-12)
    assert (x.max(), x.min(), x[0], np.argmax(x), np.argmin(x)) == (150.0, -150.0, 0.0, 125, 375)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((7, 1.0, 2), "7 samples do not make 2 triangles"),
        ((8, 1.0, 0), "8 samples do not make 0 triangles"),
        ((8, 0.0), "amplitude of a triangle is 0"),
    ],
)
def test_refusals(arguments, words):
    with pytest.raises(InputError, match=words):
        triangles(*arguments)
