"""A calibrated 6-PUS, the telescope's hexapod with longer strokes, against the same closed form in numba.

Ours takes a rotation matrix, checks it and the ranges and verifies what it found; numba's takes angles and checks
nothing. Solved: every leg has its length to 1e-6 mm, computed here.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose.models.file.machine_file import write_machine

from . import generated, peers
from .arms import SEED
from .outcome import Kind, Row
from .problems import Problems, save
from .study import Options

Array = NDArray[np.float64]
A = [[391.3, -83.2], [391.3, 83.2], [-123.6, 380.4], [-267.7, 297.3], [-267.7, -297.3], [-123.6, -380.4]]
B = [[173.6, -179.9], [173.6, 179.9], [68.9, 240.3], [-242.6, 60.5], [-242.6, -60.5], [68.9, -240.3]]
LENGTH, HEIGHT, STROKE = 500.0, 439.6, 80.0
SHIFT, TILT = 15.0, float(np.radians(3.0))
"""Poses stand this far from home at most, each axis; the strokes hold them all."""
ERROR, LEAN = 1.0, float(np.radians(0.5))
CLOSED = 1e-6


@dataclass(frozen=True)
class Hexapod:
    """Legs: lower centres ``a`` (6, 3) at reading 0, unit rails ``u``, upper centres ``b``, lengths and offsets (6,); mm."""

    a: Array
    u: Array
    b: Array
    length: Array
    offset: Array

    def gaps(self, poses: Array, readings: Array) -> Array:
        """(n, 6) by how much legs are too long at poses (n, 4, 4) and readings (n, 6)."""
        upper = np.einsum("nij,kj->nki", poses[:, :3, :3], self.b) + poses[:, None, :3, 3]
        lower = self.a + (readings + self.offset)[..., None] * self.u
        return np.asarray(np.linalg.norm(upper - lower, axis=2) - self.length)

    def rows(self) -> Array:
        """(6, 11): a, u, b, length, offset."""
        return np.column_stack([self.a, self.u, self.b, self.length, self.offset])


def specimen(seed: int = SEED) -> Hexapod:
    """Errors up to 1 mm of every centre, length and offset, and rails that lean by up to 0.5 deg about each axis."""
    rng = np.random.default_rng([seed, 6])
    a, b = (np.pad(np.array(p), ((0, 0), (0, 1))) + rng.uniform(-ERROR, ERROR, (6, 3)) for p in (A, B))
    lean = rng.uniform(-LEAN, LEAN, (6, 2))
    u = np.column_stack([lean, np.sqrt(1 - np.sum(lean**2, axis=1))])
    length, offset = LENGTH + rng.uniform(-ERROR, ERROR, 6), rng.uniform(-ERROR, ERROR, 6)
    return Hexapod(a, u, b, length, offset)


def document(machine: Hexapod) -> dict[str, Any]:
    """Its machine file."""
    legs = [
        {
            "name": f"leg{k + 1}",
            "joint": f"rho{k + 1}",
            "a": machine.a[k].tolist(),
            "u": machine.u[k].tolist(),
            "b": machine.b[k].tolist(),
            "length": float(machine.length[k]),
            "offset": float(machine.offset[k]),
            "range": [-STROKE, STROKE],
        }
        for k in range(6)
    ]
    mechanism = {"type": "6-pus", "legs": legs, "home": [0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0]}
    head = {"schema": "truepose/machine/1", "name": "hexapod", "units": {"length": "mm", "angle": "deg"}}
    return {**head, "mechanism": mechanism, "tolerances": {"length": ERROR, "angle": 0.5}}


def poses(n: int, seed: int = 4) -> tuple[Array, Array]:
    """(n, 6) positions and roll, pitch, yaw around home, and the same as (n, 4, 4)."""
    rng = np.random.default_rng(seed)
    v = rng.uniform(-1, 1, (n, 6)) * [*3 * [SHIFT], *3 * [TILT]] + [0, 0, HEIGHT, 0, 0, 0]
    out = np.zeros((n, 4, 4))
    (cr, cp, cy), (sr, sp, sy) = np.cos(v[:, 3:]).T, np.sin(v[:, 3:]).T
    out[:, 0, :3] = np.column_stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr])
    out[:, 1, :3] = np.column_stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr])
    out[:, 2, :3] = np.column_stack([-sp, cp * sr, cp * cr])
    out[:, :3, 3], out[:, 3, 3] = v[:, :3], 1.0
    return v, out


def rows(options: Options) -> list[Row]:
    """The generated C, a pose a call and all in one, and numba; the guess is every slider at its middle."""
    machine = specimen()
    path: Path = options.folder / "hexapod.yaml"
    write_machine(path, document(machine))
    source = generated.write(path, options.folder, options.real)
    angles, matrices = poses(options.warm)
    files = save(Problems(matrices, np.zeros((options.warm, 6))), options.folder, "hexapod")
    modes = {"one": ("truepose C", Kind.OURS)}
    modes |= {"batch": ("truepose C, all in one call", Kind.BATCH)} if source.batch else {}
    close = CLOSED if options.real == "double" else 2e-6 * 2 * LENGTH
    out = []
    for mode, (title, kind) in modes.items():
        for flags in (generated.NATIVE, generated.PLAIN):
            program = generated.build(source, flags)
            timing = generated.timed(program, mode, files, options.repeats, options.core)
            share = _share(machine, matrices, timing.output[:, 1:], close)
            out.append(Row(f"{title}, from a rotation matrix", timing.seconds, share, kind, " ".join(flags)))
    if "numba" in options.peers.versions:
        inputs = {"legs": machine.rows(), "poses": angles, "repeats": options.repeats}
        timing = peers.timed(options.peers, "numba_hexapod", inputs, options.folder, options.core)
        share = _share(machine, matrices, timing.output, CLOSED)
        out.append(Row("numba, from angles, one thread", timing.seconds, share))
    return out


def _share(machine: Hexapod, matrices: Array, readings: Array, close: float) -> float:
    return float(np.mean(np.all(np.abs(machine.gaps(matrices, readings)) <= close, axis=1)))
