"""What is said of fitted constants, by numbers set here."""

from dataclasses import replace

import numpy as np

from faultgauge.identification.constants import (
    ConstantsInformation,
    FittedConstant,
    LateColumn,
)


def information(close, vague=()):
    """Constants a to e, each 1.0, known to a fifth where `vague`, correlated by 0.995 where
    `close`."""
    each = tuple(
        FittedConstant(name, "", 1.0, 0.2 if name in vague else 0.01, None, None)
        for name in "abcde"
    )
    correlation = np.eye(5)
    for one, other in close:
        i, j = "abcde".index(one), "abcde".index(other)
        correlation[i, j] = correlation[j, i] = -0.995
    return ConstantsInformation(each, correlation, (), 1.0)


def test_constants_that_cannot_be_told_apart_are_one_sentence():
    found = information(["ab", "bc", "ac", "de"], "abcde").warnings()
    assert found == [
        "parameters 'a', 'b' and 'c' cannot be told apart by these logs (correlations up to "
        "0.995); fix one of them",
        "parameters 'd' and 'e' cannot be told apart by these logs (correlation -0.995); fix one "
        "of them",
    ]


def test_constants_that_are_known_all_the_same_are_none():
    assert information(["ab", "bc"], "a").warnings() == []


def test_a_lag_of_few_samples_is_left_to_calibrate():
    late = LateColumn("u", 0.013, 0.001, True, 1.3), LateColumn("y", 0.2, 0.01, False, 20.0)
    long, short = ConstantsInformation((), np.eye(0), (), 1.0, late=late).warnings()
    assert long.startswith("'y' comes about 0.2 s later than the plant file has it")
    assert long.endswith("add it as a state, or give delay in [inputs.NAME]")
    assert short.startswith("the plant follows 'u' about 0.013 s later than the plant file has it")
    assert "give it no state" in short
    assert "add it as a state" not in short


def test_standard_errors_below_rounding_are_lost_and_said_once():
    """Slopes of an unstable run grow to 1e20 and more, as if each constant were known to as many
    digits."""
    found = information(["ab"], "ab").constants
    lost = tuple(replace(each, standard_error=None, by_chance=1e-21) for each in found)
    told = ConstantsInformation(lost, np.eye(len(lost)), (), 1.0).warnings()
    assert len(told) == 1
    assert told[0].startswith(f"the standard errors of {', '.join(e.name for e in lost)} cannot")
