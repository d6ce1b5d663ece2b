"""Rows on standard output as they come, and lines from standard input."""

import contextlib
import errno
import json
import math
import os
import signal
import sys
import threading
from _thread import interrupt_main
from collections.abc import Callable, Iterator, Mapping
from importlib.machinery import ExtensionFileLoader
from types import FrameType
from typing import Any

from faultgauge.cli import options
from faultgauge.errors import InputError
from faultgauge.files import size_in_words

__all__ = [
    "Interrupt",
    "RowWriter",
    "Skipped",
    "end_as_interrupts",
    "end_in_peace",
    "input_lines",
    "let_go",
    "while_read",
]

# Ctrl-C, kill, and the terminal that closes; not every system has the last.
ENDS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
LONGEST = 1_000_000  # bytes of a line
AGAIN = 0.05  # s until an interrupt that was swallowed, or had to wait, is raised anew
# what Python loads compiled modules by
COMPILED = (ExtensionFileLoader.create_module.__code__, ExtensionFileLoader.exec_module.__code__)
PIECE = 1 << 16  # bytes of standard input that are taken at once: what a pipe holds
GONE = {errno.EPIPE, errno.EIO}  # nobody reads the pipe; the terminal was closed


class RowWriter:
    """Writes rows of the same columns to standard output, each time flushed: CSV or NDJSON."""

    def __init__(self, form: str) -> None:
        self.form = form
        self.begun = False

    def write(self, *rows: Mapping[str, Any]) -> None:
        """Rows that are there at once; None is an empty cell (CSV) or null (NDJSON), as is what has
        no number."""
        from faultgauge.telemetry.writing import csv_line

        if self.form == "ndjson":
            lines = [json.dumps({n: _json(cell) for n, cell in row.items()}) + "\n" for row in rows]
        else:
            head = [] if self.begun else [csv_line(rows[0])]
            lines = head + [csv_line(row.values()) for row in rows]
        self.begun = True
        sys.stdout.write("".join(lines))
        sys.stdout.flush()


def _json(cell: Any) -> Any:
    """JSON has no infinity, where a free run that diverges has."""
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


@contextlib.contextmanager
def while_read() -> Iterator[None]:
    """Ends the block quietly when whoever reads standard output has gone."""
    try:
        yield
    except OSError as failure:
        if failure.errno not in GONE:
            raise
        let_go()


def let_go() -> None:
    """What is still to be printed goes nowhere, or Python would complain at exit."""
    with contextlib.suppress(OSError, ValueError):  # no real file, as under a test
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def end_as_interrupts() -> Callable[[], bool]:
    """What ends a program by default ends it as Ctrl-C does; not what it was begun to ignore, as
    under nohup. An interrupt that comes within a finalizer, which swallows it, comes once more, and
    one that comes while a compiled module starts, some of which abort the program, waits for that.

    What is returned tells whether any came: compiled modules make an error of their own of it, and
    some print it, as those that NumPy is loaded by do."""
    usual, came = sys.unraisablehook, list[signal.Signals]()
    printed = sys.excepthook

    def interrupt(number: int, frame: FrameType | None) -> None:
        if _starts_compiled(frame):
            again(signal.Signals(number))
            return
        came.append(signal.Signals(number))
        raise KeyboardInterrupt

    def again(sent: signal.Signals) -> None:
        threading.Timer(AGAIN, interrupt_main, (sent,)).start()

    def swallowed(found: Any) -> None:
        if issubclass(found.exc_type, KeyboardInterrupt):
            again(came[-1] if came else signal.SIGINT)
        else:
            usual(found)

    def told_by_compiled(kind: Any, *what: Any) -> None:
        if not issubclass(kind, KeyboardInterrupt):
            printed(kind, *what)

    for each in ENDS:
        if signal.getsignal(each) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(each, interrupt)
    sys.unraisablehook, sys.excepthook = swallowed, told_by_compiled
    return lambda: bool(came)


def _starts_compiled(frame: FrameType | None) -> bool:
    """Whether what runs is called by a compiled module that is being loaded."""
    while frame is not None:
        if frame.f_code in COMPILED:
            return True
        frame = frame.f_back
    return False


def end_in_peace() -> None:
    """All is done: what would end the program comes too late to interrupt anything."""
    for each in ENDS:
        signal.signal(each, signal.SIG_IGN)


class Interrupt:
    """Ctrl-C, and what ends as it does, cuts short what is `waiting`, and else waits for that.

    A context manager, which raises `KeyboardInterrupt` at its end where one came. However many
    come, the first alone is raised: a terminal that closes sends several.
    """

    came = False
    idle = False

    def __enter__(self) -> "Interrupt":
        heard = [each for each in ENDS if signal.getsignal(each) is not signal.SIG_IGN]
        self.usual = {each: signal.signal(each, self._note) for each in heard}
        return self

    def __exit__(self, kind: type[BaseException] | None, *failure: object) -> None:
        for each, usual in self.usual.items():
            signal.signal(each, usual)
        if self.came and kind is None:  # what failed meanwhile is to be told instead
            raise KeyboardInterrupt

    def _note(self, *_: object) -> None:
        self.came = True
        if self.idle:
            self.idle = False
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Around what may be cut short."""
        self.idle = True
        try:
            if self.came:
                raise KeyboardInterrupt
            yield
        finally:
            self.idle = False


def input_lines(interrupt: Interrupt) -> Iterator[list[str]]:
    """Lines of standard input as soon as they are whole, all that are there at once, until it ends
    or is interrupted; what stands behind the last newline comes last. Bytes that are not UTF-8
    become surrogates."""
    try:
        source: Any = sys.stdin.buffer  # a buffer that has `read1`
    except AttributeError:
        raise InputError(
            "standard input is closed; send telemetry there, or give the log as a file."
        ) from None
    row, rest = 1, b""
    while True:
        try:
            with interrupt.waiting():
                piece = source.read1(PIECE)
        except KeyboardInterrupt:
            return
        *lines, rest = (rest + piece).split(b"\n")
        lines = [line + b"\n" for line in lines] if piece else [rest]
        long = next((k for k, line in enumerate([*lines, rest]) if len(line) > LONGEST), None)
        yield [line.decode(errors="surrogateescape") for line in lines[:long] if line]
        if long is not None:
            raise InputError(
                f"standard input, row {row + long}: longer than {size_in_words(LONGEST)}, which no "
                "row is; send rows that end with a newline."
            )
        if not piece:
            return
        row += len(lines)


class Skipped:
    """Counts rows that are left out; says so at the first, and at the end."""

    count = 0

    def __call__(self, wrong: InputError) -> None:
        if not self.count:
            text = str(wrong).rstrip(".")
            options.warn([f"{text} (rows like this are left out, with --strict they end the call)"])
        self.count += 1

    def summary(self) -> None:
        if self.count:
            rows = "1 row was" if self.count == 1 else f"{self.count} rows were"
            options.warn([f"standard input: {rows} left out"])
