"""Read an exported text back before it is published: it must hold the machine that was meant.

A URDF is read by ``type: urdf``, a xacro as the URDF of its macro, an MJCF as ``truepose init`` starts from it, and the other
formats by small readers of their own (``read_ur_kinematics``, ``read_volumetric``). What a format cannot hold is not compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from xml.etree.ElementTree import ParseError

import casadi as ca
import numpy as np
import yaml

from truepose.arrays import Array
from truepose.errors import InputError, ReadBackError
from truepose.models.leaves.export.closing import closed_pose_function
from truepose.models.leaves.export.held import held, sample_readings
from truepose.models.leaves.export.links import links_of
from truepose.models.leaves.export.read_mjcf import read_mjcf
from truepose.models.leaves.export.read_ur_kinematics import read_ur_kinematics
from truepose.models.leaves.export.read_urdf import read_base, read_urdf
from truepose.models.leaves.export.read_volumetric import read_table
from truepose.models.leaves.export.read_xacro import expand_xacro
from truepose.models.leaves.export.standing import standing
from truepose.models.leaves.export.tree import Tree, tree_of
from truepose.models.leaves.export.volumetric import table_of
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE

Frames = Mapping[str, Array]
ROWS = 10
"""Rows of readings at which poses are compared."""
SAME = 1e-10
"""Largest difference of a pose, as a share of the machine's reach or of a radian. Numbers are written as texts that read as
the same doubles, and what is below 1e-15 m or rad as zero: a hundred frames one after the other lose a thousandth of this."""
NEAR = 0.1
"""Share of the way from home at which loops are compared: far from it they can be assembled in several ways."""
DIGITS = {"iso230": (5e-10, 5e-13, 5e-12), "isg-csv": (5e-13, 5e-13, 5e-10)}
"""Half of the last digit that a table has of an error, mm and rad, and of a position, as a share of it."""
NONE = 1e-15
"""mm or rad; a position that is no more is zero."""
SHUT = 1e-9
"""mm; what rounding leaves of loops that close. Others are strained, if only a little, and stand as they share that out."""


def check_export(text: str, machine: Machine, format: str, name: str) -> None:
    """Raise ReadBackError, which ``name`` opens, unless a text in a format holds a machine: a fault of truepose."""
    try:
        difference = next(_compare(text, machine, format), None)
    except (InputError, ParseError, yaml.YAMLError, LookupError, ValueError) as exc:
        told = f"found no {exc}" if isinstance(exc, KeyError) else " ".join(str(exc).split())
        raise ReadBackError(f"{name}: what was to be written cannot be read: {told}") from exc
    if difference is not None:
        raise ReadBackError(f"{name}: what was to be written reads as another machine: {difference}")


def _compare(text: str, machine: Machine, format: str) -> Iterator[str]:
    """Yield in words what a text and a machine do not share."""
    if format in DIGITS:
        return _compare_table(text, machine, format)
    if format == "mjcf" and (machine.mechanism.rods or machine.mechanism.closing):
        return _compare_loops(text, machine)
    meant = tree_of(machine, held(machine).values, format)
    if format == "ur-kinematics":
        return _compare_ur_kinematics(text, machine, meant)
    if format == "mjcf":
        return _compare_mjcf(text, machine, meant)
    return _compare_urdf(expand_xacro(text) if format == "xacro" else text, machine, meant)


def _compare_urdf(text: str, machine: Machine, meant: Tree) -> Iterator[str]:
    """Yield how the links of a URDF differ from a tree."""
    links = links_of(machine, meant)
    carrying = {joint.parent for joint in links.joints} | {links.tool}
    read = read_urdf(text, [links.tool, *(j.child for j in links.joints if j.child not in carrying)])
    yield from _compare_ranges(read, machine)
    yield from _compare_frames({BASE: read_base(text)}, {BASE: meant.world})
    found = tree_of(read, held(read).values, "URDF")
    for readings in _sample_rows(machine):
        yield from _compare_frames(found.links(readings), links.frames(readings))


def _compare_mjcf(text: str, machine: Machine, meant: Tree) -> Iterator[str]:
    """Yield how the bodies of an MJCF, and its site, differ from a tree in the world."""
    links, mjcf = links_of(machine, meant), read_mjcf(text)
    read, graph = mjcf.machine()
    yield from _compare_ranges(read, machine)
    found = tree_of(read, held(read).values, "MJCF")
    still = {body.name: mjcf.parts.poses[k] for k, body in enumerate(mjcf.parts.bodies)}
    for readings in _sample_rows(machine):
        moved = {name: graph.pose @ pose for name, pose in found.links(readings).items()}
        expected = {name: meant.world @ pose for name, pose in links.frames(readings).items()}
        yield from _compare_frames({**still, **moved, BASE: still[BASE]}, expected)


def _compare_ur_kinematics(text: str, machine: Machine, meant: Tree) -> Iterator[str]:
    """Yield how the flange of a kinematics file differs from an arm's, and what its comments say of base and tool."""
    turning = [joint.name for joint in meant.path() if joint.kind != "fixed"]
    for readings in _sample_rows(machine):
        flange = meant.links(readings)[meant.flange] @ meant.offsets[meant.flange]
        expected = {BASE: meant.world, "flange": flange, "tool": meant.pose(readings)}
        yield from _compare_frames(read_ur_kinematics(text, [readings[name] for name in turning]), expected)


def _compare_loops(text: str, machine: Machine) -> Iterator[str]:
    """Yield how an MJCF differs from a machine with loops: its bodies at home, and the tool at other readings.

    Where loops are strained MuJoCo shares out what they lack in its own way.
    """
    values, names = held(machine).values, machine.mechanism.readings
    at, mjcf = standing(machine, values, "MJCF"), read_mjcf(text)
    read, graph = mjcf.machine()
    yield from _compare_ranges(read, machine)
    start = {a.reading: a.home for a in read.mechanism.actuators}
    home, begun = (np.array([where[name] for name in names], dtype=float) for where in (at.readings, start))
    if not np.allclose(begun, home, rtol=SAME, atol=NONE):
        yield f"its loops begin at {begun}, expected {home} (mm, rad)"
    bodies = {name: at.world @ pose for name, pose in at.bodies.items()}
    tool = bodies[machine.mechanism.flange] @ at.tool
    still = {body.name: mjcf.parts.poses[k] for k, body in enumerate(mjcf.parts.bodies)}
    yield from _compare_frames(still, {**bodies, mjcf.tool: tool})
    if at.gap > SHUT:
        return
    pose, again = (_held_pose(one) for one in (machine, read))
    order = [names.index(name) for name in read.mechanism.readings]
    for q in home + NEAR * (sample_readings(machine)[:ROWS] - home):
        expected = at.world @ pose(q)
        if np.isfinite(expected).all():
            found = again(q[order])
            closed = {mjcf.tool: graph.pose @ found} if np.isfinite(found).all() else None
            yield from _compare_frames(closed, {mjcf.tool: expected})


def _held_pose(machine: Machine) -> Callable[[Array], Array]:
    """Return a function of readings (nq,) to the tool (4, 4) mm in the base, with the constants that a format holds."""
    model, values = symbolic_model(machine, (), ports=True), held(machine).values
    pose, p = closed_pose_function(model), np.array([values[name] for name in model.names])
    return lambda q: pose(q, p)


def _compare_table(text: str, machine: Machine, format: str) -> Iterator[str]:
    """Yield how a volumetric table differs from a machine at its positions, each axis by itself."""
    length, angle, share = DIGITS[format]
    table, meant = read_table(text, machine.mechanism.readings), table_of(machine)
    for axis, other in zip(table.axes, meant.axes, strict=True):
        found, drawn = (np.append(one.positions, one.reference) for one in (axis, other))
        if axis.letter != other.letter or axis.sign != other.sign or len(found) != len(drawn):
            yield f"{axis.joint} is axis {axis.letter} at {len(axis.positions)} positions"
        elif not np.allclose(found, drawn, rtol=share, atol=NONE):
            yield f"the positions of axis {axis.letter} are others"
    pairs = zip(table.axes, meant.axes, strict=True)
    axes = [replace(axis, positions=other.positions, reference=other.reference) for axis, other in pairs]
    table = replace(table, axes=tuple(axes))
    model = symbolic_model(machine, machine.effects)
    pose = ca.Function("pose", [model.q, model.z, model.p], [model.pose])
    for k, axis in enumerate(table.axes):
        q = np.tile([other.reference for other in table.axes], (len(axis.positions), 1))
        q[:, k] = axis.positions
        expected = np.array([np.array(pose(row, model.z_home, model.p_home)) for row in q])
        away = np.abs(table.pose(q) - expected).max(axis=0)
        reach = max(1.0, float(np.max(np.abs(expected[:, :3, 3]))), float(np.max(np.abs(axis.centre))))
        worst, turn = float(np.max(away[:3, 3])), float(np.max(away[:3, :3]))
        if not (worst <= 2.0 * (length + reach * angle) and turn <= 4.0 * angle):
            yield f"with axis {axis.letter} alone its tool is off by {worst:.1e} mm and {turn:.1e} rad"


def _sample_rows(machine: Machine) -> Iterator[dict[str, float]]:
    for row in sample_readings(machine)[:ROWS].tolist():
        yield dict(zip(machine.mechanism.readings, row, strict=True))


def _compare_ranges(read: Machine, machine: Machine) -> Iterator[str]:
    """Yield what joints differ, or their ranges (mm, rad); where the machine states none a format may have a wide one."""
    found, stated = ({a.reading: a.range for a in one.mechanism.actuators} for one in (read, machine))
    if found.keys() != stated.keys():
        yield f"its joints are {', '.join(found)}, expected {', '.join(stated)}"
    for name, ends in stated.items():
        if ends and not np.allclose(found.get(name) or (np.inf, np.inf), ends, rtol=SAME, atol=0.0):
            yield f"the range of {name} is {found.get(name)}, expected {ends} (mm, rad)"


def _compare_frames(found: Frames | None, meant: Frames) -> Iterator[str]:
    """Yield which frames (4, 4) mm are missing or elsewhere; ``found`` is None where loops cannot be closed."""
    if found is None:
        yield "its loops cannot be closed"
        return
    reach = max(1.0, *(float(np.max(np.abs(pose[:3, 3]))) for pose in meant.values()))
    for name, pose in meant.items():
        if name not in found:
            yield f"the frame {name} is missing"
            continue
        away = float(np.max(np.abs(found[name] - pose) / [1.0, 1.0, 1.0, reach]))
        if not away <= SAME:
            yield f"the frame {name} is off by {away:.1e} of its reach"
