"""Exported machines read by others: by this package's own URDF and MuJoCo, and by a few lines of numpy."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from support import plain_kinematics
from support.generated_machines import BODIES, HEAD, machine_of
from support.machine_texts import machine_from
from support.skips import NO_MUJOCO
from truepose.arrays import Array
from truepose.identification.compensation.inverse import PoseSolver
from truepose.models.file.machine_file import SCHEMA, checked_machine
from truepose.models.load import build_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

Pose = Callable[[Array], Array]
"""Readings (nq,) mm and rad to the tool (4, 4) mm."""
MOUNTED = (
    "frames: {base: {in: world, xyz: [40, -3, 700], rpy: [1, 2, 30]}, tool: {in: flange, xyz: [3, 4, 50]}}\n"
)
BRANCHED = """  type: graph
  bodies: [base, column, boom, hand, camera]
  flange: hand
  joints:
    - {name: pan, kind: revolute, parent: base, child: column, xyz: [1, 2, 300], rpy: [0.1, 0.2, 0.3],
       axis: [0.1, -0.2, 0.97], offset: 3, actuated: true, range: [-170, 170]}
    - {name: lift, kind: prismatic, parent: column, child: boom, xyz: [50, 0, 0], rpy: [10, 90, 5],
       axis: [0.6, 0, -0.8], offset: 12.5, actuated: true}
    - {name: mount, kind: fixed, parent: boom, child: hand, xyz: [0, 120, 3], rpy: [0, -90, 0.02]}
    - {name: look, kind: revolute, parent: column, child: camera, xyz: [0, 0, 80], actuated: true, range: [-90, 90]}
masses:
  boom: {kg: 3.0, com: [10, 20, 30], in: boom}
  motor: {kg: 1.0, com: [-30, 0, 0], in: boom}
  gripper: {kg: 0.5, com: [0, 0, 40], in: tool}
"""
TILTED = """  type: graph
  bodies: [base, a, b, c, d, e, f, plate]
  flange: plate
  joints:
    - {name: j1, kind: revolute, parent: base, child: a, xyz: [1, 0, 160], axis: [0, 0.001, 1], actuated: true}
    - {name: j2, kind: revolute, parent: a, child: b, xyz: [0, 130, 0], axis: [0, 1, 0], offset: -90, actuated: true}
    - {name: j3, kind: revolute, parent: b, child: c, xyz: [0, -100, 420], axis: [0, 1, 0.002], actuated: true}
    - {name: j4, kind: revolute, parent: c, child: d, xyz: [0, 0, 390], axis: [0, -1, 0], actuated: true}
    - {name: j5, kind: revolute, parent: d, child: e, xyz: [0, 95, 0], axis: [0, 0, -1], actuated: true}
    - {name: j6, kind: revolute, parent: e, child: f, xyz: [0, 0, 95], axis: [0, 1, 0], actuated: true}
    - {name: plate, kind: fixed, parent: f, child: plate, xyz: [0, 82, 1], rpy: [-90, 0, 0.1]}
"""
EXTRA = {
    "branched": BRANCHED + MOUNTED,
    "tilted": TILTED + MOUNTED,
    "mounted": BODIES["nano"].split("frames")[0] + MOUNTED,
}
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


def machine_named(folder: Path, name: str, body: str | None = None) -> Machine:
    """Return the machine of a name, or of the text of a mechanism under that name."""
    if body is None and name in BODIES:
        return machine_of(folder, name)
    return machine_from(folder, HEAD.format(name=name) + (body or EXTRA[name]), name)


def readings_of(machine: Machine, count: int = 20, seed: int = 4) -> Array:
    """Return random readings (count, nq), mm and rad, within ranges where there are some."""
    actuators = machine.mechanism.actuators
    ends = [a.range or ((-3.0, 3.0) if a.unit == "rad" else (-200.0, 200.0)) for a in actuators]
    low, high = np.transpose(ends)
    return np.random.default_rng(seed).uniform(low, high, (count, len(low)))


def pose_of(machine: Machine, *, world: bool = False, effects: bool = False) -> Pose:
    """Tool in the base's or the sensor's frame, from the machine's own expressions, drivers at their defaults."""
    model = symbolic_model(machine, machine.effects if effects else ())
    at = ca.Function("pose", [model.q, model.z, model.p], [model.world if world else model.pose])
    return lambda q: np.array(at(q, model.z_home, model.p_home))


def tool_of(machine: Machine, file: Path, format: str) -> Pose:
    """Return where the tool is by an exported file: in the world by an MJCF, in the base by the others."""
    text = file.read_text(encoding="utf-8")
    if format == "mjcf":
        model = mujoco_module().MjModel.from_xml_path(str(file))
        return lambda q: site_pose(closed_in_mujoco(model, machine, q).site(0))
    if format == "iso230":
        table, turns = read_table(text), [a.unit == "rad" for a in machine.mechanism.actuators]
        return lambda q: table.pose(np.where(turns, np.degrees(q), q))
    if format == "ur-kinematics":
        return lambda q: ur_pose(text, q)
    chain = {"type": "urdf", "file": file.name, "base_link": "base", "tip_link": "tool"}
    document = {"schema": SCHEMA, "name": "read", "mechanism": chain}
    solver = PoseSolver(build_machine(checked_machine(file, document)))
    order = [machine.mechanism.readings.index(name) for name in solver.machine.mechanism.readings]
    return lambda q: solver.forward(q[None, order])[0][0]


def mujoco_module() -> Any:
    """Return MuJoCo, or skip the test where it is not installed."""
    return pytest.importorskip("mujoco", reason=NO_MUJOCO)


def site_pose(site: Any) -> Array:
    """Return the pose (4, 4) mm of a site in MuJoCo's world."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = site.xmat.reshape(3, 3), 1000.0 * site.xpos
    return out


def ur_pose(text: str, q: Array) -> Array:
    """Return the tool (4, 4) mm by a kinematics file of ur_description, and the tool in its comments."""
    section = yaml.safe_load(text)["kinematics"]
    at = np.eye(4)
    for link, angle in zip(LINKS, q, strict=True):
        values = [section[link][field] for field in ("x", "y", "z", "roll", "pitch", "yaw")]
        at = at @ frame(values[:3], values[3:]) @ frame([0.0, 0.0, 0.0], [0.0, 0.0, float(angle)])
    rest = re.search(
        r"^# Not held: wrist_3 to tool: x (\S+), y (\S+), z (\S+), roll (\S+), pitch (\S+), yaw (\S+)$",
        text,
        re.M,
    )
    assert rest is not None
    tool = [float(v) for v in rest.groups()]
    return at @ frame(tool[:3], tool[3:])


def frame(xyz: str | Sequence[float] | Array, rpy: str | Sequence[float] | Array) -> Array:
    """(4, 4) in mm of an origin in m and rad; roll, pitch, yaw about fixed axes."""
    position, angles = ([float(v) for v in (w.split() if isinstance(w, str) else w)] for w in (xyz, rpy))
    return plain_kinematics.frame(np.multiply(position, 1000), angles)


@dataclass
class TableReader:
    """A table as somebody reads it who has only its file: letters in the chain's order, rows, and the tool at the reference."""

    axes: list[str]
    rows: dict[str, Array]
    units: dict[str, str]
    reversed: set[str]
    reference: dict[str, float]
    centre: dict[str, Array]
    home: Array

    def pose(self, readings: Array) -> Array:
        """(4, 4) mm at readings in mm and deg, in the chain's order."""
        out = np.eye(4)
        for letter, q in zip(self.axes, readings, strict=True):
            table = self.rows[letter]
            error = np.array([np.interp(q, table[:, 0], column) for column in table[:, 1:].T])
            moved = (q - self.reference[letter]) * (-1.0 if letter in self.reversed else 1.0)
            motion, wrong = np.eye(4), np.eye(4)
            wrong[:3, 3] = error[:3] / 1000.0
            wrong[:3, :3] = Rotation.from_rotvec(error[3:] / 1e6).as_matrix()
            point, back = np.eye(4), np.eye(4)
            if self.units[letter] == "mm":
                motion["XYZ".index(letter), 3] = moved
            else:
                about = "xyz"["ABC".index(letter)]
                motion[:3, :3] = Rotation.from_euler(about, moved, degrees=True).as_matrix()
                point[:3, 3], back[:3, 3] = self.centre[letter], -self.centre[letter]
            out = out @ point @ motion @ wrong @ back
        return out @ self.home


def read_table(text: str) -> TableReader:
    """Return the reader of a table."""
    head = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# ")]
    body = "\n".join(line for line in text.splitlines() if not line.startswith("# "))
    chain = next(line for line in head if line.startswith("axes from the base"))
    told = re.findall(r"([XYZABC]) \((\w+)(, reversed)?\)", chain)
    start = next(line for line in head if line.startswith("reference:"))
    joints = {joint: float(v) for joint, v in re.findall(r"(\w+) (-?[\d.e+-]+) (?:mm|deg)", start)}
    home = np.eye(4)
    (placed,) = [line for line in head if line.startswith("T(reference)")]
    home[:3] = [[float(v) for v in row.split()] for row in placed.split(", mm: ")[1].split(";")]
    lines = [m for line in head if (m := re.match(r"axis (\w) turns about a line through (.*) mm", line))]
    centres = {m[1]: np.array([float(v) for v in m[2].split()]) for m in lines}
    axes, turned = [letter for letter, *_ in told], {letter for letter, _, way in told if way}
    rows = long_rows(body)
    units = {letter: "deg" if letter in centres else "mm" for letter in axes}
    return TableReader(axes, rows, units, turned, {a: joints[joint] for a, joint, _ in told}, centres, home)


def long_rows(body: str) -> dict[str, Array]:
    """Return positions and errors (k, 7), um and urad, by axis, of a long table."""
    rows: dict[str, list[list[float]]] = {}
    columns = [f"E{d} [um]" for d in "XYZ"] + [f"E{d} [urad]" for d in "ABC"]
    for row in csv.DictReader(io.StringIO(body)):
        assert row["unit"] == ("mm" if row["axis"] in "XYZ" else "deg")
        rows.setdefault(row["axis"], []).append([float(row[name]) for name in ("position", *columns)])
    return {letter: np.array(table) for letter, table in rows.items()}


def closed_in_mujoco(model: Any, machine: Machine, q: Array) -> Any:
    """MuJoCo's data with driven joints at readings (mm, rad) and its equality constraints met by the others."""
    mujoco = mujoco_module()
    data = mujoco.MjData(model)
    driven = []
    for actuator, value in zip(machine.mechanism.actuators, q, strict=True):
        joint = model.joint(actuator.reading)
        data.qpos[joint.qposadr[0]] = value / (1000.0 if actuator.unit == "mm" else 1.0)
        driven.append(int(joint.dofadr[0]))
    free = np.setdiff1d(np.arange(model.nv), driven)
    gap = np.array([np.inf])
    for _ in range(50):
        mujoco.mj_forward(model, data)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        slope, gap = np.array(data.efc_J).reshape(-1, model.nv)[rows][:, free], np.array(data.efc_pos)[rows]
        if np.max(np.abs(gap), initial=0.0) < 1e-13:
            break
        step = np.zeros(model.nv)
        step[free] = -np.linalg.lstsq(slope, gap, rcond=None)[0]
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    assert np.max(np.abs(gap), initial=0.0) < 1e-12
    return data


def urdf_pose(urdf: str, machine: Machine, q: Array, tip: str, root: str = "base") -> Array:
    """Forward kinematics of a URDF in m and rad by the format's definition, (4, 4) in mm; q in mm and rad."""
    readings = dict(zip(machine.mechanism.readings, q.tolist(), strict=True))
    robot = ElementTree.fromstring(urdf)
    above = {j.find("child").get("link"): j for j in robot.findall("joint")}  # type: ignore[union-attr]
    out, link = np.eye(4), tip
    while link != root:
        joint = above[link]
        origin, axis = joint.find("origin"), joint.find("axis")
        assert origin is not None
        step = frame(origin.get("xyz", ""), origin.get("rpy", ""))
        move = np.eye(4)
        if axis is not None:
            along = np.array([float(v) for v in axis.get("xyz", "").split()])
            value = readings[joint.get("name", "")]
            if joint.get("type") == "prismatic":
                move[:3, 3] = along * value
            else:
                move[:3, :3] = Rotation.from_rotvec(along * value).as_matrix()
        out = step @ move @ out
        link = joint.find("parent").get("link")  # type: ignore[union-attr, assignment]
    return out
