"""Recordings of ROS 2: a folder with `metadata.yaml`, or one of its files."""

import re
from pathlib import Path

from faultgauge.errors import InputError
from faultgauge.telemetry.readers.compression import plain_file
from faultgauge.telemetry.readers.db3 import add_db3
from faultgauge.telemetry.readers.foreign import reading
from faultgauge.telemetry.readers.mcap import add_mcap
from faultgauge.telemetry.readers.topics import Topics
from faultgauge.telemetry.table import LogTable

__all__ = ["BAG_FILES", "read_bag"]

STORAGES = {".mcap": ("MCAP", add_mcap), ".db3": ("SQLite", add_db3)}
BAG_FILES = tuple(f"{storage}{packed}" for storage in STORAGES for packed in ("", ".zstd"))
# An item of `relative_file_paths`, which lists the files in the order of their recording. ROS
# writes one to a line, so that no parser of YAML is needed. Old versions put the folder before.
LISTED = re.compile(r"""^\s*-\s+["']?(?:.*/)?(.+\.(?:mcap|db3)(?:\.zstd)?)["']?\s*$""", re.M)


def read_bag(path: Path) -> LogTable:
    """Read a `.mcap` or `.db3` file, either also as `.zstd`, or a folder of them as one table.

    `Topics` tells columns and time. Raises `InputError` for a file that is damaged or missing,
    a folder that is no bag, a bag without a message that can be read, and where the extra `io` is
    missing.
    """
    topics = Topics()
    for part in _parts(path) if path.is_dir() else [path]:
        kind, add = STORAGES[Path(part.name.lower().removesuffix(".zstd")).suffix]
        with reading(part, kind), plain_file(part) as file:
            add(file, topics)
    return topics.table(path)


def _parts(folder: Path) -> list[Path]:
    listing = folder / "metadata.yaml"
    if not listing.is_file():
        raise InputError(
            f"{folder} is a folder without a log that can be read, and no ROS 2 bag, as it has no "
            "metadata.yaml; give log files, or a folder that holds some."
        )
    names = LISTED.findall(listing.read_text(encoding="utf-8", errors="replace"))
    if not names:
        raise InputError(
            f"{listing} names no .mcap or .db3 file; write it anew with `ros2 bag reindex`, or "
            "name the log files."
        )
    for name in names:
        if not (folder / name).is_file():
            raise InputError(
                f"{folder / name} does not exist, though metadata.yaml beside it names it; copy "
                "the whole bag."
            )
    return [folder / name for name in names]
