"""The algorithms that `fit` can use, by name: a new one is a new file and one line here."""

from collections.abc import Callable
from typing import Literal, NamedTuple

from faultgauge.identification.optimise.gradient_descent import DescentOptions, gradient_descent
from faultgauge.identification.optimise.levenberg_marquardt import (
    Options,
    Solution,
    levenberg_marquardt,
)

__all__ = ["ALGORITHMS", "Algorithm", "AlgorithmName"]

AlgorithmName = Literal["lm", "gdm"]


class Algorithm(NamedTuple):
    """`minimise(residual, starts, samples, validation, lower, upper, options)`."""

    minimise: Callable[..., Solution]
    options: Options | DescentOptions


ALGORITHMS: dict[AlgorithmName, Algorithm] = {
    "lm": Algorithm(levenberg_marquardt, Options()),
    "gdm": Algorithm(gradient_descent, DescentOptions()),
}
