"""Read an exported URDF back before it is published: the reader of ``type: urdf`` must find the machine that was meant."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from truepose.errors import InputError, ReadBackError
from truepose.models.export.held import held
from truepose.models.export.links import links_of
from truepose.models.export.tree import Tree, tree_of
from truepose.models.load import build_machine
from truepose.models.machine import Machine
from truepose.models.machine_file import SCHEMA, checked_machine
from truepose.models.mechanism import BASE

POSES = 10
SAME = 1e-9
"""Largest difference of a pose, as a share of the machine's reach or of a radian."""


def check_urdf(file: Path, machine: Machine, name: str) -> None:
    """Raise ReadBackError, which ``name`` opens, unless a URDF holds the links of a machine: a fault of truepose."""
    meant = tree_of(machine, held(machine).values, "URDF")
    chain = {"type": "urdf", "file": file.name, "base_link": BASE, "tip_link": links_of(machine, meant).tool}
    try:
        read = build_machine(
            checked_machine(file, {"schema": SCHEMA, "name": machine.name, "mechanism": chain})
        )
        away = _distance(tree_of(read, held(read).values, "URDF"), meant)
    except InputError as exc:
        raise ReadBackError(f"{name}: what was to be written cannot be read: {exc}") from exc
    if not away <= SAME:
        raise ReadBackError(
            f"{name}: what was to be written reads as another machine: poses differ by {away:.1e} of its reach"
        )


def _distance(read: Tree, meant: Tree) -> float:
    """Return the largest difference of poses on the way to the tool; infinite where the joints are others."""
    led = [(j.name, j.kind, j.range) for j in meant.path() if j.kind != "fixed" and j.follows is None]
    found = {j.name: (j.kind, j.range) for j in read.path() if j.kind != "fixed" and j.follows is None}
    if found.keys() != {name for name, _, _ in led}:
        return np.inf
    rng, away = np.random.default_rng(0), 0.0
    for _ in range(POSES):
        readings = {name: float(rng.uniform(*(ends or (-1.0, 1.0)))) for name, _, ends in led}
        at, expected = read.pose(readings), meant.pose(readings)
        scale = np.array([1.0, 1.0, 1.0, max(1.0, float(np.max(np.abs(expected[:3, 3]))))])
        away = max(away, float(np.max(np.abs(at - expected) / scale)))
    for name, kind, ends in led:  # a slide without a range has a wide one in a URDF
        if found[name][0] != kind or (
            ends and not np.allclose(found[name][1] or (0.0, 0.0), ends, rtol=SAME)
        ):
            return np.inf
    return away


__all__ = ["check_urdf"]
