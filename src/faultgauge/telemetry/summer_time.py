"""Local clocks that are put back or forward by an hour within a log.

Only a clock that does it as clocks do is corrected: in the night of a Sunday, at a full hour, by
just an hour beside the usual step. Any other jump stays what it is.
"""

from collections import deque
from datetime import datetime, timedelta
from statistics import median
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

__all__ = ["ClockChange", "Evenly", "change_note", "without_summer_time"]

HOUR = 3600.0  # s
NEAR = 0.5  # of a step, within which a jump is one of an hour
LATEST = 4  # o'clock
SUNDAY = 6  # of `weekday`
LOST = 2  # rows that may be missing where a clock is put back
STEPS = 20  # that tell a stream's usual one


class ClockChange(NamedTuple):
    """From `when` [s] on a clock was put forward `by` so much [s]; what it showed last before."""

    when: float
    by: float
    before: datetime


def change_note(source: str, run: str, before: datetime) -> str:
    """What is said of a change after the clock showed `before`."""
    return (
        f"{source}: the clock is put forward or back by an hour after "
        f"{before:%Y-%m-%d %H:%M:%S} in run {run!r}, as where summer time begins or ends; seconds "
        "(t) go on evenly there."
    )


def without_summer_time(
    t: Float[np.ndarray, "rows"], samples: Int[np.ndarray, "samples"], clock: datetime | None
) -> tuple[Float[np.ndarray, "samples"], list[ClockChange]]:
    """Times [s] of one run, `t[samples]`, as a clock would have them that nobody puts forward or
    back, and where that was done. `clock` is what it showed at 0 s; one with a zone, or none, is
    not put anywhere."""
    times = t[samples]
    changes: list[ClockChange] = []
    if clock is None or clock.tzinfo is not None or len(times) < 3:
        return times, changes
    times, steps = times.copy(), np.diff(times)
    usual = float(np.median(steps))
    forward = np.abs(steps - usual - HOUR) <= NEAR * usual
    for k in np.flatnonzero(forward | ((steps < 0) & (steps > -HOUR))):
        before = clock + timedelta(seconds=float(t[samples[k]]))
        moved = _put(float(steps[k]), usual, before)
        if moved:
            times[k + 1 :] -= moved
            changes.append(ClockChange(float(times[k + 1]), moved, before))
    return times, changes


class Evenly:
    """The same row by row: called with each time [s] after the row before was `kept`, it gives the
    time as a clock would have it that nobody puts forward or back, and the change where it was."""

    def __init__(self) -> None:
        self.last: float | None = None
        self.moved = 0.0
        self.steps: deque[float] = deque(maxlen=STEPS)

    @property
    def usual(self) -> float:
        """The usual step [s], 0 before there is one."""
        return median(self.steps) if self.steps else 0.0

    def __call__(self, t: float, clock: datetime | None) -> tuple[float, ClockChange | None]:
        if clock is None or clock.tzinfo is not None or self.last is None or len(self.steps) < 2:
            return t - self.moved, None
        before = clock + timedelta(seconds=self.last)
        moved = _put(t - self.last, self.usual, before)
        evenly = t - self.moved - moved
        return evenly, ClockChange(evenly, moved, before) if moved else None

    def kept(self, t: float, evenly: float) -> None:
        """That the row of time `t`, which it took for `evenly`, was one."""
        if self.last is not None:
            self.steps.append(evenly - (self.last - self.moved))
        self.last, self.moved = t, t - evenly


def _put(step: float, usual: float, before: datetime) -> float:
    """By how much [s] a clock was put forward in a `step` after it showed `before`, or 0.

    Time never goes back by itself, so some rows may be missing there; where it jumps ahead that
    would be a gap.
    """
    for moved, lost in ((HOUR, 0), (-HOUR, LOST)):  # in spring, in autumn
        rest = step - moved
        near = (1 - NEAR) * usual <= rest <= (1 + lost + NEAR) * usual
        if near and 0 < usual < HOUR and _at_night(before, max(rest, usual), usual):
            return moved
    return 0.0


def _at_night(before: datetime, rest: float, usual: float) -> bool:
    """Whether a full hour strikes within `rest`, to half a step, of `before`, in the night of a
    Sunday."""
    struck = before + timedelta(seconds=rest + NEAR * usual)
    hour = struck.replace(minute=0, second=0, microsecond=0)
    nearby = hour > before - timedelta(seconds=NEAR * usual)
    return nearby and hour.weekday() == SUNDAY and hour.hour <= LATEST
