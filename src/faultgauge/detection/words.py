"""Sizes, times and odds as they are said."""

from collections.abc import Sequence
from datetime import datetime, timedelta

import numpy as np

__all__ = ["MOST", "OLDER", "PURE", "UNDECLARED", "amount", "less_likely", "moment", "since"]

MOST = 1000.0  # odds beyond which what is told rests on the model more than on them
PURE = ("1", "-")  # units that nobody says
SMALL = 1e-4  # below which a number is said in powers of ten
ROUNDING = 1e-6  # of the last decimal
CENTRED = 0.1  # of half an interval: a value that near its middle is in it
OLDER = "already there when the log begins"
UNDECLARED = "something undeclared"


def amount(size: float, low: float, high: float, unit: str) -> str:
    """ "+0.100 N*m (+0.096 to +0.104)", as fine as the interval is."""
    digits = decimals(high - low)
    largest = max(abs(low), abs(high), abs(size))
    style = f"+.{digits}f"
    if 0 < largest < SMALL:
        style = f"+.{max(digits + int(np.floor(np.log10(largest))), 0)}e"
    unit = "" if unit in PURE else unit
    return f"{size:{style}} {unit}".rstrip() + f" ({low:{style}} to {high:{style}})"


def less_likely(causes: Sequence[str], odds: float) -> str:
    """ "leak instead is 200 times less likely"."""
    if odds < 1.05:
        return f"{' or '.join(causes)} instead is as likely"
    times = f"more than {MOST:.0f}" if odds >= MOST else f"{odds:.3g}"
    return f"{' or '.join(causes)} instead is {times} times less likely"


def moment(clock: datetime | None, t: float, resolution: float = 0.0) -> str:
    """`t` [s] as a clock that showed `clock` at 0 s shows it, or as seconds; as fine as
    `resolution` [s] is, and rounded down, as clocks do, so that nothing is said to be later than
    it was. With the date where that is another day."""
    if clock is None:
        unit = 10.0 ** -decimals(resolution)
        return f"{np.floor(t / unit + ROUNDING) * unit:.12g} s"
    at = clock + timedelta(seconds=t)
    date = "" if at.date() == clock.date() else f"{at.date().isoformat()} "
    whole = resolution >= 1 or not at.microsecond
    return date + at.time().isoformat("seconds" if whole else "milliseconds")


def since(clock: datetime | None, onset: float, low: float, high: float) -> str:
    """ "since 299.5 s +- 1.1 s", or "since 299.5 s (298.1 s to 300 s)" where that is not the middle
    of its interval."""
    half = (high - low) / 2
    began = f"since {moment(clock, onset, half)}"
    if abs((low + high) / 2 - onset) <= CENTRED * half:
        return f"{began} +- {half:.2g} s"
    return f"{began} ({moment(clock, low, half)} to {moment(clock, high, half)})"


def decimals(width: float) -> int:
    """Decimals that show two figures of `width`."""
    return min(max(0, int(np.ceil(-np.log10(width))) + 1), 12) if width > 0 else 6
