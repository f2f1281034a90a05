"""Closed forms for base and tool, and what a misfit costs in tolerances: exact where readings are, in every unit of noise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import truepose
from support.checked_arm import JOINTS, document, written
from support.right_pairs import known_machine, right_recording
from truepose.arrays import Array
from truepose.identification.leaves.check.alignment import Frames, starts
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.weighing import settle

POINTS = np.array([[0.0, 30.0, 0.0], [0.0, -30.0, 0.0], [80.0, 0.0, 0.0]])
NAMES = ("P1", "P2", "P3")


def moved(rng: np.random.Generator, n: int = 1, size: float = 400.0) -> Array:
    out = np.tile(np.eye(4), (n, 1, 1))
    out[:, :3, :3], out[:, :3, 3] = Rotation.random(n, rng=rng).as_matrix(), rng.uniform(-size, size, (n, 3))
    return out


def sensor(kind: str) -> dict[str, Any]:
    sigma = {"xyz": 0.03, "rot": 0.005} if kind == "pose" else {"xyz": 0.03}
    more = {"points": dict(zip(NAMES, POINTS.tolist(), strict=True))} if kind == "targets" else {}
    return {"type": kind, "sigma": sigma, **more}


def seen(kind: str, poses: Array) -> dict[str, Array]:
    """Columns that a sensor reads of poses (n, 4, 4), mm and deg."""
    if kind == "targets":
        places = np.einsum("nij,mj->nmi", poses[:, :3, :3], POINTS) + poses[:, None, :3, 3]
        return {f"{name}.{a}": places[:, k, j] for k, name in enumerate(NAMES) for j, a in enumerate("xyz")}
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_rotvec(degrees=True)
    out = {a: poses[:, k, 3] for k, a in enumerate("xyz")}
    return out | ({f"r{a}": turns[:, k] for k, a in enumerate("xyz")} if kind == "pose" else {})


def found(
    folder: Path, kind: str, flange: Array, poses: Array, stated: Frames, lost: int = 0
) -> list[Frames]:
    columns = {name: np.zeros(len(flange)) for name in JOINTS} | seen(kind, poses)
    rows = pd.DataFrame(columns)
    if lost:
        rows.iloc[:lost, 6] = np.nan
    machine = truepose.load_machine(written(folder, document(sensor=sensor(kind)), rows)[0])
    recording = truepose.load_recording(machine, rows)
    return list(starts(machine, recording, flange, stated, POINTS if kind == "targets" else None))


def missed(frames: Frames, flange: Array, poses: Array, *, points: bool) -> float:
    drawn = frames[0] @ flange @ frames[1]
    off = np.abs(drawn - poses)
    return float(np.max(off[:, :3, 3] if points else off))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["pose", "targets"])
def test_poses_tell_base_and_tool_wherever_they_are(kind: str, seed: int, tmp_path: Path) -> None:
    """From readings without an error, by the null vector alone, and nothing is known of either; lost rows are left out."""
    rng = np.random.default_rng(seed)
    flange, base, tool = moved(rng, 12), moved(rng)[0], moved(rng, size=150.0)[0]
    stated = (moved(rng)[0], moved(rng)[0])
    places = found(tmp_path, kind, flange, base @ flange @ tool, stated, lost=2)
    assert places[0] is stated
    first = places[1 if kind == "pose" else 2]
    assert missed(first, flange, base @ flange @ tool, points=False) < 1e-6
    for one, true in zip(first, (base, tool), strict=True):
        np.testing.assert_allclose(one, true, atol=1e-6)


@pytest.mark.parametrize("kind", ["position", "targets"])
def test_points_tell_the_base_of_a_known_tool(kind: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    flange, base, tool = moved(rng, 12), moved(rng)[0], moved(rng, size=150.0)[0]
    poses = base @ flange @ tool
    places = found(tmp_path, kind, flange, poses, (moved(rng)[0], tool))
    assert missed(places[1], flange, poses, points=True) < 1e-6
    np.testing.assert_allclose(places[1][0], base, atol=1e-6)
    assert len(places) == 4  # as stated; three tools for points alone, or one and two by poses


def test_points_tell_how_far_a_tool_is_off(tmp_path: Path) -> None:
    """A tool that is some millimetres longer than stated, next to a machine of a metre: three turns come close."""
    rng = np.random.default_rng(8)
    flange, base, tool = moved(rng, 12), moved(rng)[0], moved(rng, size=150.0)[0]
    stated = tool.copy()
    stated[:3, 3] += [4.0, -3.0, 2.0]
    places = found(tmp_path, "position", flange, base @ flange @ tool, (moved(rng)[0], stated))
    assert missed(places[1], flange, base @ flange @ tool, points=True) < 0.05 * np.linalg.norm([4, 3, 2])


def test_two_rows_tell_no_frame(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    flange, stated = moved(rng, 5), (moved(rng)[0], moved(rng)[0])
    assert len(found(tmp_path, "pose", flange, moved(rng, 5), stated, lost=3)) == 1
    assert len(found(tmp_path, "pose", flange, moved(rng, 5), stated, lost=2)) > 1


@pytest.mark.parametrize("sensor", ["pose", "position"])
@pytest.mark.parametrize("family", ["planar", "serial", "wrist"])
def test_frames_that_nobody_knows_are_found_where_a_machine_turns_about_one_axis_or_hardly_moves(
    family: str, sensor: str
) -> None:
    """Its turns leave an angle between base and tool open, and its points, where the stated tool hardly moves, the base."""
    for seed in range(4):
        machine = known_machine(family, sensor, "free", "free")
        rig = Rig(machine, right_recording(machine, 20, seed, off=0.0, share=0.3))
        assert rig.stand().misfit < 1.5, seed


@pytest.mark.parametrize("sensor", ["pose", "position"])
@pytest.mark.parametrize("family", ["arm", "ups", "planar"])
def test_a_frame_that_nobody_knows_is_found_from_one_that_is_nearly_known(family: str, sensor: str) -> None:
    """However little the tool moves, and the known one stays where it is."""
    for frames in (("known", "free"), ("free", "known")):
        machine = known_machine(family, sensor, *frames)
        at = "base" if frames[0] == "known" else "tool"
        for seed in range(4):
            rig = Rig(machine, right_recording(machine, 20, seed, share=0.02, off=0.0))
            stand = rig.stand(free=())
            assert stand.misfit < 1.5, (at, seed)
            places = rig.at[at]
            away = np.abs(stand.p - rig.scene.p)[places] / rig.tolerance[places]
            assert away.max() < 4.0, (at, seed)


@pytest.mark.parametrize("flat", [False, True], ids=["in space", "in a plane"])
def test_lengths_tell_where_a_ball_stands(flat: bool, tmp_path: Path) -> None:
    """Exactly, from a known tool; on either side where its places lie in a plane. How the base is turned is not told."""
    rng = np.random.default_rng(12)
    flange, base = moved(rng, 12), moved(rng)[0]
    flange[:, 2, 3] = 70.0 if flat else flange[:, 2, 3]
    tool, centre = np.eye(4), np.array([900.0, -400.0, 300.0])
    balls = (base @ flange)[:, :3, 3]
    rows = pd.DataFrame({name: np.zeros(12) for name in JOINTS})
    rows["length"] = np.linalg.norm(balls - centre, axis=1)
    text = document(sensor={"type": "ballbar", "centre": centre.tolist(), "sigma": {"distance": 0.01}})
    machine = truepose.load_machine(written(tmp_path, text, rows)[0])
    recording = truepose.load_recording(machine, rows)
    places = list(starts(machine, recording, flange, (moved(rng)[0], tool), None))[1 : 3 if flat else 2]
    for stood, _ in places:
        lengths = np.linalg.norm((stood @ flange)[:, :3, 3] - centre, axis=1)
        np.testing.assert_allclose(lengths, rows["length"], atol=1e-6)
    own = [np.linalg.inv(stood)[:3, :3] @ (centre - stood[:3, 3]) for stood, _ in places]
    true = base[:3, :3].T @ (centre - base[:3, 3])
    assert min(np.linalg.norm(one - true) for one in own) < 1e-6


@pytest.mark.parametrize(("across", "places"), [(30.0, 4), (0.0, 2)])
def test_targets_on_one_line_show_no_attitude(
    across: float, places: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for the tool as it is stated: how they are turned about their line is not told."""
    points = np.array([[100.0, across, 0.0], [200.0, 0.0, 0.0], [400.0, 0.0, 0.0]])
    monkeypatch.setitem(globals(), "POINTS", points)
    rng = np.random.default_rng(10)
    flange, base, tool = moved(rng, 12), moved(rng)[0], moved(rng, size=150.0)[0]
    found_places = found(tmp_path, "targets", flange, base @ flange @ tool, (moved(rng)[0], tool))
    assert len(found_places) == places
    assert missed(found_places[1], flange, base @ flange @ tool, points=True) < 1e-6


@pytest.mark.parametrize("of", ["origin", "x", "y"])
def test_directions_tell_how_a_base_is_turned_and_bearings_where_it_stands(of: str, tmp_path: Path) -> None:
    """Axes of the tool leave the base where it is stated; too few of them tell nothing."""
    rng = np.random.default_rng(11)
    flange, base, tool = moved(rng, 12), moved(rng)[0], moved(rng, size=150.0)[0]
    base[:3, 3] = [1500.0, -900.0, 700.0]
    stated = (moved(rng)[0], tool)
    poses = base @ flange @ tool
    seen = poses[:, :3, 3] if of == "origin" else poses[:, :3, "xyz".index(of)]
    rows = pd.DataFrame({name: np.zeros(12) for name in JOINTS}).assign(
        azimuth=np.degrees(np.arctan2(-seen[:, 1], seen[:, 0])),
        elevation=np.degrees(np.arcsin(seen[:, 2] / np.linalg.norm(seen, axis=1))),
    )
    text = document(sensor={"type": "direction", "of": of, "sigma": {"angle": 0.001}})
    machine = truepose.load_machine(written(tmp_path, text, rows)[0])
    recording = truepose.load_recording(machine, rows)
    first, second = starts(machine, recording, flange, stated, None)
    assert first is stated and second[1] is tool
    np.testing.assert_allclose(second[0][:3, :3], base[:3, :3], atol=1e-6)
    place = base[:3, 3] if of == "origin" else stated[0][:3, 3]
    np.testing.assert_allclose(second[0][:3, 3], place, atol=1e-3)
    assert len(list(starts(machine, recording.subset(slice(0, 2)), flange[:2], stated, None))) == 1


def test_a_base_is_found_by_a_tool_within_its_tolerance() -> None:
    """Where the tool as it is stated does not move at all, so that it shows no attitude."""
    machine = known_machine("wrist", "position", "free", "known")
    for seed in range(8):
        rig = Rig(machine, right_recording(machine, 17, seed))
        assert settle(rig, rig.stand(free=())).misfit < 1.5, seed
