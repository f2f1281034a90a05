"""An arm that a tracker follows while it moves: readings by the thousand, in plain numpy, a block of rows at a time.

The arm is that of ``benchmarks/drivers``. As built its constants are off by their tolerances, joint 2 yields to gravity,
the gear of joint 3 errs twice a turn, and link 3 grows with its temperature. Torques come from levers, not from an energy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import yaml
from numpy.typing import NDArray

from support.plain_arm import GRAVITY, HIGH, JOINTS, KEYS, LOW, SIGMA, TOOL, WEIGHTS, constants, document

Array = NDArray[np.float64]
BLOCK = 50_000
"""Rows that are made together."""
RATE = 100.0
"""Readings in a second."""
YIELDS, GEAR, EXPANDS = 2.0e-6, 1.5e-4, 23e-6
"""rad/(N m) of joint 2, rad of joint 3's second order, and 1/K of link 3."""


def write(rows: int, folder: Path) -> tuple[Path, Path]:
    """The machine file and a Parquet recording of so many rows; the same rows begin every longer one."""
    machine = {**document(weighs=True), "sensor": {"type": "position", "sigma": {"xyz": SIGMA}}}
    file, recording = folder / "arm.yaml", folder / f"rows_{rows}.parquet"
    file.write_text(yaml.safe_dump(machine, sort_keys=False))
    writer = None
    for block in _blocks(rows):
        table = pa.table(dict(block))
        writer = writer or pq.ParquetWriter(recording, table.schema)
        writer.write_table(table)
    if writer is not None:
        writer.close()
    return file, recording


def _blocks(rows: int) -> Iterator[Mapping[str, Array]]:
    built = constants(np.random.default_rng(1))
    for first in range(0, rows, BLOCK):
        rng = np.random.default_rng([2, first])
        yield _readings(built, np.arange(first, min(first + BLOCK, rows)) / RATE, rng, BLOCK)


def _readings(
    built: Mapping[str, float], time: Array, rng: np.random.Generator, noises: int
) -> dict[str, Any]:
    """Columns of a recording, mm and deg, at times (n,) s."""
    q, warm = _path(time), 20.0 + 6.0 * np.sin(time / 71.0) + 2.0 * np.sin(time / 13.0)
    moved = np.radians(q)
    moved[:, 1] += YIELDS * _torque(built, moved)
    moved[:, 2] += GEAR * np.sin(2.0 * moved[:, 2] + 0.4)
    grown = 1.0 + EXPANDS * (warm - 20.0)
    at = _frames(built, moved, grown)[-1]
    point = at[:, :3, :3] @ np.array(TOOL) + at[:, :3, 3]
    c, s = np.cos(0.7), np.sin(0.7)
    stand = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    seen = point @ stand.T + [1500.0, 0.0, 300.0] + rng.normal(scale=SIGMA, size=(noises, 3))[: len(time)]
    columns = dict(zip(JOINTS, q.T, strict=True)) | dict(zip("xyz", seen.T, strict=True))
    return columns | {"time": time, "temperature.link3": warm}


def _path(time: Array) -> Array:
    """(n, 6) deg: every joint swings over its range, each at two rates of its own."""
    k = np.arange(6)
    swing = 0.7 * np.sin(time[:, None] * (0.31 + 0.067 * k) + k)
    swing += 0.3 * np.sin(time[:, None] * (0.83 - 0.051 * k) + 2.0 * k)
    return np.asarray(0.5 * (LOW + HIGH) + 0.5 * (HIGH - LOW) * swing)


def _frames(p: Mapping[str, float], q: Array, grown: Array | None = None) -> list[Array]:
    """Frames (n, 4, 4) of the six links, q (n, 6) rad; ``grown`` (n,): what lies behind joint 3 is longer by it."""
    out, here = [], np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for k, name in enumerate(JOINTS):
        b, a, d, t, r = (np.full(len(q), p[f"{name}.{key}"]) for key in KEYS)
        if k == 3 and grown is not None:
            d = d * grown
        here = here @ _turn(1, b) @ _turn(0, a) @ _shift(0, d) @ _turn(2, t + q[:, k]) @ _shift(2, r)
        out.append(here)
    return out


def _torque(p: Mapping[str, float], q: Array) -> Array:
    """(n,) torque that gravity exerts about joint 2, N m, from levers."""
    at = _frames(p, q)
    axis, foot, out = at[1][:, :3, 2], at[1][:, :3, 3], np.zeros(len(q))
    for link, (kg, com) in WEIGHTS.items():
        frame = at[int(link[4:]) - 1]
        lever = (frame[:, :3, :3] @ np.array(com) + frame[:, :3, 3] - foot) / 1000.0
        out += np.sum(axis * np.cross(lever, kg * GRAVITY), axis=1)
    return out


def _turn(axis: int, angle: Array) -> Array:
    out, (i, j) = np.tile(np.eye(4), (len(angle), 1, 1)), [(1, 2), (2, 0), (0, 1)][axis]
    out[:, i, i] = out[:, j, j] = np.cos(angle)
    out[:, i, j], out[:, j, i] = -np.sin(angle), np.sin(angle)
    return out


def _shift(axis: int, by: Array) -> Array:
    out = np.tile(np.eye(4), (len(by), 1, 1))
    out[:, axis, 3] = by
    return out


__all__ = ["write"]
