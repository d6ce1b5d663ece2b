"""What is held out: the end of every stretch, spread windows, and a margin around both."""

import numpy as np
import pytest

from faultgauge.identification.holdout import split
from faultgauge.identification.samples import Samples, Stretch


def stretch(count, reach=0):
    nothing = np.zeros((count, 0))
    return Stretch(
        run="a",
        step=1.0,
        reach=reach,
        t=np.arange(count, dtype=float),
        samples=Samples(nothing, nothing, nothing, nothing),
        measured=nothing,
        applied=nothing,
        references=nothing,
    )


def test_short_stretch_gives_its_last_part():
    masks, windows = split([stretch(200)])
    assert windows == [[slice(170, 200)]]
    np.testing.assert_array_equal(masks[0], np.arange(200) < 170)


def test_long_stretch_gives_windows_too():
    masks, windows = split([stretch(2000)])
    last, *spread = windows[0]
    assert last == slice(1700, 2000)
    assert [cut.stop - cut.start for cut in spread] == [40, 40, 40]
    assert [cut.start for cut in spread] == [425, 850, 1275]  # quarters of what is not the end
    held = np.zeros(2000, bool)
    for cut in windows[0]:
        assert not held[cut].any()  # no window overlaps another
        held[cut] = True
    np.testing.assert_array_equal(masks[0], ~held)
    assert np.mean(held) == pytest.approx(0.15 + 3 * 0.02, abs=1e-3)  # whole samples


@pytest.mark.parametrize("reach", [1, 8])
def test_no_training_sample_shares_data_with_a_window(reach):
    """A smoothed sample reaches `reach` samples away, and so does one of the window."""
    masks, windows = split([stretch(2000, reach)])
    kept = np.flatnonzero(masks[0])
    for cut in windows[0]:
        window = np.arange(cut.start, cut.stop)
        assert np.min(np.abs(kept[:, None] - window)) > 2 * reach
    assert len(kept) == 2000 - 420 - (2 + 2 + 2 + 1) * 2 * reach


def test_every_stretch_gives_something():
    masks, windows = split([stretch(100), stretch(40), stretch(3000)])
    assert [len(w) for w in windows] == [1, 1, 4]
    assert [len(m) for m in masks] == [100, 40, 3000]
