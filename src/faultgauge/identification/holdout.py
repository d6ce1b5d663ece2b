"""What is held out of a fit: the last 15 % of each run, and windows spread over the rest."""

import numpy as np
from jaxtyping import Bool

from faultgauge.identification.samples import Stretch

__all__ = ["LAST_SHARE", "split", "split_record"]

LAST_SHARE = 0.15  # of every run, held out
SPREAD_WINDOWS = 3  # held out before that
SPREAD_SHARE = 0.02  # each
LONG_SHARE = 0.05  # each, where a free run passes through: long enough to forget what was fitted


def split(stretches: list[Stretch]) -> tuple[list[np.ndarray], list[list[slice]]]:
    """(training mask per stretch, validation windows per stretch).

    Every stretch gives its last 15 % and, where it is long enough, three short windows.
    Training samples whose kernel reaches into a window are left out too.
    """
    masks, windows = [], []
    for stretch in stretches:
        count = len(stretch.t)
        first = int(count * (1 - LAST_SHARE))
        cuts = [slice(first, count)]
        width = int(count * SPREAD_SHARE)
        if width >= 20:
            for k in range(1, SPREAD_WINDOWS + 1):
                start = first * k // (SPREAD_WINDOWS + 1)
                cuts.append(slice(start, start + width))
        mask = np.ones(count, bool)
        for cut in cuts:
            mask[max(0, cut.start - 2 * stretch.reach) : cut.stop + 2 * stretch.reach] = False
        masks.append(mask)
        windows.append(cuts)
    return masks, windows


def split_record(count: int) -> Bool[np.ndarray, "samples"]:
    """Which of `count` samples in a row are fitted: not the last 15 %, nor three windows."""
    mask = np.ones(count, bool)
    first, width = int(count * (1 - LAST_SHARE)), int(count * LONG_SHARE)
    mask[first:] = False
    for k in range(1, SPREAD_WINDOWS + 1):
        start = first * k // (SPREAD_WINDOWS + 1)
        mask[start : start + width] = False
    return mask
