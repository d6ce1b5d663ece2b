"""Zstandard, by which ROS 2 compresses its bags: whole files or single messages."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from faultgauge.telemetry.readers.foreign import package

__all__ = ["plain_bytes", "plain_file"]

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
            _decompressor(path).copy_stream(packed, file)
        yield plain


def plain_bytes(path: Path, data: bytes) -> bytes:
    """A message of the file `path`, decompressed if need be."""
    if not data.startswith(MAGIC):
        return data
    return _decompressor(path).decompressobj().decompress(data)


def _decompressor(path: Path) -> Any:
    return package("zstandard", path).ZstdDecompressor()
