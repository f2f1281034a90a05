"""Read a file of commands back before it is published: it must hold the joints that were solved for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError, ReadBackError
from truepose.identification.compensation.path_table import load_path, whole_turns
from truepose.identification.recording.load import joint_columns
from truepose.models.machine.machine import Machine

ROUNDING = 1e-12
"""Largest difference of a reading, as a share of it: a file has all digits of a double, and degrees are converted and back."""


def check_commands(file: Path, machine: Machine, command: Array, name: str) -> None:
    """Raise ReadBackError, which ``name`` opens, unless a path's file holds the readings ``command`` (n, nq), mm and rad."""
    try:
        found = load_path(machine, file)[1].q.copy()
    except InputError as exc:
        told = str(exc).replace(f"{file}: ", "")
        raise ReadBackError(f"{name}: what was to be written cannot be read: {told}") from exc
    if found.shape != command.shape:
        raise ReadBackError(f"{name}: what was to be written has {len(found)} rows, expected {len(command)}")
    for k, joint in enumerate(joint_columns(machine)):
        found[:, k] += whole_turns(joint, command[:, k] - found[:, k])
    same = np.isclose(found, command, rtol=ROUNDING, atol=ROUNDING)
    if not same.all():
        row, k = np.argwhere(~same)[0]
        raise ReadBackError(
            f"{name}: what was to be written reads as another path: row {row + 1}: {machine.mechanism.readings[k]} is "
            f"{float(found[row, k])!r}, expected {float(command[row, k])!r} (mm, rad)"
        )
