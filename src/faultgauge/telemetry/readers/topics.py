"""Messages by topic, as robots record them, become one table."""

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
from faultgauge.telemetry.readers.join import Channel, join
from faultgauge.telemetry.table import LogTable

__all__ = ["Topics"]

NANO = 1_000_000_000  # ns in a second
ONE_CLOCK = 10 * NANO  # ns between a header's stamp and the log time, if both tell the same time
ADVICE = (
    "record or convert them as JSON or as ROS 2 messages (CDR) with their definitions, which "
    "`ros2 bag convert` to MCAP adds, or export them as CSV"
)
SECONDS, NANOSECONDS = ("sec", "secs"), ("nanosec", "nsec", "nsecs")  # ROS 2, JSON, ROS 1


@dataclass
class _Topic:
    """The messages of one topic: log times and header stamps in ns, values by message number."""

    logged: list[int] = field(default_factory=list)
    stamped: list[int] = field(default_factory=list)
    values: dict[str, dict[int, Any]] = field(default_factory=lambda: defaultdict(dict))
    left_out: set[str] = field(default_factory=set)


class Topics:
    """The messages of one recording.

    A number or text of a message is a column `topic.field.part`, the topic without its first `/`;
    an element of an array is `name_0`, `name_1`, ... The time `t` is in seconds since the first
    message: a message's own `header.stamp` where all of its topic have one within 10 s of the log
    time, else the log time. Topics are joined on time.
    """

    def __init__(self) -> None:
        self.assumed: set[str] = set()  # types whose definition is not in the recording
        self.left_out: dict[str, str] = {}  # what is not known of the messages of a topic
        self._topics: dict[str, _Topic] = defaultdict(_Topic)

    def add(self, topic: str, log_time: int, message: Any) -> None:
        """Take in a decoded message that was logged at `log_time`, ns."""
        _add(self._topics[topic], log_time, message)

    def table(self, path: Path) -> LogTable:
        """All messages as the table of `path`. Raises `InputError` where none could be decoded."""
        left_out = ", ".join(f"{topic} ({what})" for topic, what in self.left_out.items())
        if not self._topics:
            only = f", only {left_out}" if left_out else ""
            raise InputError(f"{path} holds no messages that can be read{only}; {ADVICE}.")
        notes = [f"{path}: not read, and left out: {left_out}; {ADVICE}."] if left_out else []
        if self.assumed:
            notes.append(
                f"{path} does not define {', '.join(sorted(self.assumed))}: taken as ROS 2 does."
            )
        return join(path, list(_channels(path, self._topics, notes)), notes)


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
