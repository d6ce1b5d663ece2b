"""MCAP files (`.mcap`), by mcap and mcap-ros2-support."""

import json
from pathlib import Path
from typing import Any

from faultgauge.telemetry.readers.compression import plain_bytes
from faultgauge.telemetry.readers.foreign import package
from faultgauge.telemetry.readers.topics import Topics

__all__ = ["add_mcap"]


def add_mcap(path: Path, topics: Topics) -> None:
    """Add the ROS 2 (CDR) and JSON messages of an MCAP file to `topics`."""
    reader = package("mcap.reader", path)
    factory = package("mcap_ros2.decoder", path).DecoderFactory()
    decoders: dict[int, Any] = {}
    with path.open("rb") as file:
        messages = reader.make_reader(file, validate_crcs=True).iter_messages()
        for schema, channel, message in messages:
            if channel.id not in decoders:
                decoders[channel.id] = _decoder(factory, channel.message_encoding, schema)
            decode = decoders[channel.id]
            if decode is None:
                topics.left_out[channel.topic] = _what(channel.message_encoding, schema)
            else:
                topics.add(channel.topic, message.log_time, decode(plain_bytes(path, message.data)))


def _decoder(factory: Any, encoding: str, schema: Any) -> Any:
    return json.loads if encoding == "json" else factory.decoder_for(encoding, schema)


def _what(encoding: str, schema: Any) -> str:
    if encoding != "cdr" or schema is None:
        return encoding
    return f"{schema.name} in {schema.encoding}"
