"""A terminal view of a stream: residuals, estimates and events, live (stderr)."""

import time
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

    from faultgauge.plants.model import Model

__all__ = ["View"]

PERIOD = 0.2  # s between two drawings: the eye needs no more, the stream should have the rest
HISTORY = 30  # values of a trace
EVENTS = 8  # lines of the latest events
LIKELY = 0.5  # p from which on a fault is there rather than not
BLOCKS = "▁▂▃▄▅▆▇█"


class View:
    """Draws the newest row and the course of every residual and estimate; a context manager."""

    def __init__(self, model: "Model") -> None:
        from rich.console import Console
        from rich.live import Live

        signals = model.plant.signals
        self.units = {f"r_{each.name}": each.unit for each in signals.outputs}
        self.units |= {f"f_{each.name}": each.unit for each in signals.faults}
        self.traces: dict[str, deque[float | None]] = {}
        self.newest: dict[str, Any] = {}
        self.events: deque[str] = deque(maxlen=EVENTS)
        self.drawn = 0.0
        self.live = Live(console=Console(stderr=True), auto_refresh=False)

    def __enter__(self) -> "View":
        self.live.start()
        return self

    def __exit__(self, *failure: object) -> None:
        if self.newest:
            self.draw()
        self.live.stop()

    def rows(self, rows: Sequence[dict[str, Any]]) -> None:
        """Take rows in; draw the last if the last drawing is old enough."""
        self.newest = rows[-1]
        for name in [each for each in self.units if each in self.newest]:
            values = [row[name] for row in rows[-HISTORY:]]
            self.traces.setdefault(name, deque(maxlen=HISTORY)).extend(values)
        if time.monotonic() - self.drawn >= PERIOD:
            self.draw()

    def event(self, text: str) -> None:
        self.events.append(text)
        self.draw()

    def draw(self) -> None:
        from rich.console import Group
        from rich.text import Text

        self.drawn = time.monotonic()
        events = [Text(text, style="red" if "alarm" in text else "") for text in self.events]
        self.live.update(Group(self.table(), *events), refresh=True)

    def table(self) -> "Table":
        from rich.table import Table

        status = self.newest.get("status", "")
        reason = self.newest.get("reason") or ""
        at = self.newest.get("time") or f"t = {self.newest.get('t', 0.0):.10g} s"
        table = Table(title=f"{at}   {status}   {reason}".rstrip())
        for head in ("", "value", "95 %", "p", "unit", "course"):
            table.add_column(head, justify="left" if head in ("", "unit", "course") else "right")
        for name, trace in self.traces.items():
            high, value = self.newest.get(f"{name}_hi"), self.newest[name]
            width = None if high is None or value is None else high - value
            told, likely = self._judged(name)
            cells = (name, _number(value), _number(width), told, self.units[name])
            table.add_row(*cells, _course(trace), style="bold red" if likely else "")
        return table

    def _judged(self, name: str) -> tuple[str, bool]:
        """The probability of a fault, and whether it is likely to be there."""
        from faultgauge.reporting.words.probability import probability

        p = self.newest.get(f"p_{name.removeprefix('f_')}") if name.startswith("f_") else None
        return ("", False) if p is None else (probability(p), p >= LIKELY)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _course(trace: deque[float | None]) -> str:
    """The trace as blocks between its own least and greatest value."""
    known = [value for value in trace if value is not None]
    if not known:
        return ""
    low, span = min(known), (max(known) - min(known)) or 1.0
    return "".join(
        " " if value is None else BLOCKS[int((value - low) / span * (len(BLOCKS) - 1))]
        for value in trace
    )
