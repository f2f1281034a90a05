"""Kinematics against independent derivations: chains, loops, derivatives, gravity, parts from outside."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp  # type: ignore[import-untyped]
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.identification.estimate import estimate
from truepose.identification.load import load_recording
from truepose.identification.prediction import Predictor
from truepose.identification.recording import Recording
from truepose.models import lie
from truepose.models.builders.base import builders
from truepose.models.context import BuildContext
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.kinematics import symbolic_model
from truepose.models.load import load_machine
from truepose.models.machine import FRAMES, Machine
from truepose.models.mechanism import AXES, BASE, Actuator, Direction, Joint, JointKind, Mechanism, Step
from truepose.models.parameters import Parameter
from truepose.models.sensors.base import Channel, Sensor, sensors
from truepose.models.sensors.pose import Position

Array = NDArray[np.float64]

HEAD = "schema: truepose/machine/1\nname: {name}\n"
TOLERANCES = "tolerances: {length: 0.1, angle: 0.1}\n"
FRAMED = """
gravity: [0.5, -0.3, -9.80665]
frames:
  base: {in: world, xyz: [10, -20, 30], rpy: [4, -3, 25], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [5, -7, 60], rpy: [-8, 6, 12], tolerance: {xyz: 1, rpy: 1}}
"""
POSE = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.001}}\n"
MOVERS = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, range: [-150, 150]}
    - {name: q2, kind: prismatic, alpha: -90, theta: -90, d: 30, range: [-150, 150]}
    - {name: q3, kind: prismatic, beta: 2, alpha: -90, theta: -90, r: 40, range: [-150, 150]}
    - {name: q4, kind: revolute, alpha: -90, theta: -90, d: 15, range: [-40, 40]}
    - {name: q5, kind: revolute, alpha: -90, theta: -90, r: 25, range: [-40, 40]}
    - {name: q6, kind: revolute, beta: -1, alpha: -90, d: 12, r: 8, range: [-40, 40]}
masses:
  link2: {kg: 20, com: [30, 10, 5], in: link2}
  payload: {kg: 3, com: [0, 20, 10], in: tool}
"""
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 128, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, r: 6, range: [-170, 170]}
    - {name: q3, kind: revolute, beta: 0, d: -612.7, range: [-170, 170]}
    - {name: q4, kind: revolute, beta: 0.2, d: -571.6, r: 163.9, range: [-170, 170]}
    - {name: q5, kind: revolute, alpha: 90, r: 115.7, range: [-170, 170]}
    - {name: q6, kind: revolute, alpha: -90, r: 92.2, range: [-170, 170]}
masses:
  upper: {kg: 12, com: [-300, 5, 40], in: link2}
  payload: {kg: 4, com: [3, 20, 10], in: tool}
"""
ENDS = (
    ((391.3, -83.2, 2.0), (173.6, -179.9, 1.0)),
    ((391.3, 83.2, -1.0), (173.6, 179.9, -3.0)),
    ((-123.6, 380.5, 0.0), (69.0, 240.3, 0.5)),
    ((-267.7, 297.3, 3.0), (-242.6, 60.4, 2.0)),
    ((-267.7, -297.3, -2.0), (-242.6, -60.4, -1.0)),
    ((-123.6, -380.5, 1.0), (69.0, -240.3, 0.0)),
)
RAILS = ("[0, 0, 1]", "[0.1, 0, 1]", "[0, -0.2, 1]", "[1, 0.1, 0.9]", "[0, 0, 1]", "[0.1, 0.1, 1]")
CARRIED = """
tolerances: {length: 0.1, angle: 0.1, gain: 0.001}
masses:
  platform: {kg: 8, com: [10, -5, 15], in: platform}
  payload: {kg: 2, com: [50, -20, 40], in: tool}
"""
_LEG = "    - {{name: leg{k}, joint: {joint}{k}, a: {a}, b: {b}, "


def _legs(joint: str, tail: Callable[[int], str]) -> str:
    return "".join(
        _LEG.format(k=k, joint=joint, a=list(a), b=list(b)) + tail(k) + "}\n"
        for k, (a, b) in enumerate(ENDS, start=1)
    )


def _pus_leg(k: int) -> str:
    return f"u: {RAILS[k - 1]}, length: {500 + k}, offset: {0.1 * k}, range: [-60, 60]"


PUS = f"""
mechanism:
  type: 6-pus
  home: [0, 0, 440, 0, 0, 0]
  legs:
{_legs("rho", _pus_leg)}{CARRIED}"""
UPS = f"""
mechanism:
  type: 6-ups
  home: [0, 0, 440, 0, 0, 5]
  legs:
{_legs("rho", lambda k: f"offset: {k}, gain: 1.0{k}, range: [300, 700]")}{CARRIED}"""
TEXTS = {"movers": MOVERS, "arm": ARM, "pus": PUS, "ups": UPS}
SERIAL, HEXAPODS = ("movers", "arm"), ("pus", "ups")


def written(folder: Path, text: str, name: str = "m") -> Machine:
    """The machine of a text, by way of its file."""
    path = folder / f"{name}.yaml"
    tolerances = "" if "tolerances:" in text else TOLERANCES
    path.write_text(HEAD.format(name=name) + tolerances + text)
    return load_machine(path)


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    folder = tmp_path_factory.mktemp("machines")
    return {name: written(folder, FRAMED + text + POSE, name) for name, text in TEXTS.items()}


def record(machine: Machine, q: Array, readings: Mapping[str, Array] | None = None, **more: Any) -> Recording:
    """A recording of these joint readings (n, nq)."""
    n = len(q)
    rows = np.arange(n)
    plain = {"labels": {}, "drivers": {}, "files": ("f.csv",), "validation": np.zeros(n, dtype=bool)}
    return Recording(
        joints=machine.mechanism.readings,
        q=q,
        readings=readings or {},
        source_file=np.zeros(n, dtype=np.int64),
        source_row=rows + 1,
        session=np.ones(n, dtype=np.int64),
        session_recorded=np.zeros(n, dtype=bool),
        **{**plain, **more},
    )


def drawn(machine: Machine, rng: np.random.Generator, spread: float = 3.0) -> Array:
    """Parameters a few tolerances off their drawing."""
    sigma = np.array([p.tolerance for p in machine.parameters])
    nominal = np.array([p.nominal for p in machine.parameters])
    return nominal + spread * sigma * rng.uniform(-1, 1, len(sigma))


def readings(machine: Machine, rng: np.random.Generator, n: int = 4) -> Array:
    """Joint readings (n, nq) within half the ranges; of the hexapods, those of poses near home."""
    if machine.name == "ups":
        return np.array([ups_inverse(machine, *_pose(rng), nominal(machine)) for _ in range(n)])
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    out: Array = ranges.mean(axis=1) + 0.25 * np.ptp(ranges, axis=1) * rng.uniform(-1, 1, (n, len(ranges)))
    return out


def nominal(machine: Machine) -> Mapping[str, float]:
    return {p.name: p.nominal for p in machine.parameters}


def named(machine: Machine, p: Array) -> Mapping[str, float]:
    return dict(zip((q.name for q in machine.parameters), p, strict=False))


def _pose(rng: np.random.Generator) -> tuple[Array, Array]:
    """A platform pose in the base frame: position and rotation."""
    return np.array([0, 0, 440.0]) + rng.uniform(-50, 50, 3), lie.exp_so3(rng.uniform(-0.25, 0.25, 3))


def _point(c: Mapping[str, float], leg: int, end: str) -> Array:
    return np.array([c[f"leg{leg}.{end}.{axis}"] for axis in "xyz"], dtype=float)


def ups_inverse(machine: Machine, position: Array, rotation: Array, c: Mapping[str, float]) -> Array:
    """Readings of a 6-UPS at a pose: distances of the leg ends."""
    out = []
    for leg in range(1, 7):
        distance = np.linalg.norm(position + rotation @ _point(c, leg, "b") - _point(c, leg, "a"))
        out.append((distance - c[f"leg{leg}.offset"]) / c[f"leg{leg}.gain"])
    return np.array(out)


def rail(machine: Machine, leg: int, c: Mapping[str, float]) -> Array:
    joint = next(j for j in machine.mechanism.joints if j.name == f"rho{leg}")
    assert isinstance(joint.axis, Direction)
    parts = [np.nan if name is None else c[name] for name in joint.axis.components]
    third = joint.axis.sign * np.sqrt(1 - np.nansum(np.square(parts)))
    return np.where(np.isnan(parts), third, parts)


def pus_inverse(machine: Machine, position: Array, rotation: Array, c: Mapping[str, float]) -> Array:
    """Readings of a 6-PUS at a pose, in closed form: the lower end of a leg on its rail, the lower of two."""
    out = []
    for leg in range(1, 7):
        u = rail(machine, leg, c)
        d = position + rotation @ _point(c, leg, "b") - _point(c, leg, "a")
        along = u @ d
        slide = along - np.sqrt(c[f"leg{leg}.length"] ** 2 - d @ d + along**2)
        out.append((slide - c[f"leg{leg}.offset"]) / c[f"leg{leg}.gain"])
    return np.array(out)


INVERSE = {"pus": pus_inverse, "ups": ups_inverse}


def base_to_flange(machine: Machine, world: Array, c: Mapping[str, float]) -> Array:
    """(n, 4, 4) flange in the base frame, out of the sensor's view of the tool."""

    def frame(name: str) -> Array:
        out = np.eye(4)
        out[:3, 3] = [c[f"{name}.{axis}"] for axis in "xyz"]
        out[:3, :3] = lie.rpy_matrix(np.array([c[f"{name}.r{axis}"] for axis in "xyz"]))
        return out

    out: Array = lie.inverse_pose(frame("base")) @ world @ lie.inverse_pose(frame("tool"))
    return out


def twist(a: Array, b: Array, step: float) -> Array:
    """(n, 6) twist per unit from poses a to b, ``step`` apart."""
    turn = lie.log_so3(b[:, :3, :3] @ np.swapaxes(a[:, :3, :3], 1, 2))
    return np.hstack([b[:, :3, 3] - a[:, :3, 3], turn]) / step


# ----------------------------------------------------------------------------------------- chains


@cache
def _khalil() -> Callable[..., Array]:
    """One row of the table as SymPy multiplies it out."""
    beta, alpha, d, theta, r = symbols = sp.symbols("beta alpha d theta r")

    def turn(axis: int, angle: sp.Symbol) -> sp.Matrix:
        plain = {0: sp.rot_ccw_axis1, 1: sp.rot_ccw_axis2, 2: sp.rot_ccw_axis3}[axis](angle)
        return sp.Matrix(sp.BlockDiagMatrix(plain, sp.eye(1)))

    def shift(x: sp.Symbol | int, z: sp.Symbol | int) -> sp.Matrix:
        out = sp.eye(4)
        out[0, 3], out[2, 3] = x, z
        return out

    product = turn(1, beta) * turn(0, alpha) * shift(d, 0) * turn(2, theta) * shift(0, r)
    out: Callable[..., Array] = sp.lambdify(symbols, product)
    return out


def chain(machine: Machine, q: Array, c: Mapping[str, float]) -> list[Array]:
    """Poses of the links of a serial chain at one configuration."""
    links, here = [], np.eye(4)
    for joint, reading in zip(machine.mechanism.joints, q, strict=True):
        row = {key: c[f"{joint.name}.{key}"] for key in ("beta", "alpha", "d", "theta", "r")}
        row["theta" if joint.kind == "revolute" else "r"] += reading
        here = here @ _khalil()(*row.values())
        links.append(here)
    return links


@pytest.mark.parametrize("name", SERIAL)
def test_a_chain_is_the_product_of_its_rows(machines: Mapping[str, Machine], name: str) -> None:
    machine, rng = machines[name], np.random.default_rng(1)
    q, p = readings(machine, rng), drawn(machine, rng)
    c = named(machine, p)
    world, good = Predictor(machine, record(machine, q)).poses(p)
    assert good.all()
    expected = [chain(machine, row, c)[-1] for row in q]
    np.testing.assert_allclose(base_to_flange(machine, world, c), expected, atol=1e-9)


@pytest.mark.parametrize("tilt", [1e-2, 1e-5, 1e-8])
@pytest.mark.parametrize("towards", np.linspace(0.0, 6.0, 7))
def test_any_small_tilt_of_parallel_axes_is_a_small_change(
    machines: Mapping[str, Machine], tilt: float, towards: float
) -> None:
    """Hayati: without beta, a tilt about y would turn theta by a right angle at once."""
    machine = machines["arm"]
    axis = np.array([np.sin(tilt) * np.cos(towards), np.sin(tilt) * np.sin(towards), np.cos(tilt)])
    c = dict(nominal(machine))
    before = chain(machine, np.zeros(6), c)
    c["q3.beta"], c["q3.alpha"] = float(np.arctan2(axis[0], axis[2])), float(np.arcsin(-axis[1]))
    assert np.hypot(c["q3.beta"], c["q3.alpha"]) < 1.01 * tilt
    world, _ = Predictor(machine, record(machine, np.zeros((1, 6)))).poses(np.array(list(c.values())))
    links = chain(machine, np.zeros(6), c)
    np.testing.assert_allclose(base_to_flange(machine, world, c)[0], links[-1], atol=1e-9)
    np.testing.assert_allclose(links[1][:3, :3].T @ links[2][:3, 2], axis, atol=1e-12)
    assert np.linalg.norm(links[2][:3, 3] - before[2][:3, 3]) < 1000 * tilt


# ----------------------------------------------------------------------------------------- loops


@pytest.mark.parametrize("name", HEXAPODS)
def test_forward_undoes_the_closed_inverse(machines: Mapping[str, Machine], name: str) -> None:
    machine, rng = machines[name], np.random.default_rng(2)
    p = drawn(machine, rng)
    c = named(machine, p)
    placed = [_pose(rng) for _ in range(60)]
    q = np.array([INVERSE[name](machine, *pose, c) for pose in placed])
    world, good = Predictor(machine, record(machine, q)).poses(p)
    assert good.all()
    found = base_to_flange(machine, world, c)
    np.testing.assert_allclose(found[:, :3, 3], [position for position, _ in placed], atol=1e-7)
    np.testing.assert_allclose(found[:, :3, :3], [rotation for _, rotation in placed], atol=1e-9)


@pytest.mark.parametrize("name", HEXAPODS)
def test_legs_have_their_lengths_after_the_forward_solution(
    machines: Mapping[str, Machine], name: str
) -> None:
    machine, rng = machines[name], np.random.default_rng(3)
    p = drawn(machine, rng)
    c, q = named(machine, p), readings(machine, rng, 20)
    world, good = Predictor(machine, record(machine, q)).poses(p)
    assert good.all()
    for row, pose in zip(q, base_to_flange(machine, world, c), strict=True):
        for leg, reading in enumerate(row, start=1):
            upper = pose[:3, 3] + pose[:3, :3] @ _point(c, leg, "b")
            moved = c[f"leg{leg}.offset"] + c[f"leg{leg}.gain"] * reading
            slide = moved * rail(machine, leg, c) if name == "pus" else 0.0
            length = c[f"leg{leg}.length"] if name == "pus" else moved
            assert np.linalg.norm(upper - _point(c, leg, "a") - slide) == pytest.approx(length, abs=1e-8)


def test_what_cannot_be_assembled_is_told(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["ups"], np.random.default_rng(4)
    q = readings(machine, rng, 3)
    q[1, 0] = 5000.0
    _, good = Predictor(machine, record(machine, q)).poses(np.array(list(nominal(machine).values())))
    assert good.tolist() == [True, False, True]


SLOPE = 0.2
LINKS = {"crank": 40.0, "coupler": 110.0, "rocker": 80.0, "ground": 100.0}


def turned(angle: float, length: float) -> Array:
    return length * np.array([np.cos(angle), np.sin(angle), 0.0])


def four_bar(crank: float) -> Array:
    """Joint between coupler and rocker, above the line between the two pivots it hangs on."""
    a, o = turned(crank, LINKS["crank"]), np.array([LINKS["ground"], 0.0, 0.0])
    r, s, line = LINKS["coupler"], LINKS["rocker"], o - a
    d = float(np.linalg.norm(line))
    along = (r**2 - s**2 + d**2) / (2 * d)
    left = np.array([-line[1], line[0], 0.0]) / d
    out: Array = a + along * line / d + np.sqrt(r**2 - along**2) * left
    return out


def slider(crank: float, slope: float = 0.0) -> Array:
    """Block at the end of the coupler, on a rail through the origin."""
    rail, end = turned(np.arcsin(slope), 1.0), turned(crank, LINKS["crank"])
    out: Array = (rail @ end + np.sqrt(LINKS["coupler"] ** 2 - end @ end + (rail @ end) ** 2)) * rail
    return out


def planar(joints: list[Joint], flange: str) -> Machine:
    """A planar linkage, crank driven, seen by its flange's position."""
    parameters = tuple(Parameter(name, "mm", length) for name, length in LINKS.items())
    parameters += (Parameter("rail.y", "1", SLOPE), Parameter("rail.z", "1", 0.0))
    frames = tuple(Parameter(f"{f}.{a}", "rad" if a[0] == "r" else "mm", 0.0) for f in FRAMES for a in AXES)
    mechanism = Mechanism(parameters, tuple(joints), (Actuator("q", "j1", "rad", "rad"),), flange)
    return Machine("linkage", mechanism, frames, (Position(0.01),))


def along(name: str) -> tuple[Step, ...]:
    return (Step("tx", name),)


def open_chain() -> list[Joint]:
    crank = Joint("j1", "revolute", BASE, "crank")
    return [crank, Joint("j2", "revolute", "crank", "coupler", along("crank"), home=(0.5,))]


def with_rocker(kind: JointKind) -> Machine:
    """Closed between coupler and rocker by a joint that allows at least a turn about z."""
    rocker = Joint("j3", "revolute", BASE, "rocker", along("ground"), home=(1.5,))
    end = Joint("end", "fixed", "rocker", "rocker end", along("rocker"))
    axis = (0.0, 0.0, 1.0)
    turned_in = Joint("lay", "fixed", "coupler", "tip", along("coupler"))
    return planar(
        [*open_chain(), rocker, end, turned_in, Joint("j4", kind, "tip", "rocker end", (), axis)],
        "rocker end",
    )


def with_foot() -> Machine:
    """Three passive joints in a row, the last body fixed to the ground: a loop closed by a fixed joint."""
    rocker = Joint("j3", "revolute", "coupler", "rocker", along("coupler"), home=(-1.5,))
    foot = Joint("j4", "revolute", "rocker", "foot", along("rocker"), home=(0.5,))
    ground = Joint("ground", "fixed", BASE, "ground", along("ground"))
    return planar([*open_chain(), rocker, foot, ground, Joint("j5", "fixed", "foot", "ground")], "rocker")


def with_slider(axis: tuple[float, float, float] | Direction) -> Machine:
    """A block at the end of the coupler that slides along a rail."""
    block = Joint("j3", "revolute", "coupler", "block", along("coupler"), home=(-0.5,))
    return planar([*open_chain(), block, Joint("j4", "prismatic", "block", BASE, (), axis)], "block")


def universal() -> Machine:
    """The closing cross turns about x, then y: the linkage stands in the plane of x and z instead."""
    flat = with_rocker("universal")
    upright = [
        replace(j, axis=(0.0, -1.0, 0.0)) if j.kind == "revolute" else j for j in flat.mechanism.joints
    ]
    return replace(flat, mechanism=replace(flat.mechanism, joints=tuple(upright)))


LINKAGES: Mapping[str, tuple[Callable[[], Machine], Callable[[float], Array]]] = {
    "revolute": (lambda: with_rocker("revolute"), four_bar),
    "spherical": (lambda: with_rocker("spherical"), four_bar),
    "universal": (universal, lambda crank: four_bar(crank)[[0, 2, 1]]),
    "fixed": (with_foot, four_bar),
    "prismatic": (lambda: with_slider((1.0, 0.0, 0.0)), slider),
    "prismatic, slanted": (
        lambda: with_slider(Direction((None, "rail.y", "rail.z"))),
        lambda crank: slider(crank, SLOPE),
    ),
}


@pytest.mark.parametrize("kind", LINKAGES)
def test_linkages_close_whatever_joint_closes_them(kind: str) -> None:
    build, expected = LINKAGES[kind]
    machine = build()
    cranks = np.linspace(-1.2, 1.2, 9)
    predictor = Predictor(machine, record(machine, cranks[:, None]))
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    assert good.all()
    model = predictor.model
    closure = ca.Function("closure", [model.x, model.q, model.z, model.p], [model.closure])
    gaps = [closure(here, [crank], [], p).full() for here, crank in zip(x, cranks, strict=True)]
    np.testing.assert_allclose(gaps, 0.0, atol=1e-9)
    world, _ = predictor.poses(p, x)
    np.testing.assert_allclose(world[:, :3, 3], [expected(crank) for crank in cranks], atol=1e-8)


@pytest.mark.parametrize("kind", LINKAGES)
def test_linkages_follow_their_lengths(kind: str) -> None:
    build, expected = LINKAGES[kind]
    machine = build()
    predictor = Predictor(machine, record(machine, np.array([[0.4], [-0.7]])))
    p = predictor.model.p_home
    _, slopes = predictor.twists(p, predictor.assemble(p)[0])
    for k, name in enumerate(LINKS):
        before, moved = LINKS[name], []
        for step in (-1e-4, 1e-4):
            LINKS[name] = before + step
            moved.append(np.array([expected(0.4), expected(-0.7)]))
        LINKS[name] = before
        np.testing.assert_allclose(slopes[:, :3, k], (moved[1] - moved[0]) / 2e-4, atol=1e-6)


# ----------------------------------------------------------------------------------------- derivatives


@pytest.mark.parametrize("name", TEXTS)
def test_twists_by_every_parameter_and_port(machines: Mapping[str, Machine], name: str) -> None:
    """Implicit derivatives against differences of poses solved anew."""
    machine, rng = machines[name], np.random.default_rng(5)
    predictor = Predictor(machine, record(machine, readings(machine, rng, 3)), ports=True)
    p = predictor.model.p_home.copy()
    p[: len(machine.parameters)] = drawn(machine, rng)
    x, good = predictor.assemble(p)
    assert good.all()
    _, exact = predictor.twists(p, x)
    units = {q.name: q.unit for q in machine.parameters}
    units |= {actuator.displacement: actuator.unit for actuator in machine.mechanism.actuators}
    for k, port in enumerate(predictor.model.names):
        turns = port.rsplit(".", 1)[-1].startswith("r")
        step = 1e-2 if units.get(port, "rad" if turns else "mm") == "mm" else 1e-5
        ends = []
        for sign in (-1, 1):
            moved = p.copy()
            moved[k] += sign * step
            ends.append(predictor.poses(moved, predictor.assemble(moved, x)[0])[0])
        slope = twist(ends[0], ends[1], 2 * step)
        scale = 1.0 + np.abs(slope).max()
        np.testing.assert_allclose(exact[:, :, k], slope, atol=3e-7 * scale, err_msg=port)


SENSORS = {
    "pose": "{type: pose, sigma: {xyz: 0.01, rot: 0.001}}",
    "position": "{type: position, sigma: {xyz: 0.02}}",
    "targets": "{type: targets, points: {P1: [1, 2, 3], P2: [40, 0, 5], P3: [0, 50, -6]}, "
    "sigma: {xyz: 0.01}}",
    "distance": "{type: distance, beam: {xyz: [1, 900, 3], rx: 91, rz: 4}, "
    "mirror: {in: tool, z: 2, rx: 3, ry: -4}, sigma: {distance: 0.001}}",
}


@pytest.mark.parametrize("sensor", SENSORS)
def test_sensor_residuals_by_every_parameter(tmp_path: Path, sensor: str) -> None:
    machine = written(tmp_path, FRAMED + MOVERS + f"sensor: {SENSORS[sensor]}\n")
    rng = np.random.default_rng(6)
    q, columns = readings(machine, rng, 4), machine.sensors[0].columns
    read = {column: rng.uniform(-1, 1, 4) for column in columns}
    predictor = Predictor(machine, record(machine, q, read, from_row=np.array([0, 0, 1, 1])))
    p = drawn(machine, rng)
    x, _ = predictor.assemble(p)

    def residual(at: Array) -> Array:
        return np.concatenate([block.residual for block in predictor.blocks(at, x)])

    exact = np.concatenate([block.jacobian for block in predictor.blocks(p, x)])
    assert exact.shape == (4, len(machine.sensors[0].channels), len(p))
    for k, parameter in enumerate(machine.parameters):
        step = 1e-3 if parameter.unit == "mm" else 1e-6
        ends = [residual(p + sign * step * np.eye(len(p))[k]) for sign in (-1, 1)]
        slope = (ends[1] - ends[0]) / (2 * step)
        scale = 1.0 + np.abs(slope).max()
        np.testing.assert_allclose(exact[:, :, k], slope, atol=1e-6 * scale, err_msg=parameter.name)


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_reading_that_is_the_prediction_leaves_nothing(tmp_path: Path, sensor: str) -> None:
    machine = written(tmp_path, FRAMED + ARM + f"sensor: {SENSORS[sensor]}\n")
    rng = np.random.default_rng(7)
    q, p, before = readings(machine, rng, 6), drawn(machine, rng), np.array([0, 0, 1, 1, 3, 2])
    predictor = Predictor(machine, record(machine, q, from_row=before))
    names, values, _, _ = predictor.columns(p, predictor.assemble(p)[0])
    read = dict(zip(names, values.T, strict=True))
    again = Predictor(machine, record(machine, q, read, from_row=before))
    for block in again.blocks(p, again.assemble(p)[0]):
        np.testing.assert_allclose(block.residual, 0.0, atol=1e-6)


def test_a_cavity_is_as_long_as_from_its_source_to_the_mirror(tmp_path: Path) -> None:
    """Against a plane and a line intersected by hand."""
    machine = written(tmp_path, FRAMED + MOVERS + f"sensor: {SENSORS['distance']}\n")
    rng = np.random.default_rng(8)
    q, p = readings(machine, rng, 3), drawn(machine, rng)
    c = named(machine, p)
    predictor = Predictor(machine, record(machine, q, from_row=np.zeros(3, dtype=int)))
    _, values, _, world = predictor.columns(p, predictor.assemble(p)[0])
    source = np.array([c["beam.x"], c["beam.y"], c["beam.z"]])
    light = lie.rpy_matrix(np.array([c["beam.rx"], 0, 0]))[:, 2]
    lengths = []
    for pose in world:
        plane = (
            pose[:3, :3]
            @ lie.rpy_matrix(np.array([c["mirror.rx"], 0, 0]))
            @ lie.rpy_matrix(np.array([0, c["mirror.ry"], 0]))
        )
        centre = pose[:3, 3] + pose[:3, 2] * c["mirror.z"]
        spans = np.column_stack([light, -plane[:, 0], -plane[:, 1]])
        lengths.append(np.linalg.solve(spans, centre - source)[0])
    np.testing.assert_allclose(values[:, 0], np.array(lengths) - lengths[0], atol=1e-8)


def test_a_mirror_in_the_flange_does_not_see_the_tool(tmp_path: Path) -> None:
    text = MOVERS + f"sensor: {SENSORS['distance'].replace('in: tool', 'in: flange')}\n"
    (tmp_path / "bare").mkdir()
    bare, tooled = written(tmp_path / "bare", text), written(tmp_path, FRAMED + text)
    assert tooled.geometry["tool.x"].nominal != 0.0
    q = readings(bare, np.random.default_rng(3), 4)
    read = {"dL": np.zeros(4)}
    seen = []
    for machine in (bare, tooled):
        base = {f"base.{axis}": bare.geometry[f"base.{axis}"].nominal for axis in AXES}
        predictor = Predictor(machine, record(machine, q, read, from_row=np.zeros(4, dtype=int)))
        pairs = zip(predictor.model.names, predictor.model.p_home, strict=True)
        p = np.array([base.get(name, value) for name, value in pairs])
        _, values, jacobian, _ = predictor.columns(p, predictor.assemble(p)[0])
        at = [predictor.model.names.index(f"tool.{axis}") for axis in AXES]
        np.testing.assert_allclose(jacobian[..., at], 0.0, atol=1e-9)
        seen.append(values)
    np.testing.assert_allclose(seen[1], seen[0], atol=1e-9)


# ----------------------------------------------------------------------------------------- gravity


def _potential(machine: Machine, q: Array, c: Mapping[str, float]) -> float:
    """N m of a serial chain's masses, from SymPy's chain."""
    links = chain(machine, q, c)
    tool = np.eye(4)
    tool[:3, 3] = [c[f"tool.{axis}"] for axis in "xyz"]
    tool[:3, :3] = lie.rpy_matrix(np.array([c[f"tool.r{axis}"] for axis in "xyz"]))
    frames = {f"link{k}": link for k, link in enumerate(links, start=1)} | {"tool": links[-1] @ tool}
    weights = ((m.kg * np.array(machine.gravity), frames[m.body] @ [*m.com, 1.0]) for m in machine.masses)
    return -sum(float(weight @ at[:3]) for weight, at in weights) / 1000


@pytest.mark.parametrize("name", SERIAL)
def test_loads_of_serial_joints_are_slopes_of_the_potential(
    machines: Mapping[str, Machine], name: str
) -> None:
    machine, rng = machines[name], np.random.default_rng(9)
    q, p = readings(machine, rng, 3), drawn(machine, rng)
    c = named(machine, p)
    predictor = Predictor(machine, record(machine, q), ports=True)
    full = predictor.model.p_home.copy()
    full[: len(p)] = p
    loads = predictor.loads(full, predictor.assemble(full)[0])
    for row, reading in enumerate(q):
        for k, actuator in enumerate(machine.mechanism.actuators):
            step = (1e-4 if actuator.unit == "rad" else 1e-1) * np.eye(len(reading))[k]
            ends = [_potential(machine, reading + sign * step, c) for sign in (-1, 1)]
            slope = -(ends[1] - ends[0]) / (2 * step[k])
            expected = slope if actuator.unit == "rad" else 1000 * slope  # N m per mm to N
            assert loads[actuator.displacement][row] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def _tensions(machine: Machine, flange: Array, tool: Array, c: Mapping[str, float]) -> Array:
    """Leg forces of a 6-UPS that balance the weight's wrench, N, positive in tension."""
    upper = [flange[:3, 3] + flange[:3, :3] @ _point(c, leg, "b") for leg in range(1, 7)]
    pulls = [_point(c, leg, "a") - b for leg, b in enumerate(upper, start=1)]
    columns = [np.hstack([f, np.cross(b, f)]) / np.linalg.norm(f) for f, b in zip(pulls, upper, strict=True)]
    weight = np.zeros(6)
    for mass in machine.masses:
        frame = tool if mass.body == "tool" else flange
        at = frame[:3, 3] + frame[:3, :3] @ mass.com
        force = mass.kg * np.array(machine.gravity)
        weight += np.hstack([force, np.cross(at, force)])
    return np.linalg.solve(np.column_stack(columns), -weight)


def test_leg_forces_balance_the_wrench_of_the_weight(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["ups"], np.random.default_rng(10)
    p, q = drawn(machine, rng), readings(machine, rng, 4)
    c = named(machine, p)
    predictor = Predictor(machine, record(machine, q), ports=True)
    full = np.concatenate([p, np.zeros(len(predictor.model.names) - len(p))])
    loads = predictor.loads(full, predictor.assemble(full)[0])
    world, _ = predictor.poses(full)
    flange = base_to_flange(machine, world, c)
    base = base_to_flange(machine, np.eye(4)[None], {**c, **{f"tool.{axis}": 0.0 for axis in AXES}})[0]
    expected = [_tensions(machine, f, base @ w, c) for f, w in zip(flange, world, strict=True)]
    found = np.column_stack([loads[a.displacement] for a in machine.mechanism.actuators])
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-7)


@pytest.mark.parametrize("kg", [1.0, 2000.0])
def test_soft_legs_stand_in_balance(machines: Mapping[str, Machine], kg: float) -> None:
    """Where legs give way, the unknown forces are those that hold the platform as it then stands."""
    machine, c = machines["ups"], 1e-4
    heavy = replace(machine, masses=tuple(replace(m, kg=m.kg * kg) for m in machine.masses))
    effect = effects.get("leg-compliance", "test")()
    legs = tuple(limb.name for limb in heavy.mechanism.limbs)
    placed = PlacedEffect.at(effect, heavy, legs, {}, {"c": c})
    rng = np.random.default_rng(11)
    q = readings(heavy, rng, 2)
    predictor = Predictor(heavy, record(heavy, q), [placed])
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    assert good.all()
    world, _ = predictor.poses(p, x)
    values = nominal(heavy)
    flange = base_to_flange(heavy, world, values)
    base = base_to_flange(heavy, np.eye(4)[None], {**values, **{f"tool.{axis}": 0.0 for axis in AXES}})[0]
    tension = np.array([_tensions(heavy, f, base @ w, values) for f, w in zip(flange, world, strict=True)])
    np.testing.assert_allclose(x[:, -6:], tension, rtol=1e-4 * kg**0.5, atol=1e-3)
    grown = np.array([ups_inverse(heavy, f[:3, 3], f[:3, :3], values) for f in flange]) - q
    gains = np.array([values[f"leg{k}.gain"] for k in range(1, 7)])
    np.testing.assert_allclose(grown * gains, c * x[:, -6:], rtol=1e-3 * kg**0.5, atol=1e-7)


def test_shifted_parameters_move_the_base_too(machines: Mapping[str, Machine]) -> None:
    """A shift at base.x is seen like any other."""
    machine, rng = machines["movers"], np.random.default_rng(12)
    wrong = PlacedEffect.at(effects.get("wrong-constant", "test")(), machine, ("base.x",), {}, {"value": 3.0})
    q = readings(machine, rng, 2)
    world, shifted = (
        Predictor(machine, record(machine, q), placed).poses(symbolic_model(machine, placed).p_home)[0]
        for placed in ((), (wrong,))
    )
    np.testing.assert_allclose(shifted[:, :3, 3] - world[:, :3, 3], [[3.0, 0.0, 0.0]] * 2, atol=1e-9)


# ----------------------------------------------------------------------------------------- from outside


@pytest.fixture
def additions() -> Iterator[None]:
    """A gantry and a dial gauge, known by name for one test."""

    @builders.add("gantry")
    def gantry(section: Mapping[str, Any], context: BuildContext) -> Mechanism:
        axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        bodies = (BASE, "x", "y", "z")
        tilts = tuple(context.parameter(f"{b}.tilt", "rad", 0.0, ("tilt", b)) for b in bodies[1:])
        joints = tuple(
            Joint(f"s{k}", "prismatic", a, b, (Step(f"r{'yxz'[k]}", f"{b}.tilt"),), axes[k])
            for k, (a, b) in enumerate(pairwise(bodies))
        )
        return Mechanism(tilts, joints, tuple(Actuator(j.name, j.name, "mm", "mm") for j in joints), "z")

    @sensors.add("dial")
    @dataclass(frozen=True)
    class Dial(Sensor):
        zero: Parameter
        type = "dial"
        columns = {"height": "mm"}  # noqa: RUF012
        channels = (Channel("height", "mm", 1e-3, "distance", "tip"),)
        parameters = property(lambda self: (self.zero,))

        @classmethod
        def build(cls, section: Mapping[str, Any], context: BuildContext) -> Dial:
            return cls(context.parameter("zero", "mm", 0.0, ("zero",), "sensor", 10.0))

        def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
            return world[2, 3] - s["zero"]

    yield
    builders.discard("gantry")
    sensors.discard("dial")


@pytest.mark.usefixtures("additions")
def test_a_builder_and_a_sensor_from_outside_need_no_other_edit(tmp_path: Path) -> None:
    machine = written(tmp_path, "mechanism: {type: gantry}\nsensor: {type: dial}\n")
    rng = np.random.default_rng(12)
    q, truth = rng.uniform(-300, 300, (40, 3)), np.array([1e-3, -2e-3, 0.0, *np.zeros(12), 0.7])
    assert [p.name for p in machine.parameters][-1] == "zero"
    predictor = Predictor(machine, record(machine, q))
    _, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    read = machine.sensors[0].noisy(values, rng)[:, 0]
    fit = estimate(machine, record(machine, q, {"height": read}))
    off = (fit.p - truth)[fit.prior.free] / fit.std[fit.prior.free]
    assert np.abs(off).max() < 4.0
    assert fit.chi2_per_dof < 2.0


def test_what_was_discarded_is_unknown(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="gantry"):
        written(tmp_path, "mechanism: {type: gantry}\n" + POSE)


# ---------------------------------------------------------------------------------------- what files may say


def effect_entry(slug: str, *places: str) -> str:
    return f"effects:\n  - {{effect: {slug}, place: [{', '.join(places)}], parameters: {{}}}}\n"


@pytest.mark.parametrize(
    ("slug", "named_place", "meant"),
    [
        ("actuator-scale", "leg2", "rho2"),
        ("actuator-scale", "rho2", "rho2"),
        ("leg-compliance", "rho3", "leg3"),
        ("leg-compliance", "leg3", "leg3"),
        ("leg-compliance", "leg1, rho3", "leg1+leg3"),
        ("axis-coupling", "leg1, rho3", "rho1+rho3"),
        ("wrong-constant", "leg4.a.x", "leg4.a.x"),
    ],
)
def test_a_limb_and_its_actuator_are_one_place(
    tmp_path: Path, slug: str, named_place: str, meant: str
) -> None:
    machine = written(tmp_path, FRAMED + PUS + POSE + effect_entry(slug, named_place))
    (placed,) = machine.effects
    assert "+".join(placed.place) == meant
    assert (
        Predictor(machine, record(machine, np.zeros((1, 6))), machine.effects)
        .poses(symbolic_model(machine, machine.effects).p_home)[1]
        .all()
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (effect_entry("actuator-scale", "rho9"), r"effects\[0\]\.place: found \['rho9'\]"),
        (
            effect_entry("zero-shift", "rho1", "rho2", "rho3"),
            r"effects\[0\]\.place: found \['rho1', 'rho2', 'rho3'\]",
        ),
        (effect_entry("axis-coupling", "rho1"), r"effects\[0\]\.place: found \['rho1'\]"),
    ],
)
def test_places_nobody_knows_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        written(tmp_path, FRAMED + PUS + POSE + text)


def test_a_tolerance_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"tolerances\.leg1\.lenght: no such parameter.*'leg1\.length'"):
        written(tmp_path, PUS.replace("gain: 0.001", "leg1.lenght: 0.5") + POSE)


def test_a_tolerance_of_a_frame_may_stand_with_the_others(tmp_path: Path) -> None:
    machine = written(tmp_path, FRAMED + PUS.replace("gain: 0.001", "base.xyz: 7, tool.rx: 2") + POSE)
    assert [machine.geometry[f"base.{axis}"].tolerance for axis in AXES[:4]] == [7.0] * 3 + [np.radians(1.0)]
    assert machine.geometry["tool.rx"].tolerance == pytest.approx(np.radians(2.0))


@pytest.mark.parametrize(("body", "known"), [("flange", True), ("link3", True), ("lnik3", False)])
def test_masses_hang_on_bodies_there_are(tmp_path: Path, body: str, known: bool) -> None:
    text = ARM.replace("in: link2", f"in: {body}") + POSE
    if known:
        assert written(tmp_path, text).masses[0].body == {"flange": "link6"}.get(body, body)
        return
    with pytest.raises(InputError, match=r"masses\.upper\.in: found 'lnik3'.*'link3'"):
        written(tmp_path, text)


def test_changes_need_the_row_they_start_from(tmp_path: Path) -> None:
    machine = written(tmp_path, MOVERS + f"sensor: {SENSORS['distance']}\n")
    path = tmp_path / "r.csv"
    path.write_text(",".join([*machine.mechanism.readings, "dL"]) + "\n" + "0,0,0,0,0,0,0\n")
    with pytest.raises(InputError, match=r"r\.csv.*'?from'?"):
        load_recording(machine, [path])
    assert len(load_recording(machine, [path], need_readings=False)) == 1


def test_a_change_from_a_row_that_is_gone_is_refused(tmp_path: Path) -> None:
    """A subset keeps meaning the same rows, and says so when one of them is not there."""
    machine = written(tmp_path, MOVERS + f"sensor: {SENSORS['distance']}\n")
    q = readings(machine, np.random.default_rng(13), 4)
    recording = record(machine, q, {"dL": np.zeros(4)}, from_row=np.array([0, 0, 1, 1]))
    p = np.array(list(nominal(machine).values()))

    def changes(rows: list[int]) -> Array:
        predictor = Predictor(machine, recording.subset(rows))
        return predictor.columns(p, predictor.assemble(p)[0])[1][:, 0]

    np.testing.assert_allclose(changes([3, 1, 0, 2]), changes([0, 1, 2, 3])[[3, 1, 0, 2]])
    with pytest.raises(InputError, match=r"f\.csv: row 4.*'from'"):
        changes([0, 3])
