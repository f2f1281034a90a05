"""A bag of ROS 2 said again as one of ROS 1."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

CHUNK = 1 << 12
"""Bytes of a chunk, so that a small bag has several."""


def as_ros1(bag: Path, path: Path, compression: str = "none") -> Path:
    """The messages of ``bag`` in a file of ROS 1, with chunks as they are or compressed by ``lz4`` or ``bz2``."""
    from rosbags.highlevel import AnyReader
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    old, new = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(path)
    writer.chunk_threshold = CHUNK
    if compression != "none":
        writer.set_compression(Writer.CompressionFormat[compression.upper()])
    with AnyReader([bag], default_typestore=new) as reader, writer:
        topics: dict[str, Any] = {}
        for connection, time, data in reader.messages():
            kind = connection.msgtype
            if connection.topic not in topics:
                topics[connection.topic] = writer.add_connection(connection.topic, kind, typestore=old)
            message = _again(new.deserialize_cdr(data, kind), old.types)
            writer.write(topics[connection.topic], time, old.serialize_ros1(message, kind))
    return path


def _again(message: Any, types: Any) -> Any:
    """The same message in the types of ROS 1, whose headers count."""
    if isinstance(message, list):
        return [_again(one, types) for one in message]
    name = getattr(message, "__msgtype__", None)
    if name is None:
        return message
    kind = types[name]
    names = [field.name for field in fields(kind) if field.init]
    return kind(*(0 if name == "seq" else _again(getattr(message, name), types) for name in names))
