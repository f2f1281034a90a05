"""The records of an MCAP file as they follow each other: lengths and chunks are checked before anything is read of them.

A record says how long it is, a chunk how much it inflates to, and an index where chunks are: all of that is only what a file
says. Here it is held against the file, so that a reader that believes it takes no more memory and time than the file is worth.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from truepose.errors import InputError
from truepose.identification.leaves.bags.inflated import inflated_size

MAGIC: Final = b"\x89MCAP0\r\n"
CHUNK_MOST: Final = 1 << 28
"""Bytes that a chunk may inflate to: 256 MiB, where recorders write chunks of 1 to 4."""
AT_ONCE_MOST: Final = 1 << 29
"""Bytes of the chunks whose times overlap, which are read together: 512 MiB."""
INFLATED_LEAST: Final = 1 << 25
"""Bytes that all chunks together may inflate to whatever the file's size is: 32 MiB."""
INFLATED_TIMES: Final = 100
"""How many times the file's size its chunks may inflate to beyond that; logs of joints and poses get 2 to 10 times smaller."""
DEFINITIONS_MOST: Final = 1 << 21
"""Bytes of the definitions of all topics' messages: 2 MiB, where a large robot's 300 topics have half of that."""
_SCHEMA, _CHANNEL, _CHUNK, _INDEX = 0x03, 0x04, 0x06, 0x08
_FOOTER: Final = struct.Struct("<BQQQI")
_CHUNK_HEAD: Final = struct.Struct("<QQQII")


class _Chunk(NamedTuple):
    """How a chunk is compressed, and its sizes as it says them."""

    compression: bytes
    compressed: int
    inflated: int


@dataclass
class _Seen:
    """What was seen of a file so far: chunks by where they stand, their spans of time as indexed; the largest definition of
    each number, and which number each topic has."""

    chunks: dict[int, _Chunk] = field(default_factory=dict)
    indexed: dict[int, tuple[int, int]] = field(default_factory=dict)
    definitions: dict[bytes, int] = field(default_factory=dict)
    topics: dict[bytes, bytes] = field(default_factory=dict)


def check_mcap(path: Path) -> None:
    """Raise InputError for a file whose records, chunks and index do not hold together, or that inflates beyond the limits."""
    with path.open("rb") as stream:
        size = stream.seek(0, 2)
        summary, seen, reached = _summary_start(stream, size, path), _Seen(), False
        at = len(MAGIC)
        while at < size - len(MAGIC):
            reached = reached or at == summary
            at = _record(stream, at, size - len(MAGIC), seen, path)
    if summary and not reached:
        raise _wrong(path, f"a summary that begins at byte {summary}", "it where a record begins")
    _check_sizes(seen, size, path)


def _summary_start(stream: BinaryIO, size: int, path: Path) -> int:
    """Where the footer says that the summary is."""
    stream.seek(max(size - len(MAGIC) - _FOOTER.size, 0))
    end = stream.read()
    if len(end) < len(MAGIC) + _FOOTER.size or not end.endswith(MAGIC) or end[:9] != b"\x02\x14" + bytes(7):
        raise _wrong(
            path,
            "no footer at its end",
            "a whole MCAP file (a recording that was cut off can be mended: mcap recover)",
        )
    return int(_FOOTER.unpack(end[: _FOOTER.size])[2])


def _record(stream: BinaryIO, at: int, end: int, seen: _Seen, path: Path) -> int:
    """Look at the record at a byte; where the next one is."""
    stream.seek(at)
    head = stream.read(9)
    length = int.from_bytes(head[1:], "little")
    if len(head) < 9 or length > end - at - 9:
        found = f"a record at byte {at} that says it has {length} bytes"
        raise _wrong(path, found, f"no more than the {max(end - at - 9, 0)} that are left of the file")
    if head[0] == _CHUNK:
        seen.chunks[at] = _chunk(stream, at, length, path)
    elif head[0] == _INDEX:
        _index(stream.read(length), at, seen, path)
    elif head[0] == _SCHEMA:
        number = stream.read(2)
        seen.definitions[number] = max(length, seen.definitions.get(number, 0))
    elif head[0] == _CHANNEL:
        seen.topics[stream.read(2)] = stream.read(2)
    return at + 9 + length


def _chunk(stream: BinaryIO, at: int, length: int, path: Path) -> _Chunk:
    """A chunk, whose data is inflated once to see that it is as large as it says."""
    try:
        *_, inflated, _, named = _CHUNK_HEAD.unpack(stream.read(min(_CHUNK_HEAD.size, length)))
        compression = stream.read(min(named, length))
        (compressed,) = struct.unpack("<Q", stream.read(8))
    except struct.error:
        raise _wrong(path, f"a chunk at byte {at} of {length} bytes", "its sizes in it") from None
    if _CHUNK_HEAD.size + named + 8 + compressed > length:
        found = f"a chunk at byte {at} that says it holds {compressed} bytes"
        raise _wrong(path, found, f"no more than the {length} of its record")
    if inflated > CHUNK_MOST:
        found = f"a chunk at byte {at} that says it inflates to {inflated} bytes"
        raise _wrong(path, found, f"at most {CHUNK_MOST >> 20} MiB")
    if compression:
        real = inflated_size(stream, compressed, compression.decode("latin-1"), inflated)
        if real != inflated:
            told = (
                "broken data"
                if real < 0
                else f"{'more than ' * (real > inflated)}{min(real, inflated)} bytes"
            )
            raise _wrong(
                path, f"a chunk at byte {at} of {told}", f"the {inflated} bytes that it says it inflates to"
            )
    elif compressed != inflated:
        found = f"a chunk at byte {at} of {compressed} bytes that says it inflates to {inflated}"
        raise _wrong(path, found, "the same, as it is not compressed")
    return _Chunk(compression, compressed, inflated)


def _index(data: bytes, at: int, seen: _Seen, path: Path) -> None:
    """An entry of the index, held against the chunk that it tells of."""
    try:
        start, end, where, _, others = struct.unpack_from("<QQQQI", data)
        (named,) = struct.unpack_from("<I", data, 44 + others)
        compression = data[48 + others : 48 + others + named]
        sizes = struct.unpack_from("<QQ", data, 48 + others + named)
    except struct.error:
        raise _wrong(path, f"an index of a chunk at byte {at} that is cut off", "a whole one") from None
    if seen.chunks.get(where) != _Chunk(compression, *sizes) or where in seen.indexed:
        found = f"an index at byte {at} of a chunk at byte {where}"
        raise _wrong(path, found, "one for each chunk of the file, with its compression and sizes")
    seen.indexed[where] = (start, end)


def _check_sizes(seen: _Seen, size: int, path: Path) -> None:
    """What all chunks inflate to, those that are read together, and the definitions."""
    total = sum(chunk.inflated for chunk in seen.chunks.values())
    if total > max(INFLATED_LEAST, INFLATED_TIMES * size):
        found = f"chunks that inflate to {total} bytes in a file of {size}"
        raise _wrong(path, found, f"at most {INFLATED_TIMES} times its size")
    if _largest_at_once(seen.indexed, seen.chunks) > AT_ONCE_MOST:
        raise _wrong(
            path, "chunks whose times overlap", f"at most {AT_ONCE_MOST >> 20} MiB of them at any time"
        )
    told = sum(seen.definitions.get(number, 0) for number in seen.topics.values())
    if told > DEFINITIONS_MOST:
        found = f"definitions of messages of {told} bytes for {len(seen.topics)} topics"
        raise _wrong(path, found, f"at most {DEFINITIONS_MOST >> 20} MiB")


def _largest_at_once(spans: Mapping[int, tuple[int, int]], chunks: Mapping[int, _Chunk]) -> int:
    """The most bytes of chunks that one moment is in."""
    events = [(start, 0, chunks[at].inflated) for at, (start, _) in spans.items()]
    events += [(end, 1, -chunks[at].inflated) for at, (_, end) in spans.items()]
    now = most = 0
    for *_, change in sorted(events):
        now += change
        most = max(most, now)
    return most


def _wrong(path: Path, found: str, expected: str) -> InputError:
    return InputError(f"{path}: cannot read the bag: found {found}, expected {expected}")
