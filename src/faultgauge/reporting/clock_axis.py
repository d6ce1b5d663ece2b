"""Ticks of a time axis as the log's own clock showed them."""

from datetime import timedelta

import numpy as np

from faultgauge.telemetry.clock import Clock

__all__ = ["clock_label", "clock_ticks"]

MOST_TICKS = 7  # whose labels stay apart
DAY = 86400.0  # s
DUST = 1e-6  # of a step, which rounding may put a time off
STEPS = (
    *(f * 10.0**k for k in (-3, -2, -1) for f in (1.0, 2.0, 5.0)),
    *(1.0, 2.0, 5.0, 10.0, 15.0, 30.0),
    *(60.0 * minutes for minutes in (1, 2, 5, 10, 15, 30)),
    *(3600.0 * hours for hours in (1, 2, 3, 6, 12)),
    *(DAY * f * 10.0**k for k in range(6) for f in (1.0, 2.0, 5.0)),
)


def clock_ticks(clock: Clock, start: float, end: float) -> tuple[list[float], list[str]]:
    """Where between `start` and `end` (s) of a log round times lie by its `clock`, and what that
    showed there; the date below the first and wherever it changes."""
    midnight = clock.begun.replace(hour=0, minute=0, second=0, microsecond=0)
    since = (clock.begun - midnight).total_seconds()
    step = next((s for s in STEPS if (end - start) / s <= MOST_TICKS - 1), STEPS[-1])
    first, last = (since + start) / step - DUST, (since + end) / step + DUST
    rounds = np.arange(np.ceil(first), np.floor(last) + 1)
    places, labels, date = [], [], ""
    for k in rounds.tolist():
        place = min(max(k * step - since, start), end)
        # from midnight, as adding up fractions of a second rounds; `put` is whole hours
        at = midnight + timedelta(seconds=k * step + clock.moved(place))
        day = at.date().isoformat()
        time = at.time().isoformat("seconds")
        if step < 1.0:
            time += f".{at.microsecond:06d}"[: 1 + int(np.ceil(-np.log10(step)))]
        if step >= DAY:
            labels.append(day)
        else:
            labels.append(time if day == date else f"{time}\n{day}")
        places.append(place)
        date = day
    return places, labels


def clock_label(clock: Clock) -> str:
    """What a time axis of that clock is called: with its zone, where it told one."""
    return f"time ({clock.begun.tzname()})" if clock.begun.tzinfo else "time"
