"""Keeping time: absolute deadlines on the monotonic clock, and how well they were kept."""

import time
from array import array
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["Pacer", "Punctuality"]

SPIN = 1e-3  # s before a time from which on the clock is watched: sleeping is no finer
LEAD = 5e-3  # s before its deadline that the work on a sample begins, a quarter period at most


@dataclass(frozen=True)
class Punctuality:
    """How late samples were done, in s after their deadlines: median, 99th percentile, greatest.

    An overrun is a sample that was not done when the next one was due.
    """

    samples: int
    period: float
    p50: float
    p99: float
    greatest: float
    overruns: int

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON, times in ms."""
        return {
            "samples": self.samples,
            "period_ms": 1e3 * self.period,
            "jitter_ms": {"p50": 1e3 * self.p50, "p99": 1e3 * self.p99, "max": 1e3 * self.greatest},
            "overruns": self.overruns,
        }

    def sentence(self) -> str:
        """ "600 samples every 10 ms: late by 0.3 ms (p50), 0.9 ms (p99), 2 ms (max); 0 ..." """
        return (
            f"{self.samples} samples every {1e3 * self.period:.4g} ms: late by "
            f"{1e3 * self.p50:.3g} ms (p50), {1e3 * self.p99:.3g} ms (p99), "
            f"{1e3 * self.greatest:.3g} ms (max); {self.overruns} overruns"
        )


class Pacer:
    """Deadlines `period` [s] apart, reckoned from the first: errors do not add up, and a sample
    that came late is followed by the next at once, not left out."""

    def __init__(self, period: float) -> None:
        self.period = period
        self.lead = min(LEAD, period / 4)
        self.late = array("d")
        self.start: float | None = None

    def wait_for_work(self) -> None:
        """Return shortly before the next sample's deadline, in time to make it."""
        if self.start is None:
            self.start = time.perf_counter() + self.lead
        _sleep_until(self.deadline - self.lead)

    def wait(self) -> None:
        """Return at the next sample's deadline, at once where it has passed."""
        _sleep_until(self.deadline)

    def done(self) -> None:
        """The sample that was waited for is out."""
        self.late.append(time.perf_counter() - self.deadline)

    @property
    def deadline(self) -> float:
        """Of the next sample, on the clock of `time.perf_counter`."""
        assert self.start is not None
        return self.start + len(self.late) * self.period

    def punctuality(self) -> Punctuality:
        """Of all samples so far."""
        late = np.array(self.late or [0.0])
        p50, p99 = np.quantile(late, [0.5, 0.99]).tolist()
        overruns = int((late > self.period).sum())
        return Punctuality(len(self.late), self.period, p50, p99, float(late.max()), overruns)


def _sleep_until(moment: float) -> None:
    left = moment - time.perf_counter()
    if left > SPIN:
        time.sleep(left - SPIN)
    while time.perf_counter() < moment:
        pass
