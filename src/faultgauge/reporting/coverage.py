"""Which points lie outside what a training log covered."""

import numpy as np
from jaxtyping import Bool, Float

__all__ = ["outside"]

FEWEST_CELLS, MOST_CELLS = 8, 40  # along one side
POINTS_PER_CELL = 4.0  # of training, on the average


def outside(
    training: Float[np.ndarray, "points 2"], other: Float[np.ndarray, "others 2"]
) -> Bool[np.ndarray, "others"]:
    """Return which points of another log no training point comes near.

    The training range is cut into square cells, fewer where there are few points; a point is
    outside when neither its cell nor any of the eight around it holds a training point. A point
    with NaN in it is not outside: nobody knows where it is.

    Args:
        training: points that the model has seen, one axis per column, any units.
        other: points to judge, the same axes.
    """
    training = training[np.isfinite(training[:, 0]) & np.isfinite(training[:, 1])]
    known = np.isfinite(other[:, 0]) & np.isfinite(other[:, 1])
    if len(training) == 0:
        return known
    count = int(np.clip(np.sqrt(len(training) / POINTS_PER_CELL), FEWEST_CELLS, MOST_CELLS))
    low, span = training.min(axis=0), np.ptp(training, axis=0)
    size = np.where(span > 0.0, span, np.maximum(np.abs(low), 1.0)) / count
    seen = np.zeros((count + 4, count + 4), dtype=bool)  # two empty cells all around
    column, row = (np.clip(np.floor((training - low) / size), 0, count - 1).astype(int) + 2).T
    for shift in np.ndindex(3, 3):
        seen[column + shift[0] - 1, row + shift[1] - 1] = True
    place = np.where(known[:, None], np.floor((other - low) / size), -2.0)
    column, row = (np.clip(place, -2, count + 1).astype(int) + 2).T
    return known & ~seen[column, row]
