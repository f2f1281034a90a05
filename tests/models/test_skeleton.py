"""Laws of a machine's lines: they end where the kinematic model ends, are as long as its parts, and move as these do."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import truepose.models
from support.effect_machines import READINGS, TEXTS
from support.effect_machines import read_machines as effect_machines
from support.examples import examples
from support.moving_machines import HEXAPODS, SERIAL, record
from support.moving_machines import read_machines as moving_machines
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.file.machine_file import checked_machine
from truepose.models.file.yaml_document import parse_document
from truepose.models.leaves.starting.start import bundled_names, bundled_start
from truepose.models.leaves.starting.written import Asked, written
from truepose.models.load import build_machine, load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.machine.skeleton import Piece, Skeleton, at_home, skeleton

Array = NDArray[np.float64]
BUNDLED = ("telescope", "nanopositioner", "polisher")
MOVING = (*SERIAL, *HEXAPODS)
NAMES = (*TEXTS, *(f"moving {name}" for name in MOVING), *BUNDLED)
LEGGED = ("gough", "planar", *(f"moving {name}" for name in HEXAPODS))
SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    base = tmp_path_factory.getbasetemp()
    out = dict(effect_machines(base / "drawn effects"))
    out |= {f"moving {k}": m for k, m in moving_machines(base / "drawn moving").items()}
    folder = Path(truepose.models.__path__[0]) / "machines"
    return out | {name: load_machine(folder / name / "machine.yaml") for name in BUNDLED}


@cache
def library(name: str) -> Machine:
    path = Path(f"{name}.yaml")
    text = written(bundled_start(name), Asked()).machine_text
    return build_machine(checked_machine(path, parse_document(text, path)))


def posed(machine: Machine, q: Array) -> Recording:
    """Each row its own origin, for sensors that read changes."""
    return record(machine, q, from_row=np.arange(len(q)))


def somewhere(
    machine: Machine, name: str, rng: np.random.Generator, rows: int = 4
) -> tuple[Array, Array, Array]:
    """Readings (n, nq), passive coordinates (n, nx) that close the loops, and parameters (np,) off their drawing."""
    home = np.array(READINGS[name]) if name in READINGS else symbolic_model(machine).q_home
    spans = np.array([np.ptp(a.range) if a.range else 1.0 for a in machine.mechanism.actuators])
    q = home + 0.02 * spans * rng.uniform(-1, 1, (rows, len(home)))
    nominal = np.array([p.nominal for p in machine.parameters])
    sigma = np.array([p.tolerance if np.isfinite(p.tolerance) else 0.0 for p in machine.parameters])
    p = nominal + 0.3 * sigma * rng.uniform(-1, 1, len(nominal))
    x, good = Predictor(machine, posed(machine, q)).assemble(p)
    assert good.all()
    return q, x, p


def points_of(lines: Skeleton, kind: str) -> list[tuple[tuple[str, ...], list[int]]]:
    return [(piece.names, list(piece.points)) for piece in lines.pieces if piece.kind == kind]


def in_base(machine: Machine, p: Array, poses: Array) -> Array:
    """(n, 3) positions of poses (n, 4, 4) of the sensor's frame, in the base's."""
    values = dict(zip((c.name for c in machine.parameters), p.tolist(), strict=True))
    numbers = [ca.SX(values[f"base.{axis}"]) for axis in AXES]
    base = np.array(ca.evalf(lie.rpy_transform(numbers[:3], numbers[3:])))
    return np.asarray((poses[:, :3, 3] - base[:3, 3]) @ base[:3, :3])


@pytest.mark.parametrize("name", NAMES)
def test_the_tool_ends_where_the_model_has_it(machines: Mapping[str, Machine], name: str) -> None:
    """At the drawing's constants and home, and elsewhere."""
    machine = machines[name]
    lines = skeleton(machine)
    ((_, tool),) = points_of(lines, "tool")
    q, x, p = somewhere(machine, name, np.random.default_rng(7))
    predictor = Predictor(machine, posed(machine, q))
    np.testing.assert_allclose(
        lines.points(q, x, p)[:, tool[-1]], in_base(machine, p, predictor.poses(p, x)[0]), atol=1e-8
    )
    nominal, q_home = predictor.model.p_home, predictor.model.q_home[None]
    still = Predictor(machine, posed(machine, q_home))
    pose = still.poses(nominal, still.model.home[None])[0]
    end = at_home(machine)["tool"][0][-1]
    np.testing.assert_allclose(end, in_base(machine, nominal, pose)[0], atol=1e-8)


@pytest.mark.parametrize("name", LEGGED)
@settings(max_examples=examples(4), deadline=None)
@given(seed=SEEDS)
def test_legs_are_as_long_as_their_rods(machines: Mapping[str, Machine], name: str, seed: int) -> None:
    machine = machines[name]
    lines = skeleton(machine)
    q, x, p = somewhere(machine, name, np.random.default_rng(seed))
    points = lines.points(q, x, p)
    values = dict(zip((c.name for c in machine.parameters), p.tolist(), strict=True))
    legs = points_of(lines, "leg")
    assert len(legs) == len(machine.mechanism.rods)
    for rod, (names, (a, b)) in zip(machine.mechanism.rods, legs, strict=True):
        assert rod.name in names
        found = np.linalg.norm(points[:, b] - points[:, a], axis=1)
        if rod.length is not None:
            expected = np.full(len(q), values[rod.length])
        else:
            actuator = next(act for act in machine.mechanism.actuators if act.drives == rod.name)
            at = machine.mechanism.readings.index(actuator.reading)
            gain = values[actuator.gain] if actuator.gain else 1.0
            expected = (values[actuator.offset] if actuator.offset else 0.0) + gain * q[:, at]
        np.testing.assert_allclose(found, expected, atol=1e-7)


def test_the_telescopes_legs_are_500_mm_between_their_flexures(machines: Mapping[str, Machine]) -> None:
    """Flexures shorten a bent leg by a little."""
    legs = at_home(machines["telescope"])["leg"]
    assert len(legs) == 6
    np.testing.assert_allclose([np.linalg.norm(b - a) for a, b in legs], 500.0, atol=0.5)


@pytest.mark.parametrize("name", ["arm", "unweighed", "camera", "moving arm"])
@settings(max_examples=examples(6), deadline=None)
@given(seed=SEEDS, turn=st.floats(-3.0, 3.0))
def test_what_is_beyond_the_first_joint_turns_with_it(
    machines: Mapping[str, Machine], name: str, seed: int, turn: float
) -> None:
    machine = machines[name]
    lines = skeleton(machine)
    q, x, p = somewhere(machine, name, np.random.default_rng(seed), rows=1)
    turned = q + np.eye(len(q[0]))[0] * turn
    before, after = lines.points(q, x, p)[0], lines.points(turned, x, p)[0]
    fixed = [
        k for piece in lines.pieces for k in piece.points if piece.kind == "link" and "base" in piece.names
    ]
    np.testing.assert_allclose(after[fixed], before[fixed], atol=1e-9)
    start, end = next(at for names, at in points_of(lines, "axis") if "q1" in names)
    beyond = np.setdiff1d(np.arange(len(before)), fixed)
    about = Rotation.from_rotvec(turn * (before[end] - before[start]))
    expected = before[start] + about.apply(before[beyond] - before[start])
    np.testing.assert_allclose(after[beyond], expected, atol=1e-8)


@pytest.mark.parametrize("name", ["arm", "stage", "graph", "camera", "moving arm", "moving movers"])
def test_a_chain_hangs_together(machines: Mapping[str, Machine], name: str) -> None:
    """From the base to the tool without a gap: each line begins where another ends."""
    machine = machines[name]
    lines = skeleton(machine)
    q, x, p = somewhere(machine, name, np.random.default_rng(1), rows=1)
    points = lines.points(q, x, p)[0]
    reached = [np.zeros(3)]
    left = [list(piece.points) for piece in lines.pieces if piece.kind in ("link", "tool")]
    while left:
        near = [at for at in left if min(np.linalg.norm(points[at[0]] - r) for r in reached) < 1e-8]
        assert near, "a line begins nowhere"
        reached += [points[k] for at in near for k in at]
        left = [at for at in left if at not in near]


def around(corners: Array) -> Array:
    """(k,) twice the areas of the triangles from the middle to each side, with their sign."""
    away = corners - corners.mean(axis=0)
    normal = np.linalg.svd(away)[2][2]
    return np.asarray(np.cross(away, np.roll(away, -1, axis=0)) @ normal)


@pytest.mark.parametrize("name", ["telescope", "gough", "moving pus", "moving ups", "polisher", "hybrid"])
def test_corners_of_a_plate_come_in_their_order_around(machines: Mapping[str, Machine], name: str) -> None:
    plates = at_home(machines[name])["plate"]
    assert plates
    for corners in plates:
        areas = around(corners)
        nothing = 1e-12 * np.abs(areas).max()  # where corners lie in line with the middle
        assert (areas > -nothing).all() or (areas < nothing).all()


@settings(max_examples=examples(40), deadline=None)
@given(seed=SEEDS, corners=st.integers(3, 8))
def test_any_order_of_a_plates_corners_is_set_right(seed: int, corners: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(
        rng.uniform(0, 2 * np.pi / corners * 0.9, corners) + np.arange(corners) * 2 * np.pi / corners
    )
    flat = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(corners)]) * 100.0
    placed = Rotation.random(random_state=seed).apply(flat) + rng.normal(size=3) * 50
    order = rng.permutation(corners)
    one = Skeleton((Piece("plate", ("p",), tuple(range(corners))),), ca.Function(), 0).around(placed[order])
    areas = around(placed[order][list(one.pieces[0].points)])
    assert (areas > 0).all() or (areas < 0).all()
    assert sorted(one.pieces[0].points) == list(range(corners))


@pytest.mark.parametrize("name", NAMES)
def test_every_joint_and_leg_is_drawn_under_its_names(machines: Mapping[str, Machine], name: str) -> None:
    machine = machines[name]
    lines = skeleton(machine)
    named = {one for piece in lines.pieces for one in piece.names}
    assert set(machine.mechanism.readings) <= named
    assert {limb.name for limb in machine.mechanism.limbs} <= named
    assert machine.mechanism.platform is None or "platform" in named
    assert all(len(piece.points) >= 2 for piece in lines.pieces)
    size = max(k for piece in lines.pieces for k in piece.points) + 1
    assert sorted(k for piece in lines.pieces for k in piece.points) == list(range(size))


def test_a_rail_reaches_over_the_range_of_its_slide(machines: Mapping[str, Machine]) -> None:
    machine = machines["stage"]
    rails = at_home(machine)["rail"]
    ranges = [a.range for a in machine.mechanism.actuators if a.unit == "mm" and a.range]
    assert len(rails) == len(ranges)
    for (a, b), (low, high) in zip(rails, ranges, strict=True):
        assert np.linalg.norm(b - a) == pytest.approx(high - low)


@pytest.mark.parametrize("name", bundled_names())
def test_every_machine_of_the_library_has_lines(name: str) -> None:
    machine = library(name)
    lines = at_home(machine)
    assert lines["tool"] and all(np.isfinite(points).all() for kind in lines.values() for points in kind)
    axes = len(lines.get("axis", [])) + len(lines.get("leg", []))
    assert axes >= len(machine.mechanism.actuators)


def test_a_body_with_three_joints_is_a_plate_and_one_with_two_is_not(machines: Mapping[str, Machine]) -> None:
    drawn = skeleton(machines["planar"]).pieces
    assert [piece.names for piece in drawn if piece.kind == "plate"] == [("base",)]
    assert ["platform" in piece.names for piece in drawn if piece.kind == "link"].count(True) == 2
