"""Screw theory against exact differentiation, and the wrenches against the paper's closed forms. mm, rad."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml
from scipy.spatial.transform import Rotation

from support import MACHINES, ROOT
from truepose.errors import InputError
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.joint_readings import JointColumn
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.table import Column, Table
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.units import UnitSystem

Array = npt.NDArray[np.float64]
POLISHER = ROOT / "models" / "machines" / "polisher" / "machine.yaml"
Joint = dict[str, Any]
screw_model = import_module("polisher.screws").screw_model


def joint(name: str, kind: str, parent: str, child: str, **fields: Any) -> Joint:
    return {"name": name, "kind": kind, "parent": parent, "child": child, **fields}


def ray(k: int, radius: float) -> list[float]:
    angle = 2 * np.pi * k / 3
    return [float(radius * np.cos(angle)), float(radius * np.sin(angle)), 0.0]


def tripod() -> dict[str, Any]:
    """3-RPS with a spindle: the tree reaches the platform through a driven limb, the others close on it."""
    joints = []
    for k in range(3):
        turned = [0.0, 0.0, 2 * np.pi * k / 3]
        joints += [
            joint(f"r{k}", "revolute", "base", f"cradle{k}", xyz=ray(k, 300), rpy=turned, axis=[0, 1, 0]),
            joint(f"l{k}", "prismatic", f"cradle{k}", f"rod{k}", actuated=True, range=[380, 420]),
            joint(f"m{k}", "fixed", "platform", f"eye{k}", xyz=ray(k, 120)),
            joint(f"s{k}", "spherical", f"rod{k}", f"eye{k}"),
        ]
    joints[2] = joint("m0", "fixed", "eye0", "platform", xyz=[-120.0, 0.0, 0.0])
    head = {"actuated": True, "range": [-1, 1]}
    joints.append(joint("w", "revolute", "platform", "flange", xyz=[0, 0, 60], rpy=[0.1, 0, 0], **head))
    tilt = float(-np.arcsin(180 / 400))
    home = {
        "r0": tilt,
        "r1": tilt,
        "r2": tilt,
        "s0": [0.0, -tilt, 0.0],
        "l0": 400.0,
        "l1": 400.0,
        "l2": 400.0,
    }
    return {"joints": joints, "home": home}


def universal() -> dict[str, Any]:
    """3-PUU: two universal joints a limb, one of them closing the loop; the first limb carries the platform."""
    joints = []
    for k in range(3):
        turned = [0.0, 0.0, 2 * np.pi * k / 3 + 0.2]
        upper = joint(f"v{k}", "universal", f"link{k}", f"eye{k}", xyz=[0.0, 0.0, 350.0], rpy=[0.0, 0.0, 0.4])
        joints += [
            joint(
                f"q{k}",
                "prismatic",
                "base",
                f"slider{k}",
                xyz=ray(k, 260),
                rpy=turned,
                actuated=True,
                range=[-30, 30],
            ),
            joint(f"u{k}", "universal", f"slider{k}", f"link{k}"),
            joint(f"m{k}", "fixed", "flange", f"eye{k}", xyz=ray(k, 90), rpy=[0.0, 0.0, turned[2] + 0.4]),
            upper,
        ]
    back = -0.6
    at = -np.array(ray(0, 90)) @ [
        [np.cos(back), np.sin(back), 0],
        [-np.sin(back), np.cos(back), 0],
        [0, 0, 1],
    ]
    joints[2] = joint("m0", "fixed", "eye0", "flange", xyz=at.tolist(), rpy=[0.0, 0.0, back])
    home: dict[str, Any] = {f"u{k}": [-0.11, -0.5] for k in range(3)}
    return {"joints": joints, "home": home | {"v0": [0.3, 0.4]}}


def written(mechanism: dict[str, Any]) -> str:
    """A machine file around joints: bodies in the order in which they are met, frames with errors of their own."""
    bodies = dict.fromkeys(one[end] for one in mechanism["joints"] for end in ("parent", "child"))
    order = ["base", *(body for body in bodies if body not in ("base", "flange")), "flange"]
    frame = {"xyz": 1.0, "rpy": 0.01}
    document = {
        "schema": "truepose/machine/1",
        "name": "bench",
        "units": {"length": "mm", "angle": "rad"},
        "mechanism": {"type": "graph", "bodies": order, **mechanism},
        "frames": {
            "base": {"xyz": [5, -3, 20], "rpy": [0.1, 0.2, -0.3], "tolerance": frame},
            "tool": {"in": "flange", "xyz": [10, 20, 80], "rpy": [0.2, -0.1, 0.4], "tolerance": frame},
        },
        "sensor": {"type": "pose", "sigma": {"xyz": 0.005, "rot": 1e-5}},
        "tolerances": {"length": 0.5, "angle": 0.002},
    }
    return yaml.safe_dump(document, sort_keys=False)


def load(text: str, folder: Path) -> Machine:
    path = folder / "machine.yaml"
    path.write_text(text)
    return load_machine(path)


def predictor_at(machine: Machine, q: Array) -> Predictor:
    names = machine.mechanism.readings
    cells = {name: q[:, k].tolist() for k, name in enumerate(names)}
    table = Table("random", tuple(Column(name) for name in names), cells, len(q))
    columns = [JointColumn(a.reading, a.reading_unit, a.range) for a in machine.mechanism.actuators]
    return Predictor(
        machine, read_recording([table], columns, {}, UnitSystem("mm", "rad"), need_observations=False)
    )


def random_readings(machine: Machine, count: int) -> Array:
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    low, high = ranges.T
    middle, half = (low + high) / 2, 0.25 * (high - low)
    return np.asarray(middle + half * np.random.default_rng(3).uniform(-1, 1, (count, len(ranges))))


def both(machine: Machine, count: int = 25) -> tuple[Any, Array]:
    """Screws and exact derivative of machines as built, off the drawing by their tolerances."""
    predictor = predictor_at(machine, random_readings(machine, count))
    sigma = np.array([parameter.tolerance for parameter in machine.parameters])
    sigma[~np.isfinite(sigma)] = 1.0
    p = predictor.model.p_home + sigma * np.random.default_rng(1).normal(size=len(sigma))
    x, good = predictor.assemble(p)
    assert good.all()
    return screw_model(machine, predictor.q, x, p), predictor.twists(p, x)[1]


@pytest.mark.parametrize("kind", ["polisher", "tripod", "universal", "serial"])
def test_screw_theory_is_the_derivative_of_the_closed_loops(kind: str, tmp_path: Path) -> None:
    if kind in ("tripod", "universal"):
        machine = load(written(tripod() if kind == "tripod" else universal()), tmp_path)
    else:
        machine = load_machine(POLISHER if kind == "polisher" else MACHINES / "serial.yaml")
    screws, exact = both(machine)
    # twists of 1 rad at a reach of 2 m are some 2000 mm; loops are closed to 1e-11 of it
    scale = np.maximum(np.linalg.norm(exact, axis=1, keepdims=True), 1.0)
    assert np.max(np.abs(screws.error - exact) / scale) < 1e-9


def at_home(count: int) -> tuple[Machine, Array, Any]:
    """The nominal polisher at random readings: passive coordinates and screws."""
    machine = load_machine(POLISHER)
    predictor = predictor_at(machine, random_readings(machine, count))
    x, good = predictor.assemble(predictor.model.p_home)
    assert good.all()
    return machine, x, screw_model(machine, predictor.q, x)


def assert_wrench(screws: Any, limb: str, force: Array, moment: Array) -> None:
    """That [force; moment] (n, 3) each lies in the span of a limb's wrenches."""
    wanted = np.hstack([force, moment])[:, :, None]
    spanned = screws.wrenches[limb]
    inside = spanned @ np.linalg.pinv(spanned) @ wanted
    np.testing.assert_allclose(inside, wanted, rtol=0, atol=1e-9 * np.max(np.abs(wanted)))


def turns(axis: str, angle: Array) -> Array:
    return np.asarray(Rotation.from_euler(axis, angle[:, None]).as_matrix())


def test_wrenches_are_the_papers() -> None:
    """Eq. (5): a force along each driven limb; forces through A0 across the middle limb, a torque across its joints."""
    machine, x, screws = at_home(10)
    assert list(screws.wrenches) == ["up3", "q1", "q2", "q3"]
    place = {joint.name: k for k, joint in enumerate(machine.mechanism.passive)}
    up1, up2, up3 = (x[:, place[name]] for name in ("up1", "up2", "up3"))
    values = {name: parameter.nominal for name, parameter in machine.geometry.items()}
    base = turns("y", np.array([values["base.ry"]]))[0]
    a0 = np.array([values["base.x"], values["base.y"], values["base.z"]])
    platform = base @ turns("x", up1) @ turns("y", up2)
    w1, w2, w3 = np.broadcast_to(base[:, 0], (len(x), 3)), platform[:, :, 1], platform[:, :, 2]
    tool = screws.tool[:, :3, 3]
    for force in (w2, np.cross(w2, w3)):
        assert_wrench(screws, "up3", force, np.cross(a0 - tool, force))
    assert_wrench(screws, "up3", np.zeros_like(w2), np.cross(w2, w1))
    for k in range(3):
        upper = a0 + up3[:, None] * w3 + platform @ np.array(ray(k, 135))
        along = upper - (a0 + base @ np.array(ray(k, 350)))
        force = along / np.linalg.norm(along, axis=1)[:, None]
        assert_wrench(screws, f"q{k + 1}", force, np.cross(upper - tool, force))


def test_a_drive_does_work_on_its_own_wrench_alone() -> None:
    """Eq. (3): a unit of an encoder's offset is a unit of work of its limb's unit force, and none of the others'."""
    _, _, screws = at_home(10)
    for k in range(3):
        twist = screws.error[:, :, screws.names.index(f"q{k + 1}.offset")]
        for limb, wrench in screws.wrenches.items():
            work = np.einsum("nik,ni->nk", wrench, twist)
            if limb == f"q{k + 1}":
                force = np.linalg.norm(wrench[:, :3], axis=1)
                np.testing.assert_allclose(np.abs(work / force), 1.0, rtol=1e-9)
            else:
                size = np.linalg.norm(wrench, axis=1) * np.linalg.norm(twist, axis=1)[:, None]
                assert np.max(np.abs(work) / size) < 1e-12


def test_what_is_not_made_of_serial_limbs_is_refused(tmp_path: Path) -> None:
    hexapod = load_machine(MACHINES / "ups.yaml")
    with pytest.raises(InputError, match="rods"):
        screw_model(hexapod, np.zeros((1, 6)), np.zeros((1, 6)))
    machine = load(written(tripod()), tmp_path)
    undriven = replace(machine.mechanism, actuators=machine.mechanism.actuators[:3])
    machine = replace(machine, mechanism=undriven)
    with pytest.raises(InputError, match="passive joint behind platform"):
        screw_model(machine, np.full((1, 3), 400.0), np.zeros((1, 7)))
