"""What readers that stand on another package have in common: how it is found and how it fails."""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any

from faultgauge.errors import InputError

__all__ = ["package", "reading"]

UNTOUCHED = (InputError, FileNotFoundError, PermissionError)  # they say already what is wrong


def package(name: str, path: Path) -> Any:
    """The module `name`, loaded only now. Raises `InputError` where the extra `io` is missing."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return import_module(name)
    except ImportError:
        raise InputError(
            f"{path}: reading {path.suffix} files needs an extra package: "
            "pip install faultgauge[io]."
        ) from None


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Whatever a package raises over a damaged or mislabelled file becomes one `InputError`.

    Its warnings are advice to programmers and are left out, like whatever it prints.
    """
    unheard = io.StringIO()
    try:
        with warnings.catch_warnings(), redirect_stdout(unheard), redirect_stderr(unheard):
            warnings.simplefilter("ignore")
            yield
    except UNTOUCHED:
        raise
    except Exception as failure:
        said = " ".join(str(failure).split())[:120].rstrip(".") or type(failure).__name__
        raise InputError(
            f"{path} is no {kind} file, or it is damaged ({said}); copy or export it again."
        ) from failure
