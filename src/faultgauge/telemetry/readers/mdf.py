"""ASAM measurement data: MDF 3 (`.mdf`) and MDF 4 (`.mf4`), by asammdf."""

import gc
import io
import logging
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from faultgauge.errors import InputError
from faultgauge.telemetry.readers.foreign import package, reading
from faultgauge.telemetry.readers.join import Channel, join
from faultgauge.telemetry.readers.unpacked import Room, inflate
from faultgauge.telemetry.table import LogTable

__all__ = ["read_mdf"]

CELL = 8  # bytes of a number in memory
ZLIB = b"\x78"
TIME = 1  # synchronisation type of a master channel: time, and not angle, distance or index


def read_mdf(path: Path) -> LogTable:
    """Read the channels of an MDF file in physical values, with their units.

    The master channels are the time `t`, in seconds since the measurement began. Channel groups
    of different rates are joined on time. A name that several groups use, or that is `t`, gets
    its group's number: `speed.0`, `speed.1`. Samples marked invalid are empty cells. Groups
    without a time are left out. Raises `InputError` for a file that is damaged, unpacks to too
    much or holds no channel, and where the extra `io` is missing.
    """
    asammdf = package("asammdf", path)
    with reading(path, "MDF"), _quiet():
        signals = _signals(asammdf, path)
        timed = [signal for signal in signals if _is_timed(signal)]
        names = Counter(signal.name for signal in timed)
        channels = [_channel(signal, names) for signal in timed]
    if not channels:
        raise InputError(f"{path} holds no channel with a time; export the log again with one.")
    other = [signal.name for signal in signals if not _is_timed(signal)]
    notes = [f"{path}: without a time, and left out: {', '.join(other)}."] if other else []
    return join(path, channels, notes)


def _signals(asammdf: Any, path: Path) -> list[Any]:
    """All channels; read in memory, because a file that was never finalised is written to."""
    content = path.read_bytes()
    if not content.startswith((b"MDF", b"UnFinMF")):
        raise ValueError("it does not begin like one")
    try:
        with asammdf.MDF(io.BytesIO(content)) as file:
            _check_size(file, content, Room(path))
            return list(file.iter_channels(copy_master=False))
    except InputError:
        raise
    except Exception as failure:  # noqa: BLE001  (raised again below)
        said = str(failure)
    gc.collect()  # half-made objects complain when they go: here, where nobody hears it
    raise ValueError(said)


def _check_size(file: Any, content: bytes, room: Room) -> None:
    """Refuse a file whose channels or blocks of data, which may be packed, hold too much."""
    for group in file.groups:
        room.take(CELL * int(group.channel_group.cycles_nr) * len(group.channels))
        blocks = [*group.get_data_blocks()]
        for k, data in enumerate(group.signal_data or []):
            blocks += group.get_signal_data_blocks(k) if data else []
        for each in blocks:
            packed = content[each.address : each.address + (each.compressed_size or 0)]
            if each.block_type and packed.startswith(ZLIB):
                inflate(packed, room)
            else:
                room.take(each.original_size or 0)


@contextmanager
def _quiet() -> Iterator[None]:
    """Without what asammdf writes to stderr over a damaged file, beside raising it."""
    logger, hook = logging.getLogger("asammdf"), sys.unraisablehook
    before, logger.disabled = logger.disabled, True
    sys.unraisablehook = lambda unraisable: None
    try:
        yield
    finally:
        logger.disabled, sys.unraisablehook = before, hook


def _is_timed(signal: Any) -> bool:
    return signal.master_metadata is not None and signal.master_metadata[1] == TIME


def _channel(signal: Any, names: Counter[str]) -> Channel:
    name = signal.name
    if names[name] > 1 or name == "t":
        name = f"{name}.{signal.group_index}"
    values = np.asarray(signal.samples)
    invalid = signal.invalidation_bits
    if invalid is not None and values.dtype.kind in "biuf":
        values = values.astype(np.float64)
        values[np.asarray(invalid, dtype=bool)] = np.nan
    return Channel(name, np.asarray(signal.timestamps, np.float64), values, signal.unit or "")
