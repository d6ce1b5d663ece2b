"""How much of the wanted envelope a record covers."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.plants.signals import spoken

__all__ = ["Coverage", "coverage", "sentence"]


class Coverage(NamedTuple):
    """What a record reached, by axis and as a whole.

    `reached` is [min, max] on every axis, `share` the part of the wanted range that lies between
    them, `at_limit` the share of samples at or beyond a limit (NaN: this axis has none; None: no
    limits given), `occupied` the share of the grid cells of the wanted box that hold a sample.
    """

    reached: Float[np.ndarray, "axes 2"]
    share: Float[np.ndarray, "axes"]
    at_limit: Float[np.ndarray, "axes"] | None
    occupied: float


def coverage(
    points: Float[np.ndarray, "points axes"],
    low: Float[np.ndarray, "axes"],
    high: Float[np.ndarray, "axes"],
    cells: int = 20,
    limits: Float[np.ndarray, "axes 2"] | None = None,
) -> Coverage:
    """Coverage of the box from `low` to `high` by `points`, each axis in its own unit.

    The box is cut into `cells` equal parts along every axis. Points that are not finite are
    passed over. Raises `InputError` if there are no others, or if the box has no volume.
    """
    if not (np.isfinite(high - low).all() and (high > low).all() and cells >= 1):
        raise InputError(
            "Coverage needs a wanted range with low < high, both finite, on every axis, and at "
            "least one cell; give them."
        )
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        raise InputError(
            "Coverage needs at least one sample that is complete; the record has none."
        )
    lowest, highest = points.min(axis=0), points.max(axis=0)
    overlap = np.minimum(highest, high) - np.maximum(lowest, low)
    inside = points[((points >= low) & (points <= high)).all(axis=1)]
    place = np.minimum((cells * ((inside - low) / (high - low))).astype(int), cells - 1)
    return Coverage(
        reached=np.stack([lowest, highest], axis=1),
        share=np.maximum(overlap, 0.0) / (high - low),
        at_limit=None if limits is None else _at_limit(points, limits),
        occupied=len(np.unique(place, axis=0)) / float(cells) ** len(low),
    )


def _at_limit(
    points: Float[np.ndarray, "points axes"], limits: Float[np.ndarray, "axes 2"]
) -> Float[np.ndarray, "axes"]:
    # a log may have rounded the limit that the actuator clips at
    slack = 1e-9 * np.where(np.isfinite(limits), np.abs(limits), 0.0)
    low, high = (limits + slack)[:, 0], (limits - slack)[:, 1]
    share = ((points <= low) | (points >= high)).mean(axis=0)
    return np.where(np.isfinite(limits).any(axis=1), share, np.nan)


def sentence(found: Coverage, names: Sequence[str], units: Sequence[str]) -> str:
    """The coverage in one plain sentence."""
    at_limit = np.full(len(names), np.nan) if found.at_limit is None else found.at_limit
    axes = []
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        low, high = found.reached[k]
        limit = (
            "" if np.isnan(at_limit[k]) else f", {_percent(at_limit[k])} of the samples at a limit"
        )
        reached = f"{name} from {low:.3g} to {high:.3g} {spoken(unit)}".rstrip()
        axes.append(f"{reached} ({_percent(found.share[k])} of the wanted range{limit})")
    what = "cells of the wanted range" if len(axes) == 1 else "cells of the wanted box"
    return (
        f"The record covers {' and '.join(axes)}; {_percent(found.occupied)} of the {what} hold a "
        "sample."
    )


def _percent(share: float) -> str:
    """0.123 -> "12 %"; nothing and everything are said only where they are true."""
    if 0 < share < 0.01:
        return "less than 1 %"
    return f"{min(round(100 * share), 99) if share < 1 else 100} %"
