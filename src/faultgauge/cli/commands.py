"""Where commands come from while something runs: standard input, or a file that is followed."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from threading import Thread

from faultgauge.cli.writing import check_folder

__all__ = ["follow_file", "follow_stdin"]

Poll = Callable[[], list[str]]


class _Lines:
    """Whole lines out of pieces of text."""

    def __init__(self) -> None:
        self.rest = b""

    def of(self, piece: bytes) -> list[str]:
        """The lines that are whole now; an unfinished one waits."""
        *lines, self.rest = (self.rest + piece).split(b"\n")
        return [line.decode(errors="replace") for line in lines]

    def last(self) -> list[str]:
        """The unfinished line, where nothing more will come."""
        return self.of(b"\n") if self.rest else []


def follow_file(path: Path) -> Poll:
    """What is appended to `path`, and what is in it already; it may come into being later, and
    begins anew where it was cut short."""
    check_folder(path)
    lines, read = _Lines(), 0

    def poll() -> list[str]:
        nonlocal lines, read
        try:
            size = path.stat().st_size
        except FileNotFoundError:
            return []
        if size < read:
            lines, read = _Lines(), 0
        if size == read:
            return []
        with open(path, "rb") as file:
            file.seek(read)
            piece = file.read()
        read += len(piece)
        return lines.of(piece)

    return poll


def follow_stdin() -> Poll:
    """Lines of standard input as they come; none where there is no standard input."""
    try:
        source = sys.stdin.fileno()
    except (AttributeError, OSError, ValueError):
        return list
    found: SimpleQueue[str] = SimpleQueue()

    def read() -> None:
        lines = _Lines()
        while piece := _read(source):
            for line in lines.of(piece):
                found.put(line)
        for line in lines.last():
            found.put(line)

    # a thread, because not every system can wait for a pipe and a clock at once
    Thread(target=read, daemon=True).start()
    return lambda: [found.get() for _ in range(found.qsize())]


def _read(source: int) -> bytes:
    """Raw, as a buffer's lock held by a daemon would hinder Python's exit."""
    try:
        return os.read(source, 65536)
    except OSError:
        return b""
