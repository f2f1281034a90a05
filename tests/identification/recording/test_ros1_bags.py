"""Bags of ROS 1: the same table as the messages have in ROS 2, and what says other sizes than it has is refused."""

from __future__ import annotations

import struct
from pathlib import Path

import pandas as pd
import pytest

from support.guide_bag import write_bag
from support.ros1_bag import as_ros1
from truepose.errors import InputError
from truepose.identification.leaves.importing.importing import read_foreign
from truepose.identification.recording.table import bag_table

pytest.importorskip("rosbags")
MAGIC = b"#ROSBAG V2.0\n"
COMPRESSIONS = ("none", "lz4", "bz2")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag"), poses=4)


@pytest.fixture(scope="module", params=COMPRESSIONS)
def older(request: pytest.FixtureRequest, bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return as_ros1(bag, tmp_path_factory.mktemp("ros1") / "run.bag", request.param)


def record(data: bytes, length: int | None = None, **fields: bytes) -> bytes:
    """A record of a bag that may say another ``length`` than its data has."""
    header = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value
        for name, value in fields.items()
    )
    said = len(data) if length is None else length
    return struct.pack("<I", len(header)) + header + struct.pack("<I", said) + data


def chunk(data: bytes, inflated: int, compression: str = "none") -> bytes:
    return record(data, op=b"\x05", compression=compression.encode(), size=struct.pack("<I", inflated))


def chunks_of(data: bytes) -> list[int]:
    """Where the chunks' headers begin."""
    out, at = [], data.find(b"compression=")
    while at >= 0:
        out.append(at)
        at = data.find(b"compression=", at + 1)
    return out


def test_it_is_the_table_of_the_same_messages(bag: Path, older: Path) -> None:
    assert len(chunks_of(older.read_bytes())) > 3
    found, wanted = bag_table(older), bag_table(bag)
    assert [(c.name, c.unit) for c in found.columns] == [(c.name, c.unit) for c in wanted.columns]
    names = [c.name for c in wanted.columns if c.name not in ("file", "source")]
    pd.testing.assert_frame_equal(
        pd.DataFrame({name: found.numbers(name) for name in names}),
        pd.DataFrame({name: wanted.numbers(name) for name in names}),
    )


def test_a_chunk_that_says_another_size_is_refused(older: Path, tmp_path: Path) -> None:
    data = older.read_bytes()
    at = data.index(b"size=", chunks_of(data)[1]) + 5
    (size,) = struct.unpack_from("<I", data, at)
    for said in (size - 1, size + 1, 2**32 - 1):
        (tmp_path / "a.bag").write_bytes(data[:at] + struct.pack("<I", said) + data[at + 4 :])
        with pytest.raises(
            InputError, match=rf"a chunk at byte \d+ that does not inflate to the {said} bytes"
        ):
            read_foreign(tmp_path / "a.bag", "bag")


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (struct.pack("<I", 1 << 31) + bytes(20), "at byte 13 with a header of 2147483648 bytes, expected at most 24"),
        (record(b"abc", 4, op=b"\x02"), "says it has 4 bytes, expected no more than the 3 that are left"),
        (record(b"abc", op=b"\x02") + record(b"", 1, op=b"\x02"), r"at byte 32 that says it has 1 bytes"),
        (chunk(b"abc", 2), "does not inflate to the 2 bytes"),
        (chunk(b"abc", 3, "bz2"), "does not inflate to the 3 bytes"),
        (chunk(b"abc", 3, "lz4"), "does not inflate to the 3 bytes"),
        (chunk(b"abc", 3, "7z"), "does not inflate to the 3 bytes"),
    ],
)  # fmt: skip
def test_a_bag_is_held_against_what_it_says(tmp_path: Path, body: bytes, told: str) -> None:
    path = tmp_path / "a.bag"
    path.write_bytes(MAGIC + body)
    with pytest.raises(InputError, match=told):
        read_foreign(path, "bag")


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_a_few_bytes_do_not_become_gigabytes(tmp_path: Path, compression: str) -> None:
    import bz2

    lz4 = pytest.importorskip("lz4.frame")
    large = 100 << 20
    data = {"bz2": bz2.compress, "lz4": lz4.compress}[compression](bytes(large))
    path = tmp_path / "a.bag"
    path.write_bytes(MAGIC + chunk(data, large, compression) * 6)
    with pytest.raises(InputError, match=f"chunks that inflate to {6 * large} bytes in a file of"):
        read_foreign(path, "bag")
