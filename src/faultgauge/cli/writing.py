"""Refusing, before any work, what could not be written afterwards."""

from pathlib import Path

from faultgauge.errors import InputError

__all__ = ["check_folder", "make_folder"]


def check_folder(*paths: Path | None) -> None:
    """Each path must stand in a folder that exists and must not be a folder itself."""
    for path in paths:
        if path is None:
            continue
        if path.is_dir():
            raise InputError(f"{path}: is a folder; give a file name in it.")
        if not path.absolute().parent.is_dir():
            raise InputError(f"{path}: the folder {path.parent} does not exist; create it first.")


def make_folder(path: Path) -> Path:
    """`path` as a folder, made where it is missing."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as failure:
        raise InputError(
            f"{path}: cannot be made a folder ({failure.strerror}); choose another name."
        ) from None
    return path
