"""The cache of compiled programs: what JAX cannot read is made anew, once, in one sentence."""

import contextlib
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from faultgauge.cli import options

__all__ = ["renew_when_damaged"]

UNREADABLE = "Error reading persistent compilation cache"
UNWRITABLE = "Error writing persistent compilation cache"


def renew_when_damaged() -> None:
    """From here on what JAX warns of its cache is answered so; other warnings are shown as ever."""
    warnings.showwarning = _hear(warnings.showwarning)


def _hear(usual: Callable[..., None]) -> Callable[..., None]:
    told: set[str] = set()

    def show(message: Warning | str, *where: Any, **more: Any) -> None:
        text = str(message)
        kind = next((each for each in (UNREADABLE, UNWRITABLE) if text.startswith(each)), None)
        if kind is None:
            usual(message, *where, **more)
        elif not told:
            told.add(kind)
            _renew(kind, Path(os.environ["JAX_COMPILATION_CACHE_DIR"]))

    return show


def _renew(kind: str, folder: Path) -> None:
    if kind == UNREADABLE and folder.is_dir():
        for entry in folder.glob("*-cache"):
            with contextlib.suppress(OSError):  # gone by now, or not ours to remove
                entry.unlink()
        options.say(f"note: the compiled programs in {folder} were damaged and are made anew.")
    else:
        options.say(
            f"note: compiled programs cannot be kept in {folder}, so they are made anew every time."
        )
