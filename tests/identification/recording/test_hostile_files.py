"""Bags and workbooks that say other sizes than they have, or would inflate to gigabytes: refused at once, by a message."""

from __future__ import annotations

import sqlite3
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from truepose.errors import InputError
from truepose.identification.leaves.bags.mcap_records import MAGIC, check_mcap
from truepose.identification.leaves.bags.settled import Stream, stretches
from truepose.identification.leaves.importing.importing import read_foreign
from truepose.identification.leaves.workbooks.spreadsheet import read_spreadsheet

FOOTER = struct.pack("<BQQQI", 2, 20, 0, 0, 0)


def record(code: int, data: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", code, len(data) if length is None else length) + data


def chunk(data: bytes, inflated: int, compression: bytes = b"") -> bytes:
    head = struct.pack("<QQQII", 0, 1, inflated, 0, len(compression))
    return record(6, head + compression + struct.pack("<Q", len(data)) + data)


def index(
    at: int, data: bytes, inflated: int, times: tuple[int, int] = (0, 1), compression: bytes = b""
) -> bytes:
    return record(
        8,
        struct.pack("<QQQQI", *times, at, 0, 0)
        + struct.pack("<QI", 0, len(compression))
        + compression
        + struct.pack("<QQ", len(data), inflated),
    )


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (record(5, b"", 1 << 63), "says it has 9223372036854775808 bytes"),
        (chunk(b"abc", 1 << 40), "inflates to 1099511627776 bytes"),
        (chunk(b"abc", 5), "says it inflates to 5"),
        (chunk(b"abc", 3) + index(8, b"abc", 3) * 2, "one for each chunk"),
        (chunk(b"abc", 3) + index(8, b"abc", 4), "with its compression and sizes"),
        (record(8, bytes(20)), "that is cut off"),
        (record(5, bytes(9), 10_000), "no more than the"),
    ],
)
def test_an_mcap_file_is_held_against_what_it_says(tmp_path: Path, body: bytes, told: str) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(MAGIC + body + FOOTER + MAGIC)
    with pytest.raises(InputError, match=told):
        check_mcap(path)


def test_a_whole_file_and_chunk_pass_and_one_without_footer_does_not(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(MAGIC + chunk(b"abc", 3) + index(8, b"abc", 3) + FOOTER + MAGIC)
    check_mcap(path)
    path.write_bytes(MAGIC + chunk(b"abc", 3))
    with pytest.raises(InputError, match="no footer"):
        check_mcap(path)


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_compressed_chunks_are_inflated_no_further_than_they_say(tmp_path: Path, compression: str) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2.storage_mcap import zstd  # type: ignore[attr-defined]

    lz4 = pytest.importorskip("lz4.frame")
    whole = {"lz4": lz4.compress, "zstd": zstd.compress}[compression](bytes(1 << 20))
    path = tmp_path / "a.mcap"
    for said, data, told in (
        (1 << 20, whole, ""),
        (1000, whole, "more than 1000"),
        (1 << 20, whole[:-20], "broken data"),
    ):
        path.write_bytes(MAGIC + chunk(data, said, compression.encode()) + FOOTER + MAGIC)
        if told:
            with pytest.raises(InputError, match=told):
                check_mcap(path)
        else:
            check_mcap(path)


@pytest.mark.parametrize(
    ("times", "refused"),
    [
        (((0, 10), (10, 10), (10, 20)), True),  # all three hold what was said at 10
        (((0, 10), (5, 11), (11, 20)), False),
        (((0, 9), (2, 8), (3, 4)), True),
    ],
)
def test_chunks_of_one_time_are_few(
    tmp_path: Path, times: tuple[tuple[int, int], ...], refused: bool
) -> None:
    """Who reads messages in the order of time holds every chunk of a time at once."""
    lz4 = pytest.importorskip("lz4.frame")
    inflated = 200 << 20
    data, path, body, at = lz4.compress(bytes(inflated)), tmp_path / "a.mcap", b"", []
    for _ in times:
        at.append(len(MAGIC) + len(body))
        body += chunk(data, inflated, b"lz4")
    for place, time in zip(at, times, strict=True):
        body += index(place, data, inflated, time, b"lz4")
    attached = record(9, bytes(8 << 20))  # else so few bytes may not become so many at all
    path.write_bytes(MAGIC + body + attached + FOOTER + MAGIC)
    if refused:
        with pytest.raises(InputError, match="chunks whose times overlap, expected at most 512 MiB of them"):
            check_mcap(path)
    else:
        check_mcap(path)


def test_a_bag_of_views_and_one_of_references_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    with sqlite3.connect(tmp_path / "a.db3") as base:
        base.execute("CREATE TABLE topics(id)")
        base.execute("CREATE VIEW messages AS SELECT * FROM topics")
    base.close()
    with pytest.raises(InputError, match="the view 'messages'"):
        read_foreign(tmp_path / "a.db3", "bag")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag/metadata.yaml").write_text("a: &a [1]\nb: [*a, *a]\n")
    with pytest.raises(InputError, match=r"a reference \(\*name\)"):
        read_foreign(tmp_path / "bag", "bag")


def test_stretches_of_many_samples_at_once_are_those_of_their_spread() -> None:
    rng = np.random.default_rng(1)
    time, values = np.sort(rng.uniform(0.0, 30.0, 3000)), np.cumsum(rng.normal(0.0, 1.0, 3000))
    found = stretches({"a": Stream.in_order(time, values[:, None])}, band=20.0, seconds=0.5)
    assert found
    still = [np.ptp(values[np.abs(time - t) <= 0.25]) <= 20.0 for t in time]
    inside = np.array([any(a <= t <= b for a, b in found) for t in time])
    assert not (inside & ~np.array(still)).any()


def workbook(path: Path, sheet: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book:
        book.writestr("xl/worksheets/sheet1.xml", sheet)
    return path


@pytest.mark.parametrize(
    ("sheet", "told"),
    [
        (b"<c>" + bytes(101 << 20), "inflates to more than 100 MiB"),
        (b'<row><c r="A1"/><c r="XFD1048576"/></row>', "row 1048576 and column 16384"),
        (b'<row><c/></row><row r="1048576">' + b"<c/>" * 10 + b"</row>", "row 1048576"),
    ],
)
def test_a_workbook_of_gigabytes_is_refused(tmp_path: Path, sheet: bytes, told: str) -> None:
    pytest.importorskip("python_calamine")
    with pytest.raises(InputError, match=told):
        read_spreadsheet(workbook(tmp_path / "a.xlsx", sheet))


def test_a_workbook_that_says_it_is_small_is_measured(tmp_path: Path) -> None:
    pytest.importorskip("python_calamine")
    path = workbook(tmp_path / "a.xlsx", b"<c>" + bytes(101 << 20))
    data = bytearray(path.read_bytes())
    at = data.rindex(b"PK\x01\x02")
    data[at + 24 : at + 28] = struct.pack("<I", 10)
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match="more than 100 MiB"):
        read_spreadsheet(path)
    path.write_bytes(bytes(data[: at // 2]))
    with pytest.raises(InputError, match="no Excel workbook"):
        read_spreadsheet(path)


@pytest.mark.parametrize("compressed", [False, True])
def test_the_files_of_a_folder_are_looked_at_too(tmp_path: Path, compressed: bool) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2.storage_mcap import zstd  # type: ignore[attr-defined]

    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 5}\n")
    if compressed:  # to more than 32 MiB, and more than a hundred times as much
        (bag / "a.mcap.zstd").write_bytes(zstd.compress(bytes(40 << 20)))
        told = r"a\.mcap\.zstd: cannot read the bag: found that it inflates to more than 33554432 bytes"
    else:
        (bag / "a.mcap").write_bytes(MAGIC + record(5, b"", 1 << 63) + FOOTER + MAGIC)
        told = r"a\.mcap: cannot read the bag: found a record at byte 8 that says it has 9223372036854775808"
    with pytest.raises(InputError, match=told):
        read_foreign(bag, "bag")


def test_what_is_compressed_well_enough_is_no_bomb(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2.storage_mcap import zstd  # type: ignore[attr-defined]

    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 5}\n")
    noise = np.random.default_rng(1).bytes(40 << 20)
    (tmp_path / "a.mcap.zstd").write_bytes(zstd.compress(noise))
    with pytest.raises(InputError) as caught:  # of other things: it is no bag
        read_foreign(tmp_path, "bag")
    assert "inflates" not in str(caught.value)
