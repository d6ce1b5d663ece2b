"""Zstandard, by which ROS 2 compresses its bags: whole files or single messages."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from faultgauge.errors import InputError
from faultgauge.files import size_in_words, take
from faultgauge.telemetry.readers.foreign import package

__all__ = ["plain_bytes", "plain_file"]

MOST, MOST_MESSAGE = 20_000_000_000, 1_000_000_000  # bytes, unpacked
MAGIC = b"\x28\xb5\x2f\xfd"  # neither JSON nor CDR begins so


@contextmanager
def plain_file(path: Path) -> Iterator[Path]:
    """`path`, or while the context lasts a decompressed copy of it, if it is a `.zstd`."""
    if path.suffix.lower() != ".zstd":
        yield path
        return
    with TemporaryDirectory() as folder:
        plain = Path(folder) / path.stem
        with path.open("rb") as packed, plain.open("wb") as file:
            left = MOST
            for piece in _decompressor(path).read_to_iter(packed):
                left -= len(piece)
                if left < 0:
                    raise InputError(
                        f"{path}: holds more than {size_in_words(MOST)} when it is unpacked, more "
                        "than is read; record to several files."
                    )
                file.write(piece)
        yield plain


def plain_bytes(path: Path, data: bytes) -> bytes:
    """A message of the file `path`, decompressed if need be."""
    if not data.startswith(MAGIC):
        return data
    with _decompressor(path).stream_reader(data) as unpacked:
        return take(
            unpacked.read, MOST_MESSAGE, path, "in one compressed message, more than is read"
        )


def _decompressor(path: Path) -> Any:
    return package("zstandard", path).ZstdDecompressor()
