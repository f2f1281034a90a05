"""Machines that cannot hold all six components of a pose, or are not asked to: drawn, and as built."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truepose.arrays import Array
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Parameter


class Partial(NamedTuple):
    """The mechanism of a file, its task where it states one, and the task that it has."""

    mechanism: str
    stated: str
    components: tuple[str, ...]


HEAD = "schema: truepose/machine/1\nname: {name}\nmechanism:\n{mechanism}{stated}"
TOOL = "frames: {tool: {in: flange, xyz: [12, -7, 60], rpy: [2, -3, 20]}}\n"
MILL = """  type: graph
  bodies: [table, cradle, bed, saddle, column, spindle]
  flange: spindle
  joints:
    - {name: C, kind: revolute, parent: table, child: cradle, axis: [0, 0, -1], actuated: true, range: [-360, 360]}
    - {name: A, kind: revolute, parent: cradle, child: bed, xyz: [0, 0, 50], axis: [-1, 0, 0], actuated: true,
       range: [-120, 120]}
    - {name: Y, kind: prismatic, parent: bed, child: saddle, axis: [0, 1, 0], actuated: true, range: [-300, 300]}
    - {name: X, kind: prismatic, parent: saddle, child: column, axis: [1, 0, 0], actuated: true, range: [-300, 300]}
    - {name: Z, kind: prismatic, parent: column, child: spindle, axis: [0, 0, 1], actuated: true, range: [-300, 300]}
"""
HEAD_AND_TABLE = """  type: graph
  bodies: [part, table, bed, saddle, column, ram, head]
  flange: head
  joints:
    - {name: C, kind: revolute, parent: part, child: table, axis: [0, 0, -1], actuated: true, range: [-360, 360]}
    - {name: mount, kind: fixed, parent: table, child: bed, xyz: [0, 0, -80]}
    - {name: X, kind: prismatic, parent: bed, child: saddle, axis: [1, 0, 0], actuated: true, range: [-300, 300]}
    - {name: Y, kind: prismatic, parent: saddle, child: column, axis: [0, 1, 0], actuated: true, range: [-300, 300]}
    - {name: Z, kind: prismatic, parent: column, child: ram, axis: [0, 0, 1], actuated: true, range: [-300, 300]}
    - {name: B, kind: revolute, parent: ram, child: head, xyz: [0, 0, 400], axis: [0, 1, 0], actuated: true,
       range: [-110, 110]}
"""
GANTRY = """  type: serial
  joints:
    - {name: X, kind: prismatic, alpha: -90, range: [0, 800]}
    - {name: Y, kind: prismatic, alpha: 90, theta: 90, range: [0, 500]}
    - {name: Z, kind: prismatic, alpha: 90, range: [-300, 0]}
"""
SCARA = """  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-130, 130]}
    - {name: q2, kind: revolute, d: 325, range: [-140, 140]}
    - {name: q3, kind: prismatic, d: 275, range: [-200, 0]}
    - {name: q4, kind: revolute, range: [-360, 360]}
"""
PALLETS = """  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, d: 150, theta: -90, range: [-60, 70]}
    - {name: q3, kind: revolute, d: 600, range: [20, 130]}
    - {name: q4, kind: revolute, d: 500, range: [-120, 120]}
"""
PLANAR = """  type: serial
  joints:
    - {name: q1, kind: revolute, range: [-170, 170]}
    - {name: q2, kind: revolute, d: 300, range: [20, 150]}
"""
PAN_TILT = """  type: serial
  joints:
    - {name: pan, kind: revolute, r: 120, range: [-180, 180]}
    - {name: tilt, kind: revolute, alpha: -90, theta: -90, range: [20, 160]}
"""
ARM = """  type: serial
  joints:
    - {name: q1, kind: revolute, r: 128, range: [-180, 180]}
    - {name: q2, kind: revolute, alpha: 90, range: [20, 160]}
    - {name: q3, kind: revolute, d: -612, range: [-150, -20]}
    - {name: q4, kind: revolute, d: -571, r: 163, range: [-180, 180]}
    - {name: q5, kind: revolute, alpha: 90, r: 115, range: [20, 160]}
    - {name: q6, kind: revolute, alpha: -90, r: 92, range: [-180, 180]}
"""


def _delta(axes: str = "") -> str:
    """Return a printer: three carriages on columns, each with a rod to a platform that does not turn.

    The platform carries a spindle that turns about each of the ``axes``, one behind the other.
    """
    joints = [
        f"{{name: p{axis}, kind: prismatic, parent: {parent}, child: {child}, axis: {vector}}}"
        for axis, parent, child, vector in (
            ("x", "frame", "sledge", [1, 0, 0]),
            ("y", "sledge", "cross", [0, 1, 0]),
            ("z", "cross", "platform", [0, 0, 1]),
        )
    ]
    length, radius, home = 270.0, 140.0, ["px: 0", "py: 0", "pz: 0"]
    height = np.sqrt(length**2 - radius**2)
    for k, angle in enumerate(np.deg2rad([90, 210, 330]), start=1):
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        joints += [
            f"{{name: c{k}, kind: prismatic, parent: frame, child: carriage{k}, xyz: [{x:.6f}, {y:.6f}, 0], "
            "axis: [0, 0, 1], actuated: true, range: [150, 320]}",
            f"{{name: u{k}, kind: universal, parent: carriage{k}, child: rod{k}}}",
            f"{{name: s{k}, kind: spherical, parent: rod{k}, child: platform, xyz: [0, 0, {-length}]}}",
        ]
        turn = np.rad2deg([np.arctan2(-y, height), np.arcsin(x / length)])
        home += [f"c{k}: {height:.6f}", f"u{k}: [{turn[0]:.6f}, {turn[1]:.6f}]"]
    spindle = ["platform", *(f"spindle_{axis}" for axis in axes)]
    for axis, parent, child in zip(axes, spindle, spindle[1:], strict=False):
        joints.append(
            f"{{name: turn_{axis}, kind: revolute, parent: {parent}, child: {child}, "
            f"axis: {[int(axis == a) for a in 'xyz']}, actuated: true, range: [-100, 100]}}"
        )
    bodies = [
        "frame",
        "sledge",
        "cross",
        *spindle,
        *(f"{part}{k}" for k in (1, 2, 3) for part in ("carriage", "rod")),
    ]
    listed = "\n".join(f"    - {joint}" for joint in joints)
    return (
        f"  type: graph\n  bodies: [{', '.join(bodies)}]\n  flange: {spindle[-1]}\n  joints:\n{listed}\n"
        f"  home: {{{', '.join(home)}}}\n"
    )


PARTIAL = {
    "mill": Partial(MILL, "", ("x", "y", "z", "axis")),
    "head_and_table": Partial(
        HEAD_AND_TABLE, "frames: {tool: {in: flange, xyz: [0, 0, -120]}}\n", ("x", "y", "z", "axis")
    ),
    "gantry": Partial(GANTRY, "", ("x", "y", "z")),
    "scara": Partial(SCARA, "", ("x", "y", "z", "rz")),
    "pallets": Partial(PALLETS, "", ("x", "y", "z", "rz")),
    "planar2": Partial(
        PLANAR, "frames: {tool: {in: flange, xyz: [250, 0, 0], rpy: [0, 0, 10]}}\n", ("x", "y")
    ),
    "planar3": Partial(
        PLANAR + "    - {name: q3, kind: revolute, d: 250, range: [-150, 150]}\n",
        "frames: {tool: {in: flange, xyz: [80, 0, 0]}}\n",
        ("x", "y", "rz"),
    ),
    "pan_tilt": Partial(
        PAN_TILT, "frames: {tool: {in: flange, xyz: [12, -7, 60], rpy: [0, 90, 0]}}\n", ("axis",)
    ),
    "delta": Partial(_delta(), "frames: {tool: {in: flange, xyz: [0, 0, -30]}}\n", ("x", "y", "z")),
    "delta5": Partial(
        _delta("zx"), "frames: {tool: {in: flange, xyz: [0, 0, -30]}}\n", ("x", "y", "z", "axis")
    ),
    "tube": Partial(PAN_TILT, "task: [axis.x]\n", ("axis.x",)),
    "wrist": Partial(PAN_TILT, "task: [ry, rz]\n", ("ry", "rz")),
    "drill": Partial(ARM, TOOL + "task: [x, y, z, axis]\n", ("x", "y", "z", "axis")),
}


def partial_machine(directory: Path, name: str, more: str = "") -> Machine:
    """Return a machine as drawn; ``more``: further lines of its file."""
    own = PARTIAL[name]
    path = directory / f"{name}.yaml"
    text = HEAD.format(name=name, mechanism=own.mechanism, stated=own.stated + more)
    path.write_text(text, encoding="utf-8")
    return load_machine(path)


def as_built(machine: Machine, seed: int, length: float = 0.3, angle: float = 2e-3) -> Machine:
    """Return the machine calibrated: its constants have errors (1-sigma mm, rad), its drawing is the file's ``nominal``."""
    rng = np.random.default_rng(seed)
    sizes = {"mm": length, "rad": angle}
    drawn = {p.name: p.nominal for p in machine.parameters}
    moved = {
        name: value + sizes.get(machine.unit_of(name), 0.0) * rng.normal() for name, value in drawn.items()
    }
    assert machine.file

    def renewed(parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
        return tuple(replace(p, nominal=moved[p.name]) for p in parameters)

    return replace(
        machine,
        mechanism=replace(machine.mechanism, parameters=renewed(machine.mechanism.parameters)),
        frames=renewed(machine.frames),
        file=replace(machine.file, nominal=drawn),
    )


def readings(machine: Machine, count: int, seed: int) -> Array:
    """Return readings (count, nq) inside the ranges, not at their ends."""
    low, high = np.array([a.range for a in machine.mechanism.actuators], dtype=float).T
    share = np.random.default_rng(seed).uniform(0.1, 0.9, (count, len(low)))
    return np.asarray(low + (high - low) * share)
