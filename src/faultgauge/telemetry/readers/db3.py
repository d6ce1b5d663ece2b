"""SQLite files in which ROS 2 records its bags (`.db3`), by sqlite3 and mcap-ros2-support."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from faultgauge.telemetry.readers.compression import plain_bytes
from faultgauge.telemetry.readers.foreign import package
from faultgauge.telemetry.readers.interfaces import definition
from faultgauge.telemetry.readers.topics import Topics

__all__ = ["add_db3"]

TOPICS = "SELECT id, name, type, serialization_format FROM topics"
MESSAGES = "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
HAS_DEFINITIONS = "SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'"
DEFINITIONS = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"


def add_db3(path: Path, topics: Topics) -> None:
    """Add the messages (CDR) of a `.db3` file to `topics`.

    From ROS 2 Iron on the file holds the definitions of its messages; in place of missing ones
    those of ROS 2's own messages are taken.
    """
    factory = package("mcap_ros2.decoder", path).DecoderFactory()
    schema = package("mcap.records", path).Schema
    # Immutable, SQLite writes nothing beside the file, but passes over a journal that is not
    # merged yet because the recorder was stopped.
    journal = path.with_name(f"{path.name}-wal").exists()
    address = f"{path.resolve().as_uri()}?mode=ro{'' if journal else '&immutable=1'}"
    with closing(sqlite3.connect(address, uri=True)) as bag:
        given = bag.execute(DEFINITIONS) if bag.execute(HAS_DEFINITIONS).fetchone() else ()
        definitions = {kind: (language, text) for kind, language, text in given}
        found: dict[int, tuple[str, str, Any]] = {}
        for number, name, kind, encoding in bag.execute(TOPICS):
            language, text = definitions.get(kind) or ("ros2msg", definition(kind))
            known = schema(id=number, name=kind, encoding=language, data=text.encode())
            decode = factory.decoder_for(encoding, known) if text else None
            if decode is not None and kind not in definitions:
                topics.assumed.add(kind)
            found[number] = (name, kind, decode)
        for number, log_time, data in bag.execute(MESSAGES):
            name, kind, decode = found[number]
            if decode is None:
                topics.left_out[name] = kind
            else:
                topics.add(name, log_time, decode(plain_bytes(path, data)))
