"""A machine's generated C in this process: forward and inverse kinematics of many rows, for long paths.

The C is the controller's own (``codegen``), compiled by the system's compiler and kept. Rows that it does not solve are
the caller's to solve otherwise. Poses are those of the tool in the sensor's frame; mm, rad.
"""

from __future__ import annotations

import ctypes
import os
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from truepose.codegen.c import generate
from truepose.codegen.compiled import NotCompiledError, load
from truepose.errors import InputError
from truepose.models import lie
from truepose.models.machine import Machine

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_NAME = "path"
"""In the C, whatever the machine is called: its own name need not be one of C's."""
_BLOCK = 8192
_ROWS = """
int NAME_rows_fk(const NAME_real *p, const NAME_real *z, int n, const NAME_real *q, NAME_real *T, int *code);
int NAME_rows_ik(const NAME_real *p, const NAME_real *z, int n, const NAME_real *T, const NAME_real *q_guess,
    NAME_real *q, int *code);

int NAME_rows_fk(const NAME_real *p, const NAME_real *z, int n, const NAME_real *q, NAME_real *T, int *code)
{
    int k, failed = 0;
    for (k = 0; k < n; ++k) {
        code[k] = NAME_fk(p, z ? z + k * NAME_NZ : 0, q + k * NAME_N, T + k * 12);
        failed += code[k] != 0;
    }
    return failed;
}

int NAME_rows_ik(const NAME_real *p, const NAME_real *z, int n, const NAME_real *T, const NAME_real *q_guess,
    NAME_real *q, int *code)
{
    int k, failed = 0;
    for (k = 0; k < n; ++k) {
        code[k] = NAME_ik(p, z ? z + k * NAME_NZ : 0, T + k * 12, q_guess + k * NAME_N, q + k * NAME_N);
        failed += code[k] != 0;
    }
    return failed;
}
"""


class CompiledKinematics:
    """Forward and inverse kinematics of a machine with the effects of its file, rows shared out to all cores.

    Raises NotCompiledError where there is no C compiler, or it makes no library, and for machines with more joints than
    a pose has coordinates: which of many solutions is taken must not depend on the way of solving.
    """

    def __init__(self, machine: Machine) -> None:
        if len(machine.mechanism.readings) > 6:
            raise NotCompiledError("more than six joints")
        self._base = base_frame(machine)
        try:
            self._library = load(_source(machine))
        except (InputError, NotImplementedError) as exc:  # a machine that has no C
            raise NotCompiledError(str(exc)) from None
        for name in ("rows_fk", "rows_ik"):
            function = getattr(self._library, f"{_NAME}_{name}")
            pointers = 3 if name == "rows_fk" else 4
            function.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_int] + [ctypes.c_void_p] * pointers
            function.restype = ctypes.c_int

    def fk(self, p: Array, z: Array, q: Array) -> tuple[Array, Mask]:
        """Poses (n, 4, 4) of the tool at readings (n, nq) and drivers (n, nz), and which rows have one;
        the others are left at the base."""
        poses, code = np.tile(np.eye(3, 4), (len(q), 1, 1)), np.zeros(len(q), dtype=np.intc)
        p, z, q = _rows(p), _rows(z), _rows(q)

        def part(rows: slice) -> None:
            self._call("rows_fk", p, z[rows], q[rows], poses[rows], code[rows])

        _shared_out(part, len(q))
        out = np.zeros((len(q), 4, 4))
        out[:, :3], out[:, 3, 3] = self._base[:3, :3] @ poses, 1.0
        out[:, :3, 3] += self._base[:3, 3]
        return out, code == 0

    def ik(self, p: Array, z: Array, poses: Array, guess: Array) -> tuple[Array, Mask]:
        """Readings (n, nq) near ``guess`` (n, nq) that put the tool at poses (n, 4, 4), and which rows have some."""
        q, code = np.array(guess, dtype=float), np.zeros(len(poses), dtype=np.intc)
        flat = _rows(lie.inverse_pose(self._base)[:3] @ poses)
        p, z, guess = _rows(p), _rows(z), _rows(guess)

        def part(rows: slice) -> None:
            self._call("rows_ik", p, z[rows], flat[rows], guess[rows], q[rows], code[rows])

        _shared_out(part, len(q))
        return q, code == 0

    def _call(self, name: str, p: Array, z: Array, *arrays: NDArray[np.generic]) -> None:
        drivers = z.ctypes.data if z.shape[1] else None
        places = [array.ctypes.data for array in arrays]
        getattr(self._library, f"{_NAME}_{name}")(p.ctypes.data, drivers, len(z), *places)


def base_frame(machine: Machine) -> Array:
    """(4, 4) nominal frame of the base in the sensor's frame, as calibrated: what the C's poses leave out."""
    value = {parameter.name: parameter.nominal for parameter in machine.frames}
    out = np.eye(4)
    out[:3, :3] = lie.rpy_matrix(np.array([value[f"base.r{axis}"] for axis in "xyz"]))
    out[:3, 3] = [value[f"base.{axis}"] for axis in "xyz"]
    return out


def _source(machine: Machine) -> str:
    """The machine's C as one text, with functions over rows.

    Not those of NAME_batch.c: they would have to be a file of their own, and rows with drivers go one by one there too.
    """
    with tempfile.TemporaryDirectory() as folder:
        paths = generate(replace(machine, name=_NAME), Path(folder) / _NAME)
        texts = {path.name: path.read_text(encoding="utf-8") for path in paths}
    header = f"{_NAME}_kin.h"
    text = texts[f"{_NAME}_kin.c"].replace(f'#include "{header}"', texts[header], 1)
    return text + _ROWS.replace("NAME", _NAME)


def _rows(array: Array) -> Array:
    return np.ascontiguousarray(array, dtype=np.float64)


def _shared_out(part: Callable[[slice], None], count: int) -> None:
    """Every block of rows, by as many threads as this process may use cores; the C is re-entrant."""
    blocks = [slice(start, min(start + _BLOCK, count)) for start in range(0, count, _BLOCK)]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if len(blocks) < 2 or cores < 2:
        for rows in blocks:
            part(rows)
        return
    with ThreadPoolExecutor(cores) as pool:
        list(pool.map(part, blocks))


__all__ = ["CompiledKinematics", "NotCompiledError", "base_frame"]
