"""Local clocks that are put back or forward by an hour within a log.

Only a clock that does it as clocks do is corrected: in the night of a Sunday, at a full hour, by
just an hour beside the usual step. Any other jump stays what it is.
"""

from datetime import datetime, timedelta

import numpy as np
from jaxtyping import Float, Int

__all__ = ["without_summer_time"]

HOUR = 3600.0  # s
NEAR = 0.5  # of a step, within which a jump is one of an hour
LATEST = 4  # o'clock
SUNDAY = 6  # of `weekday`


def without_summer_time(
    t: Float[np.ndarray, "rows"], samples: Int[np.ndarray, "samples"], clock: datetime | None
) -> tuple[Float[np.ndarray, "samples"], list[datetime]]:
    """Times [s] of one run, `t[samples]`, as a clock would have them that nobody puts forward or
    back, and where that was done: what the clock showed last before. `clock` is what it showed at
    0 s; one with a zone, or none, is not put anywhere."""
    times = t[samples]
    changes: list[datetime] = []
    if clock is None or clock.tzinfo is not None or len(times) < 3:
        return times, changes
    times, steps = times.copy(), np.diff(times)
    usual = float(np.median(steps))
    for sign in (1.0, -1.0):  # forward in spring, back in autumn
        for k in np.flatnonzero(np.abs(steps - usual - sign * HOUR) <= NEAR * usual):
            before = clock + timedelta(seconds=float(t[samples[k]]))
            if usual < HOUR and _at_night(before, usual):
                times[k + 1 :] -= sign * HOUR
                changes.append(before)
    return times, sorted(changes)


def _at_night(before: datetime, step: float) -> bool:
    """Whether a full hour strikes within a step and a half of `before`, in the night of a
    Sunday."""
    struck = before + timedelta(seconds=(1 + NEAR) * step)
    hour = struck.replace(minute=0, second=0, microsecond=0)
    nearby = hour > before - timedelta(seconds=NEAR * step)
    return nearby and hour.weekday() == SUNDAY and hour.hour <= LATEST
