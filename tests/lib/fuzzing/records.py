"""Mutation of MCAP by its structure: records dropped, repeated, renamed, with other lengths; then plain bytes."""

from __future__ import annotations

import struct
from random import Random

from fuzzing import texts

_MAGIC = 8


def mutated(rng: Random, seed: bytes, other: bytes) -> bytes:
    """A bag with one flaw or some."""
    if rng.random() < 0.4:
        return texts.mutated(rng, seed, other)
    records = _records(seed)
    for _ in range(rng.choice((1, 1, 2, 5))):
        if records:
            _flaw(rng, records)
    body = b"".join(struct.pack("<BQ", code, length) + data for code, length, data in records)
    return seed[:_MAGIC] + body + seed[-_MAGIC:]


def _records(data: bytes) -> list[tuple[int, int, bytes]]:
    """Of each record what it is, how long it says it is, and what it holds."""
    out, at = [], _MAGIC
    while at + 9 <= len(data) - _MAGIC:
        code, length = struct.unpack_from("<BQ", data, at)
        out.append((code, length, data[at + 9 : at + 9 + length]))
        at += 9 + length
    return out


def _flaw(rng: Random, records: list[tuple[int, int, bytes]]) -> None:
    k, kind = rng.randrange(len(records)), rng.randrange(6)
    code, length, data = records[k]
    if kind == 0:
        del records[k]
    elif kind == 1:
        records[k:k] = [records[k]] * rng.choice((1, 2, 50))
    elif kind == 2:
        records[k] = (rng.randrange(256), length, data)
    elif kind == 3:
        records[k] = (code, rng.choice((0, 1, 2**31, 2**40, 2**63, length + 1, max(length - 1, 0))), data)
    elif kind == 4:
        new = texts.mutated(rng, data, data)
        records[k] = (code, len(new), new)
    else:
        other = rng.randrange(len(records))
        records[k], records[other] = records[other], records[k]


__all__ = ["mutated"]
