"""Sizes, times and odds as they are said."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from faultgauge.plants.signals import spoken
from faultgauge.telemetry.clock import Clock

__all__ = [
    "Began",
    "POSSIBLE_ODDS",
    "TOLD_ODDS",
    "OLDER",
    "UNDECLARED",
    "about",
    "amount",
    "between",
    "duration",
    "less_likely",
    "likelihoods",
    "listed",
    "moment",
    "number",
    "times_more",
    "would_not_show",
]

TOLD_ODDS = 1000.0  # odds beyond which what is told rests on the model more than on them
POSSIBLE_ODDS = 20.0  # odds up to which something undeclared is spoken of: nobody can list it all
LARGE = 1e6  # from which on a number is said in powers of ten
SMALL = 1e-4  # below which a number is said in powers of ten
ROUNDING = 1e-6  # of the last decimal
JITTER = 0.01  # decades: rows that are 0.00099 s apart are not told finer than those of 0.001 s
CENTRED = 0.1  # of half an interval: a value that near its middle is in it
SPANS = ((100.0, 1.0, "s"), (3600.0, 60.0, "min"), (48 * 3600.0, 3600.0, "h"))  # below: in, as
FINEST = 12  # decimals of s, that are ever said
CLOCKED = 6  # decimals of s, that a clock has
READ = 3  # decimals of s, that a clock is read to where nothing says how fine a time is known
COARSE = 600.0  # s, from which on a clock is read to the minute
OLDER = "already there when the log begins"
UNDECLARED = "something undeclared"
AGAIN = " (winter time)"  # where the clock shows a time for the second time


def amount(size: float, low: float, high: float, unit: str) -> str:
    """ "+0.100 N*m (+0.096 to +0.104)", as fine as the interval is."""
    style = _style(low, high)
    return f"{size:{style}} {spoken(unit)}".rstrip() + f" ({low:{style}} to {high:{style}})"


def between(low: float, high: float, unit: str) -> str:
    """ "between +0.10 and +0.30 N*m", as fine as they are apart."""
    style = _style(low, high)
    return f"between {low:{style}} and {high:{style}} {spoken(unit)}".rstrip()


def _style(low: float, high: float) -> str:
    """How what lies from `low` to `high` is written."""
    largest = max(abs(low), abs(high))
    if 0 < largest < SMALL:
        power = np.floor(np.log10(largest))
        return f"+.{decimals((high - low) / 10.0**power)}e"
    return f"+.{decimals(high - low)}f"


def number(value: float, figures: int = 3) -> str:
    """`figures` of a value; in powers of ten only what is very small or large: "520", "3.2e-06"."""
    text = f"{value:.{figures}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < LARGE else text


def less_likely(causes: Sequence[str], odds: float) -> str:
    """ "leak is 200 times less likely"."""
    if odds < 1.05:
        return f"{listed(causes, 'or')} is as likely"
    times = f"more than {TOLD_ODDS:.0f}" if odds >= TOLD_ODDS else number(odds, 2)
    return f"{listed(causes, 'or')} is {times} times less likely"


def likelihoods(instead: Iterable[tuple[str, float]], up_to: float = POSSIBLE_ODDS) -> list[str]:
    """The sentences of `less_likely` for causes with their odds, those of the same odds together,
    the likeliest first; something undeclared where its odds are below `up_to`."""
    causes, said = dict[float, list[str]](), list[str]()
    for cause, odds in sorted(instead, key=lambda each: each[1]):
        if cause == UNDECLARED:
            if odds < up_to:
                said.append(f"{UNDECLARED} is only {odds:.2g} times less likely")
        else:
            causes.setdefault(min(odds, TOLD_ODDS), []).append(cause)
    return [*said, *(less_likely(each, odds) for odds, each in causes.items())]


def would_not_show(least: Mapping[str, tuple[float | None, str]]) -> str:
    """What of each fault, by its name the smallest size that shows (None: none does) and its unit,
    a log would not have shown."""
    small = [f"{name} below {f'{number(size, 2)} {unit}'.rstrip()}" for name, (size, unit) in
             least.items() if size is not None]  # fmt: skip
    blind = [name for name, (size, _) in least.items() if size is None]
    if not small:
        return f"{listed(blind)} of any size to be expected would not have shown"
    beside = f", nor would {listed(blind, 'or')} of any size to be expected" if blind else ""
    return f"{listed(small)} would not have shown{beside}"


def listed(names: Sequence[str], word: str = "and") -> str:
    """ "a, b and c"."""
    *first, last = names
    return f"{', '.join(first)} {word} {last}" if first else last


def times_more(count: int) -> str:
    """ "once more", "3 times more"."""
    return "once more" if count == 1 else f"{count} times more"


def moment(clock: Clock | None, t: float, resolution: float = 0.0) -> str:
    """`t` [s] as the log's clock shows it, or as seconds; as fine as `resolution` [s] is, and
    rounded down, as clocks do, so that nothing is said to be later than it was. With the date where
    that is another day, and with a word where the clock shows that time for the second time."""
    if clock is None:
        unit = _unit(clock, resolution)
        return f"{np.floor(t / unit + ROUNDING) * unit:.12g} s"
    at = clock.at(t)
    date = "" if at.date() == clock.begun.date() else f"{at.date().isoformat()} "
    again = AGAIN if clock.shown_twice(t) else ""
    if resolution >= COARSE:
        return date + at.time().isoformat("minutes") + again
    part = f"{at.microsecond:06d}"[: _clock_decimals(resolution)].rstrip("0")
    return date + at.time().isoformat("seconds") + (f".{part}" if part else "") + again


def _unit(clock: Clock | None, resolution: float) -> float:
    """The unit [s] of the last figure of a time that is told as fine as `resolution` [s] is."""
    if clock is None:
        return 10.0 ** -decimals(resolution)
    return 60.0 if resolution >= COARSE else 10.0 ** -_clock_decimals(resolution)


def _clock_decimals(resolution: float) -> int:
    """Decimals of the seconds of a clock that is read as finely as `resolution` [s] is."""
    return 0 if resolution >= 1 else min(decimals(resolution), READ)


def about(clock: Clock | None, t: float, resolution: float, told: float = np.inf) -> str:
    """The same, but rounded to the nearest time that is not later than `told` [s]."""
    unit = _unit(clock, resolution)
    beyond, figures = t % unit, FINEST
    if clock is not None:
        at = clock.at(t)
        beyond, figures = (at.second + at.microsecond / 1e6) % unit, CLOCKED
    after = round(t - beyond + unit, figures)
    return moment(clock, after if 2 * beyond >= unit and after <= told else t, resolution)


def duration(seconds: float) -> str:
    """ "23 s", "5.2 min", "1.5 h", "4.1 days"."""
    for below, unit, name in SPANS:
        if float(f"{seconds:.2g}") < below:
            return f"{number(seconds / unit, 2)} {name}"
    return f"{number(seconds / 86400.0, 2)} days"


class Began(NamedTuple):
    """When a fault began, from `low` to `high` [s], told at `told` [s] or not yet, in rows that are
    `step` [s] apart. Its times are rounded to the nearest that is not later than told."""

    clock: Clock | None
    t: float
    low: float
    high: float
    told: float = np.inf
    step: float = 0.0

    def since(self) -> str:
        """ "since 299.5 s +- 1.1 s", "since 08:41 +- 1.5 h" by a clock, or "since 299.5 s (298.1 s
        to 300 s)" where that is not the middle of its interval."""
        half = (self.high - self.low) / 2
        at, first, last = self._three()
        if abs((self.low + self.high) / 2 - self.t) <= CENTRED * half:
            width = f"{number(half, 2)} s" if self.clock is None else duration(half)
            return f"since {at} +- {width}"
        return f"since {at} ({first} to {last})"

    def cell(self) -> str:
        """ "299.5 s (298.1 s to 300 s)", in a table."""
        at, first, last = self._three()
        return f"{at} ({first} to {last})"

    def or_earlier(self) -> str:
        """ "299.5 s or earlier", of what began by `high`."""
        return f"{self._shown(self.high)} or earlier"

    def _three(self) -> tuple[str, str, str]:
        """The time and its interval's ends; where all are of one day, with one date."""
        at, first, last = (self._shown(t) for t in (self.t, self.low, self.high))
        day = f"{self.clock.at(self.t).date().isoformat()} " if self.clock else ""
        if day and all(each.startswith(day) for each in (at, first, last)):
            return at, first.removeprefix(day), last.removeprefix(day)
        return at, first, last

    def _shown(self, t: float) -> str:
        return about(self.clock, t, max((self.high - self.low) / 2, self.step), self.told)


def decimals(width: float) -> int:
    """Decimals that show two figures of `width`."""
    if not width > 0:
        return 6
    return min(max(0, int(np.ceil(-np.log10(width) - JITTER)) + 1), FINEST)
