"""Where a command's processor time goes (`--profile`): each moment is the innermost phase's."""

import builtins
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter, process_time
from typing import Any

__all__ = ["phase", "profiled"]

REST = "the rest"


class _Phases:
    """Seconds of the processor by phase; what came before the first is Python's own start."""

    def __init__(self) -> None:
        self.last = process_time()
        self.spent, self.within = {"starting Python": self.last}, [REST]

    def turn(self) -> None:
        now, name = process_time(), self.within[-1]
        self.spent[name] = self.spent.get(name, 0.0) + now - self.last
        self.last = now


_phases: _Phases | None = None


@contextmanager
def phase(name: str) -> Iterator[None]:
    """What is done in it counts for the phase `name`, where phases are counted."""
    if (phases := _phases) is None:
        yield
        return
    phases.turn()
    phases.within.append(name)
    try:
        yield
    finally:
        phases.turn()
        phases.within.pop()


@contextmanager
def profiled(say: Callable[[str], None]) -> Iterator[None]:
    """Counts phases, imports of modules among them, and says at the end where the time went."""
    global _phases
    _phases, start, usual = _Phases(), perf_counter(), builtins.__import__

    def counted(*args: Any, **more: Any) -> Any:
        with phase("loading modules"):
            return usual(*args, **more)

    builtins.__import__ = counted
    try:
        yield
    finally:
        builtins.__import__ = usual
        _phases.turn()
        found, _phases = _phases.spent, None
        total = sum(found.values())
        wall = perf_counter() - start
        say(f"{total:.2f} s of processor time, {wall:.2f} s by the clock:")
        for name, spent in sorted(found.items(), key=lambda each: -each[1]):
            say(f"  {spent:6.2f} s  {spent / total:4.0%}  {name}")
