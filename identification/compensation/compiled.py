"""A machine's generated C in this process: forward and inverse kinematics of many rows, for long paths.

The C is the controller's own (``codegen``), compiled by the system's compiler for this processor and kept. Rows that it
does not solve are the caller's to solve otherwise. Poses are those of the tool in the nominal frame of the base, as in
the C, (n, 3, 4) [R|p]; mm, rad.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.arrays import Array, Mask
from truepose.codegen.c import render
from truepose.codegen.evaluation.compiled import NotCompiledError, load
from truepose.errors import InputError
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.task import Task
from truepose.threads import all_done

_NAME = "path"
"""In the C, whatever the machine is called: its own name need not be one of C's."""
_POINTERS = {"fk_n": 3, "ik_n": 4, "compensate_near_n": 4}
"""Of a function, behind the number of rows."""


class CompiledKinematics:
    """Forward and inverse kinematics of a machine with the effects of its file; any number of threads may use them.

    ``p`` (np,) are parameters, None for the machine's own, which are worked out beforehand. ``z`` (n, nz) are drivers; rows
    that all stand at the machine's own values are as quick as None.

    Raises NotCompiledError where there is no C compiler, or it makes no library, and for machines with more joints than
    their task has components: which of many solutions is taken must not depend on the way of solving.
    """

    def __init__(self, machine: Machine, task: Task) -> None:
        if len(machine.mechanism.readings) > len(task.rows):
            raise NotCompiledError("more joints than components of the pose to meet")
        drawing = machine.file.nominal if machine.file else {}
        mechanism = {parameter.name for parameter in machine.mechanism.parameters}
        nominal = {name: value for name, value in drawing.items() if name in mechanism}
        try:
            texts = render(replace(machine, name=_NAME), "double", nominal=nominal)
        except (InputError, NotImplementedError) as exc:  # a machine that has no C
            raise NotCompiledError(str(exc)) from None
        own = {name: text for name, text in texts.items() if name.startswith(f"{_NAME}_")}
        there = {name: n for name, n in _POINTERS.items() if f"{_NAME}_{name}(" in own[f"{_NAME}_batch.h"]}
        self._library = load(own, [f"{_NAME}_{name}" for name in there])
        for name, pointers in there.items():
            function = getattr(self._library, f"{_NAME}_{name}")
            function.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_int] + [ctypes.c_void_p] * pointers
            function.restype = ctypes.c_int

    def fk(self, q: Array, z: Array | None = None, p: Array | None = None) -> tuple[Array, Mask]:
        """Poses (n, 3, 4) of the tool at readings (n, nq), and which rows have one; the others are left unturned
        at the base."""
        q = _rows(q)
        poses, code = np.tile(np.eye(3, 4), (len(q), 1, 1)), np.zeros(len(q), dtype=np.intc)
        self._call("fk_n", p, z, q, poses, code)
        return poses, code == 0

    def ik(
        self, poses: Array, guess: Array, z: Array | None = None, p: Array | None = None
    ) -> tuple[Array, Mask]:
        """Readings (n, nq) near ``guess`` (n, nq) that put the tool at poses (n, 3, 4), and which rows have some."""
        q = np.array(guess, dtype=np.float64, order="C")
        code = np.zeros(len(q), dtype=np.intc)
        self._call("ik_n", p, z, _rows(poses), _rows(guess), q, code)
        return q, code == 0

    def near(self, q: Array, z: Array | None = None) -> tuple[Array, Array, Mask]:
        """Return commands (n, nq) for nominal readings (n, nq), the turn (n,) rad that each leaves, and which rows have one.

        For machines that may come to a singular pose.
        """
        command, left, code = np.array(q, order="C"), np.zeros(len(q)), np.zeros(len(q), dtype=np.intc)
        self._call("compensate_near_n", None, z, _rows(q), command, left, code)
        return command, left, code == 0

    def _call(self, name: str, p: Array | None, z: Array | None, *arrays: NDArray[np.generic]) -> None:
        given = [None if p is None else _rows(p), self._told(z)]
        places = [None if array is None else array.ctypes.data for array in (*given, *arrays)]
        getattr(self._library, f"{_NAME}_{name}")(*places[:2], len(arrays[0]), *places[2:])

    def _told(self, z: Array | None) -> Array | None:
        """Drivers (n, nz), None where they tell nothing that the C does not have."""
        if z is None or not z.shape[1]:
            return None
        own = (ctypes.c_double * z.shape[1]).in_dll(self._library, f"{_NAME}_z0")
        return None if np.array_equal(z, np.broadcast_to(np.array(own), z.shape)) else _rows(z)


def base_frame(machine: Machine) -> Array:
    """(4, 4) nominal frame of the base in the sensor's frame, as calibrated: what the C's poses leave out."""
    value = {parameter.name: parameter.nominal for parameter in machine.frames}
    xyz, rpy = ([value[f"base.{of}{axis}"] for axis in "xyz"] for of in ("", "r"))
    return lie.pose_of(lie.rpy_matrix(rpy), xyz)


def shared_out(part: Callable[[slice], None], count: int, block: int) -> None:
    """``part`` of every block of rows, by as many threads as there are processors; it fills arrays of the caller."""
    blocks = [slice(start, min(start + block, count)) for start in range(0, count, block)]
    all_done(part, blocks)


def _rows(array: Array) -> Array:
    return np.ascontiguousarray(array, dtype=np.float64)
