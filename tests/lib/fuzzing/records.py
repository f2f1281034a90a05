"""Mutation of bags by their structure: records dropped, repeated, renamed, with other lengths; then plain bytes.

A record is what it is (``head``), how many bytes it says it has, and its data.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from fuzzing import texts


@dataclass(frozen=True)
class Layout:
    """How a kind of bag lays out records.

    head: bytes of a record's head at a place of the file. length: format of what it says. ends: bytes that stay at the
    beginning and the end of the file.
    """

    head: Callable[[bytes, int], int]
    length: str
    ends: tuple[int, int]

    def mutated(self, rng: Random, seed: bytes, other: bytes) -> bytes:
        """A bag with one flaw or some."""
        if rng.random() < 0.4:
            return texts.mutated(rng, seed, other)
        records = self._records(seed)
        for _ in range(rng.choice((1, 1, 2, 5))):
            if records:
                _flaw(rng, records)
        most = 256 ** struct.calcsize(self.length) - 1
        body = b"".join(
            head + struct.pack(self.length, min(said, most)) + data for head, said, data in records
        )
        first, last = self.ends
        return seed[:first] + body + (seed[-last:] if last else b"")

    def _records(self, data: bytes) -> list[tuple[bytes, int, bytes]]:
        out, at = [], self.ends[0]
        while at < len(data) - self.ends[1]:
            head = data[at : at + self.head(data, at)]
            begin = at + len(head) + struct.calcsize(self.length)
            (said,) = struct.unpack_from(self.length, data, at + len(head))
            out.append((head, said, data[begin : begin + said]))
            at = begin + said
        return out


def _ros1_head(data: bytes, at: int) -> int:
    return int(4 + struct.unpack_from("<I", data, at)[0])


MCAP = Layout(lambda data, at: 1, "<Q", (8, 8))
ROS1 = Layout(_ros1_head, "<I", (len(b"#ROSBAG V2.0\n"), 0))


def _flaw(rng: Random, records: list[tuple[bytes, int, bytes]]) -> None:
    k, kind = rng.randrange(len(records)), rng.randrange(6)
    head, said, data = records[k]
    if kind == 0:
        del records[k]
    elif kind == 1:
        records[k:k] = [records[k]] * rng.choice((1, 2, 50))
    elif kind == 2:
        at = rng.randrange(len(head))
        records[k] = (head[:at] + bytes([rng.randrange(256)]) + head[at + 1 :], said, data)
    elif kind == 3:
        records[k] = (head, rng.choice((0, 1, 2**31, 2**40, 2**63, said + 1, max(said - 1, 0))), data)
    elif kind == 4:
        new = texts.mutated(rng, data, data)
        records[k] = (head, len(new), new)
    else:
        other = rng.randrange(len(records))
        records[k], records[other] = records[other], records[k]


__all__ = ["MCAP", "ROS1", "Layout"]
