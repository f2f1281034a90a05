"""Bags of every storage, looked at before they are read: how large their parts say they are, and what is no recording."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any, Final

import yaml

from truepose.errors import InputError
from truepose.identification.leaves.bags.inflated import inflated_size
from truepose.identification.leaves.bags.mcap_records import (
    CHUNK_MOST,
    INFLATED_LEAST,
    INFLATED_TIMES,
    MAGIC,
    check_mcap,
)

METADATA_MOST: Final = 1 << 20
"""Bytes of a bag folder's metadata.yaml: 1 MiB."""
FILES_MOST: Final = 1000
"""Files of a bag in a folder."""
_SQLITE, _ROS1 = b"SQLite format 3\0", b"#ROSBAG V2.0\n"
_COMPRESSED: Final = ".zstd"


def check_bag(path: Path) -> None:
    """Raise InputError for a bag, a file or a folder, that inflates beyond the limits, or whose parts do not hold together."""
    if path.is_dir():
        _check_folder(path)
        return
    with path.open("rb") as stream:
        start = stream.read(16)
    if start.startswith(MAGIC):
        check_mcap(path)
    elif start.startswith(_SQLITE):
        _check_sqlite(path)
    elif start.startswith(_ROS1):
        _check_ros1(path)


def _check_folder(path: Path) -> None:
    """The files of a folder's metadata.yaml, which must be plain: YAML's references may unfold to gigabytes."""
    metadata = path / "metadata.yaml"
    if metadata.stat().st_size > METADATA_MOST:
        raise _wrong(metadata, f"{metadata.stat().st_size} bytes", f"at most {METADATA_MOST >> 20} MiB")
    try:
        text = metadata.read_text(encoding="utf-8")
        if any(isinstance(event, yaml.events.AliasEvent) for event in yaml.parse(text)):
            raise _wrong(metadata, "a reference (*name)", "values as they are")
    except (yaml.YAMLError, ValueError) as exc:
        raise InputError(f"{metadata}: cannot read the bag: no YAML: {str(exc).splitlines()[0]}") from None
    files = [one for one in sorted(path.iterdir()) if one.suffix in (".mcap", ".db3", _COMPRESSED)]
    if len(files) > FILES_MOST:
        raise _wrong(path, f"{len(files)} files", f"at most {FILES_MOST}")
    for one in files:
        if one.suffix == _COMPRESSED:
            most = max(INFLATED_LEAST, INFLATED_TIMES * one.stat().st_size)
            with one.open("rb") as stream:
                if inflated_size(stream, one.stat().st_size, "zstd", most) > most:
                    raise _wrong(one, f"that it inflates to more than {most} bytes", "no more")
        else:
            check_bag(one)


def _check_sqlite(path: Path) -> None:
    """Views and computed columns make rows without end of nothing; recorders write neither."""
    try:
        with sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True) as base:
            odd = base.execute(
                "SELECT type, name FROM sqlite_master WHERE type NOT IN ('table', 'index')"
            ).fetchall()
            made = base.execute(
                "SELECT m.name, x.name FROM sqlite_master m, pragma_table_xinfo(m.name) x WHERE m.type = 'table' AND x.hidden"
            ).fetchall()
        base.close()
    except (sqlite3.Error, ValueError) as exc:
        raise InputError(f"{path}: cannot read the bag: {exc}") from None
    for what, name in (*odd, *(("computed column", f"{table}.{column}") for table, column in made)):
        raise _wrong(path, f"the {what} {str(name)[:80]!r}", "tables of messages and topics")


def _check_ros1(path: Path) -> None:
    """The chunks of a bag of ROS 1, one after the other."""
    with path.open("rb") as stream:
        size, total = stream.seek(0, 2), 0
        at = stream.seek(len(_ROS1))
        while at < size:
            fields, length, at = _ros1_record(stream, at, size, path)
            if fields.get(b"op") == b"\x05":
                total += _ros1_chunk(stream, fields, length, at, path)
            at += length
            stream.seek(at)
    if total > max(INFLATED_LEAST, INFLATED_TIMES * size):
        found = f"chunks that inflate to {total} bytes in a file of {size}"
        raise _wrong(path, found, f"at most {INFLATED_TIMES} times its size")


def _ros1_record(stream: Any, at: int, size: int, path: Path) -> tuple[dict[bytes, bytes], int, int]:
    """Fields of a record's header, the length of its data, and where that begins."""
    head = int.from_bytes(stream.read(4), "little")
    if head > size - at:
        raise _wrong(path, f"a record at byte {at} with a header of {head} bytes", f"at most {size - at}")
    header, fields, k = stream.read(head), dict[bytes, bytes](), 0
    while k + 4 <= len(header):
        length = int.from_bytes(header[k : k + 4], "little")
        name, _, value = header[k + 4 : k + 4 + length].partition(b"=")
        fields[name] = value
        k += 4 + length
    length, begin = int.from_bytes(stream.read(4), "little"), stream.tell()
    if length > size - begin:
        found = f"a record at byte {at} that says it has {length} bytes"
        raise _wrong(path, found, f"no more than the {size - begin} that are left of the file")
    return fields, length, begin


def _ros1_chunk(stream: Any, fields: dict[bytes, bytes], length: int, at: int, path: Path) -> int:
    """Bytes that a chunk inflates to, which must be what it says."""
    said = int.from_bytes(fields.get(b"size", b"")[:4], "little")
    compression = fields.get(b"compression", b"").decode("latin-1")
    real = (
        length if compression == "none" else inflated_size(stream, length, compression, min(said, CHUNK_MOST))
    )
    if real != said:
        found = f"a chunk at byte {at} that does not inflate to the {said} bytes that it says"
        raise _wrong(path, found, f"that, and at most {CHUNK_MOST >> 20} MiB")
    return said


def _wrong(path: Path, found: str, expected: str) -> InputError:
    return InputError(f"{path}: cannot read the bag: found {found}, expected {expected}")
