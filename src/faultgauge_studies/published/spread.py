"""Median and range over seeds."""

from collections.abc import Sequence

import numpy as np

__all__ = ["spread"]


def spread(values: Sequence[float]) -> dict[str, float | None]:
    """`{median, min, max}`; None for what is not finite (a free run that diverges)."""
    numbers = np.where(np.isfinite(values), values, np.inf)
    found = {
        "median": float(np.median(numbers)),
        "min": float(np.min(numbers)),
        "max": float(np.max(numbers)),
    }
    return {key: value if np.isfinite(value) else None for key, value in found.items()}
