"""Events while they happen: an alarm when one begins, the whole event when it is over."""

from array import array
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from faultgauge.detection.estimation import FAULT, Event, Judgement, Limits, events, pause
from faultgauge.detection.judged import Bank
from faultgauge.telemetry import Run

__all__ = ["Alarm", "Episode"]

Values = dict[str, Float[np.ndarray, "samples"]]


@dataclass(frozen=True)
class Alarm:
    """An event has begun at `start` [s]: the hypothesis that stands highest above its limit, and
    its estimate then, in its unit (None for an undeclared one). Which one it was in the end, and
    how large, its event tells."""

    run: str
    fault: str
    start: float
    size: float | None


class Episode:
    """The event that is going on, if one is: its rows so far, as its size is their median."""

    def __init__(self, bank: Bank) -> None:
        self.bank = bank
        self.t = array("d")
        self.values: dict[str, array[float]] = {}
        self.above = bytearray()
        self.last = 0.0  # time of the last row above the limit

    def push(self, judgement: Judgement, values: Values) -> Iterator[Alarm | Event]:
        """What a judged row begins or ends."""
        run, above = judgement.run, judgement.status == [FAULT]
        t = float(run.t[0])
        if self.t and t - self.last >= pause(self.bank):
            yield from self.close(run)
        if above and not self.t:
            scales = Limits.of(self.bank, values).scales
            fault = max(scales, key=lambda name: float(abs(values[name][0])) / scales[name])
            yield Alarm(run.name, fault, t, float(values[fault][0]))
        if above or self.t:
            self.t.append(t)
            self.above.append(above)
            for name, value in values.items():
                self.values.setdefault(name, array("d")).append(float(value[0]))
        if above:
            self.last = t

    def close(self, run: Run) -> list[Event]:
        """The event of `run` that is over; none where none was going on."""
        if not self.t:
            return []
        values = {name: np.array(each) for name, each in self.values.items()}
        stretch = Run(run.name, run.source, np.array(self.t), {})
        above = np.array(self.above, bool)
        found = events(self.bank, stretch, values, Limits.of(self.bank, values), above)
        self.t, self.values, self.above = array("d"), {}, bytearray()
        return found
