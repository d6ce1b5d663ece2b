"""Sizes and odds as they are said."""

import pytest

from faultgauge.detection.words import amount, less_likely


@pytest.mark.parametrize(
    ("size", "low", "high", "said"),
    [
        (0.1, 0.0958, 0.1042, "+0.1000 N*m (+0.0958 to +0.1042)"),
        (-0.0288, -0.0576, 0.0, "-0.029 N*m (-0.058 to +0.000)"),
        (300.0, 280.0, 320.0, "+300 N*m (+280 to +320)"),
        (0.0020006, 0.0019937, 0.0020075, "+0.002001 N*m (+0.001994 to +0.002008)"),
        (3e-8, 2e-8, 4e-8, "+3.0e-08 N*m (+2.0e-08 to +4.0e-08)"),
    ],
)
def test_a_size_is_said_with_its_interval_as_fine_as_that_is(size, low, high, said):
    assert amount(size, low, high, "N*m") == said


def test_odds_are_said_as_times():
    assert less_likely(["leak"], 200.4) == "leak instead is 200 times less likely"
    assert less_likely(["leak", "gauge"], 1000.0) == (
        "leak or gauge instead is more than 1000 times less likely"
    )
    assert less_likely(["leak"], 1.01) == "leak instead is as likely"
    assert less_likely(["leak"], 2.214) == "leak instead is 2.21 times less likely"
