"""How much a file may unpack to: a small one may hold a thousand times as much."""

import zlib
from pathlib import Path

from faultgauge.errors import InputError
from faultgauge.files import size_in_words

__all__ = ["Room", "inflate"]

MOST = 4_000_000_000  # bytes of numbers and text in memory
PIECE = 1 << 24  # bytes that are unpacked at once


class Room:
    """What may still be unpacked of one file."""

    def __init__(self, path: Path) -> None:
        self.path, self.left = path, MOST

    def take(self, count: int) -> None:
        """Count so many bytes. Raises `InputError` where there is no room for them."""
        self.left -= count
        if self.left < 0:
            raise InputError(
                f"{self.path}: holds more than {size_in_words(MOST)} when it is unpacked, more "
                "than is read; give it in parts, or with fewer signals."
            )


def inflate(data: bytes, room: Room) -> None:
    """Take from `room` what `data` of zlib really unpack to, whatever they say."""
    engine = zlib.decompressobj()
    while data and not engine.eof:
        room.take(len(engine.decompress(data, PIECE)))
        data = engine.unconsumed_tail
