"""What a directory of generated C says of itself: name, precision, joints, test vectors."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from truepose.arrays import Array
from truepose.codegen.printer import Real
from truepose.errors import InputError

_DEGREE = math.radians(1.0)
_SHARE_OF_TURN, _SHARE = 0.02, 0.005
_AWAY = 100.0


@dataclass(frozen=True)
class Source:
    """Generated C as it lies in ``directory``.

    joints (m, n)   of the test vectors, in the units of the interface
    poses (m, 12)   of the tool there, 3x4 row-major [R|p], mm
    units (n,)      of the joints, "rad", "mm" or another
    """

    directory: Path
    name: str
    real: Real
    units: tuple[str, ...]
    joints: Array
    poses: Array

    @property
    def remembers(self) -> bool:
        """Whether drivers that remember are followed by ``NAME_state.c``."""
        return (self.directory / f"{self.name}_state.c").is_file()

    @property
    def aside(self) -> Array:
        """(n,) how far a warm guess stands from the solution: 1 deg, or for lengths 0.5 % of what the vectors span."""
        span = np.ptp(self.joints, axis=0)
        turning = np.array([unit == "rad" for unit in self.units])
        away: Array = np.where(turning, np.minimum(_DEGREE, _SHARE_OF_TURN * span), _SHARE * span)
        return away

    @property
    def far(self) -> float:
        """A distance (mm) that no pose of the machine is away from another."""
        return _AWAY * (1.0 + float(np.max(np.linalg.norm(self.poses[:, 3::4], axis=1))))


def read_source(directory: Path, name: str | None = None) -> Source:
    """Read header and test vectors of ``name`` (default: the one machine in ``directory``).

    Raises InputError where a file is missing or is not what truepose writes.
    """
    headers = sorted(directory.glob(f"{name or '*'}_kin.h"))
    if len(headers) != 1:
        raise InputError(
            f"{directory}: found {len(headers)} files {name or 'NAME'}_kin.h, expected one of generated C"
        )
    header = headers[0].read_text(encoding="utf-8")
    name = headers[0].name.removesuffix("_kin.h")
    real = re.search(rf"^typedef (double|float) {re.escape(name)}_real;", header, re.MULTILINE)
    size = re.search(rf"^#define {re.escape(name)}_N (\d+)", header, re.MULTILINE)
    listed = header.partition("\n   p: ")[0]
    units = re.findall(r"^ +\d+  .*? \[(.*?)\]", listed, re.MULTILINE)
    if not real or not size or len(units) != int(size.group(1)):
        raise InputError(
            f"{headers[0]}: expected type, number and units of the joints as truepose writes them"
        )
    joints, poses = _vectors(directory / "test_vectors.csv", len(units))
    return Source(directory, name, cast(Real, real.group(1)), tuple(units), joints, poses)


def _vectors(file: Path, n: int) -> tuple[Array, Array]:
    try:
        rows = list(csv.reader(file.read_text(encoding="utf-8").splitlines()))[1:]
        table = np.array([[float(value) for value in row] for row in rows])
    except (OSError, ValueError) as exc:
        raise InputError(f"{file}: cannot read the test vectors: {exc}") from exc
    if table.ndim != 2 or table.shape[1] != n + 12 or not np.isfinite(table).all():
        raise InputError(f"{file}: found a table {table.shape}, expected {n + 12} finite numbers a row")
    return table[:, :n], table[:, n:]
