"""What a log's own clock shows at its times in seconds."""

from dataclasses import dataclass
from datetime import datetime, timedelta

__all__ = ["Clock"]


@dataclass(frozen=True)
class Clock:
    """A clock that showed `begun` at 0 s. `put` are the times [s] from which on it was put forward,
    and by how much [s], less than 0 where back, as where summer time begins or ends."""

    begun: datetime
    put: tuple[tuple[float, float], ...] = ()

    def at(self, t: float) -> datetime:
        """What it shows at `t` [s]."""
        return self.begun + timedelta(seconds=t + self.moved(t))

    def moved(self, t: float) -> float:
        """By how much [s] it had been put forward by `t` [s]."""
        return sum((by for when, by in self.put if when <= t), 0.0)

    def shown_twice(self, t: float) -> bool:
        """Whether it shows at `t` [s] what it showed before it was put back."""
        return any(by < 0 and when <= t < when - by for when, by in self.put)
