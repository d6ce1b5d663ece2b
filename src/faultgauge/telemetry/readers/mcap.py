"""MCAP files, as ROS 2 records its bags (`.mcap`), by mcap and mcap-ros2-support."""

import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from faultgauge.errors import InputError
from faultgauge.telemetry.readers.cells import MOST_COLUMNS
from faultgauge.telemetry.readers.foreign import package, reading
from faultgauge.telemetry.readers.join import Channel, join
from faultgauge.telemetry.table import Table

__all__ = ["read_mcap"]

NANO = 1_000_000_000
ONE_CLOCK = 10 * NANO  # ns between a header's stamp and the log time, if both tell the same time
SECONDS, NANOSECONDS = ("sec", "secs"), ("nanosec", "nsec", "nsecs")  # ROS 2, JSON, ROS 1


@dataclass
class _Topic:
    """The messages of one topic: log times and header stamps in ns, values by message number."""

    logged: list[int] = field(default_factory=list)
    stamped: list[int] = field(default_factory=list)
    values: dict[str, dict[int, Any]] = field(default_factory=lambda: defaultdict(dict))
    left_out: set[str] = field(default_factory=set)


def read_mcap(path: Path) -> Table:
    """Read the ROS 2 (CDR) and JSON messages of an MCAP file.

    A number or text of a message is a column `topic.field.part`, the topic without its first `/`;
    an element of an array is `name_0`, `name_1`, ... The time `t` is in seconds since the first
    message of the file: a message's own `header.stamp` where all of its topic have one within 10 s
    of the log time, else the log time. Topics are joined on time. Raises `InputError` for a file
    that is damaged or holds no such message, and where the extra `io` is missing.
    """
    reader = package("mcap.reader", path)
    factory = package("mcap_ros2.decoder", path).DecoderFactory()
    topics: dict[str, _Topic] = defaultdict(_Topic)
    unknown: dict[str, str] = {}
    with reading(path, "MCAP"), path.open("rb") as file:
        decoders = {}
        for schema, channel, message in reader.make_reader(
            file, validate_crcs=True
        ).iter_messages():
            if channel.id not in decoders:
                decoders[channel.id] = _decoder(factory, channel.message_encoding, schema)
            if decoders[channel.id] is None:
                unknown[channel.topic] = channel.message_encoding
                continue
            _add(topics[channel.topic], message.log_time, decoders[channel.id](message.data))
    skipped = ", ".join(f"{topic} ({encoding})" for topic, encoding in unknown.items())
    if not topics:
        raise InputError(
            f"{path} holds no message in ROS 2 (CDR) or JSON encoding"
            f"{f', only {skipped}' if skipped else ''}; record or convert it so."
        )
    notes = (
        [f"{path}: of an encoding that is not read, and left out: {skipped}."] if skipped else []
    )
    return join(path, list(_channels(path, topics, notes)), notes)


def _decoder(factory: Any, encoding: str, schema: Any) -> Any:
    return json.loads if encoding == "json" else factory.decoder_for(encoding, schema)


def _add(topic: _Topic, log_time: int, message: Any) -> None:
    number = len(topic.logged)
    topic.logged.append(log_time)
    fields = _fields(message)
    stamp = _fields(_fields(fields.pop("header", None)).get("stamp"))
    whole = next((stamp[name] for name in SECONDS if name in stamp), None)
    if whole is not None:
        fraction = next((stamp[name] for name in NANOSECONDS if name in stamp), 0)
        topic.stamped.append(whole * NANO + fraction)
    for name, value in _leaves("", fields):
        if value is None:
            topic.left_out.add(name)
        else:
            topic.values[name][number] = value


def _fields(value: Any) -> dict[str, Any]:
    """The fields of a message; none of a plain value."""
    if isinstance(value, SimpleNamespace):
        names = getattr(type(value), "__slots__", None) or vars(value)
        return {name: getattr(value, name) for name in names}
    return dict(value) if isinstance(value, dict) else {}


def _leaves(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Numbers and texts by name; None for an array too long to be a set of signals."""
    match value:
        case bool() | int() | float() | str():
            yield name, value
        case list() | tuple() if len(value) <= MOST_COLUMNS:
            for index, item in enumerate(value):
                yield from _leaves(f"{name}_{index}", item)
        case list() | tuple() | bytes():
            yield name, None
        case _:
            for key, item in _fields(value).items():
                yield from _leaves(f"{name}.{key}" if name else key, item)


def _channels(path: Path, topics: dict[str, _Topic], notes: list[str]) -> Iterator[Channel]:
    times = {name: _times(topic) for name, topic in topics.items()}
    first = min(int(stamps.min()) for stamps in times.values())
    for name, topic in topics.items():
        t, kept = _increasing(times[name], first)
        if len(t) < len(topic.logged):
            notes.append(
                f"{path}, topic {name}: {len(topic.logged) - len(t)} message(s) have the time of "
                "another; the last one counts."
            )
        if topic.left_out:
            notes.append(f"{path}, topic {name}: long arrays are left out: {_names(topic)}.")
        for part, values in topic.values.items():
            cells = _cells(values, len(topic.logged))[kept]
            yield Channel(".".join(filter(None, (name.lstrip("/"), part))), t, cells)


def _names(topic: _Topic) -> str:
    return ", ".join(sorted(topic.left_out))


def _times(topic: _Topic) -> Int[np.ndarray, "messages"]:
    logged = np.array(topic.logged, dtype=np.int64)
    if len(topic.stamped) == len(logged):
        stamped = np.array(topic.stamped, dtype=np.int64)
        if np.all(np.abs(stamped - logged) < ONE_CLOCK):
            return stamped
    return logged


def _increasing(
    stamps: Int[np.ndarray, "messages"], first: int
) -> tuple[Float[np.ndarray, "samples"], Int[np.ndarray, "samples"]]:
    """Times in s since `first`, sorted, and the messages that they belong to."""
    order = np.argsort(stamps, kind="stable")
    last = np.append(np.diff(stamps[order]) > 0, True)
    kept = order[last]
    return (stamps[kept] - first) / NANO, kept


def _cells(values: dict[int, Any], count: int) -> np.ndarray:
    if any(isinstance(value, str) for value in values.values()):
        return np.array([str(values.get(k, "")) for k in range(count)], dtype=object)
    return np.array([float(values.get(k, np.nan)) for k in range(count)])
