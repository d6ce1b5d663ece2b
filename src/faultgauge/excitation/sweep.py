"""Triangles: a reference that takes a state through its range at constant speed."""

import math

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError

__all__ = ["triangles"]


def triangles(samples: int, amplitude: float, cycles: int = 2) -> Float[np.ndarray, "samples"]:
    """`cycles` triangles 0, +A, 0, -A, 0, each samples/cycles long; the last 0 would be the next
    sample.

    The slope is 4 A cycles/(samples dt) everywhere: what follows the triangles has to be that
    fast. Raises `InputError` for fewer than 4 samples in a triangle.
    """
    if not (cycles >= 1 and samples >= 4 * cycles):
        raise InputError(
            f"{samples} samples do not make {cycles} triangles; give at least one triangle, and 4 "
            "samples for each."
        )
    if not (0 < amplitude < math.inf):
        raise InputError(f"The amplitude of a triangle is {amplitude:g}; it must be positive.")
    phase = np.arange(samples) * cycles / samples % 1.0
    return amplitude * np.interp(phase, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])
