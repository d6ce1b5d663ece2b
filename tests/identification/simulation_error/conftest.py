"""What several tests of the refinement simulate, by SciPy."""

import numpy as np
from scipy.integrate import solve_ivp


def over_stairs(rate, start, u, step, width):
    """x of x' = rate(x, u), u constant over every `width` samples; each stair is integrated on its
    own, so that no step of the integrator spans a jump."""
    x, ticks = np.zeros(len(u)), step * np.arange(width + 1)
    x[0] = start
    for first in range(0, len(u), width):
        found = solve_ivp(
            lambda t, x, drive: rate(x, drive),
            (0, ticks[-1]),
            x[first : first + 1],
            t_eval=ticks,
            args=(u[first],),
            rtol=1e-8,
            atol=1e-10,
        )
        x[first : first + width + 1] = found.y[0, : len(u) - first]
    return x
