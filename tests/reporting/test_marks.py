"""What an axis shows of an estimate and its band."""

import numpy as np
from matplotlib.figure import Figure

from faultgauge.reporting import marks


def test_a_band_that_leaves_0_out_is_shown_whole_and_a_prior_is_not():
    """Nothing for 90 samples, as wide as a prior in ten of them; then 6.6, 3.1 to 10.1."""
    f, lo, hi = np.zeros(100), np.full(100, -0.1), np.full(100, 0.1)
    lo[20:30], hi[20:30] = -50.0, 50.0
    f[90:], lo[90:], hi[90:] = 6.6, 3.1, 10.1
    axes = Figure().subplots()
    marks.look_at_estimate(axes, f, lo, hi, np.ones(100, bool))
    bottom, top = axes.get_ylim()
    assert -2.0 < bottom < -0.1
    assert 10.1 < top < 12.0
