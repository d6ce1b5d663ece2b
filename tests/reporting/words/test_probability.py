"""p in words never claims certainty, and grows as p does."""

import pytest

from faultgauge.reporting.words.probability import probability


@pytest.mark.parametrize(
    ("p", "said"),
    [
        (1.0, "> 0.999"),
        (0.9991, "> 0.999"),
        (0.999, "0.999"),
        (0.9951, "0.995"),
        (0.99, "0.99"),
        (0.5, "0.5"),
        (0.0012, "0.0012"),
        (0.0, "< 0.001"),
    ],
)
def test_nothing_is_certain(p, said):
    assert probability(p) == said
