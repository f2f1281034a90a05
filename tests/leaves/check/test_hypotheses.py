"""Each hypothesis of the gate: what it does to the scene is what its mend does to the files, and what its words say."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from functools import reduce
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import truepose
from support.checked_arm import JOINTS, document, recorded, written
from support.slip_cases import ROWS, Case, columns_of, sides
from truepose.identification.leaves.check.kinds import frames, joints, order, poses, units
from truepose.identification.leaves.check.pair import Scene, Sheet, Slip
from truepose.identification.leaves.check.rig import Rig


@pytest.fixture(scope="module", params=["pose", "targets", "slide"])
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    return Case(tmp_path_factory.mktemp("case"), *columns_of(request.param))


def turns(scene: Scene) -> Rotation:
    seen = scene.rows.observations
    return Rotation.from_rotvec(np.column_stack([seen[n] for n in ("rx", "ry", "rz")]))


@pytest.mark.parametrize(
    "maker",
    [
        units.units, joints.signs, joints.exchanged, poses.mirrored, poses.turned, poses.targets, poses.poses,
        order.shifted, frames.frames_swapped, joints.quarter_turns, joints.mirrored_zeros,
    ],
)  # fmt: skip
def test_what_a_slip_does_to_the_scene_its_mend_does_to_the_files(
    maker: Callable[[Rig, Scene], Iterable[Slip]], case: Case
) -> None:
    rig = case.rig
    own = list(maker(rig, rig.scene))
    for slip in own[:: max(len(own) // 12, 1)]:  # a dozen of each kind: loading takes time
        there = slip.change(rig.scene)
        _, mended = case.mended(slip)
        left = np.ones(len(rig.scene.rows), dtype=bool) if there.lost is None else ~there.lost
        # a zero stands in the constant, where the file has one
        at = [rig.names.index(f"{name}.theta") for name in there.rows.joints]
        rest = np.setdiff1d(np.arange(len(rig.names)), at)
        moved, found = there.rows.q[left] + there.p[at], mended.rows.q + mended.p[at]
        turning = [a.reading_unit == "rad" for a in case.machine.mechanism.actuators]
        moved, found = (np.where(turning, np.exp(1j * one), one) for one in (moved, found))
        np.testing.assert_allclose(moved, found, rtol=1e-9, atol=1e-9, err_msg=slip.says)
        np.testing.assert_allclose(there.p[rest], mended.p[rest], rtol=1e-8, atol=1e-9, err_msg=slip.says)
        for name, values in there.rows.observations.items():
            if name.startswith("r") and slip.kind in ("inverse-pose", "rotation-convention", "unit-angle"):
                continue  # turns are compared below
            found = mended.rows.observations[name]
            np.testing.assert_allclose(values[left], found, rtol=1e-8, atol=1e-8, err_msg=slip.says)
        if "rx" in there.rows.observations and there.lost is None:
            assert np.max((turns(there).inv() * turns(mended)).magnitude()) < 1e-7, slip.says


@pytest.mark.parametrize("stated", ["standard", "modified", "khalil"])
def test_a_table_is_mended_to_the_one_that_predicts_what_a_slip_says(stated: str, tmp_path: Path) -> None:
    """Another convention, or a and d in each other's place, or two rows exchanged."""
    machine, rows = columns_of("pose")
    if stated == "khalil":
        for row in machine["mechanism"]["joints"]:
            row["r"], row["d"] = row.pop("d"), row.pop("a")
        del machine["mechanism"]["convention"]
    else:
        machine["mechanism"]["convention"] = stated
    case = Case(tmp_path, machine, rows)
    slips = [*frames.conventions(case.rig, case.rig.scene), *frames.exchanged_rows(case.rig, case.rig.scene)]
    assert len(slips) == 3 + 15
    for slip in slips:
        there = slip.change(case.rig.scene)
        other, mended = case.mended(slip)
        rig = Rig(other, mended.rows)
        drawn, found = (
            one.predictor.poses(p, one.assembled(one.predictor, p, one.scene)[0])[0]
            for one, p in ((case.rig, there.p), (rig, rig.scene.p))
        )
        np.testing.assert_allclose(found, drawn, atol=1e-7, err_msg=slip.says)


def test_clocks_are_mended_by_the_readings_between_rows(tmp_path: Path) -> None:
    """Joints that were read half a second from the sensor's rows; the ends, of which nothing is known, are left out."""
    machine, _ = columns_of("pose")
    time = np.arange(40) * 0.25
    moving = {name: 40.0 * np.sin(0.5 * time + k) for k, name in enumerate(JOINTS)}
    driven = pd.DataFrame(moving)
    path, _ = written(tmp_path, machine, driven)
    seen = truepose.simulate(truepose.load_machine(path), driven, seed=1).reset_index(drop=True)
    late = {name: np.interp(time - 0.5, time, column) for name, column in moving.items()}
    case = Case(tmp_path, machine, pd.concat([pd.DataFrame({"time": time, **late}), seen], axis=1))
    (slip,) = order.clocks(case.rig, case.rig.scene)
    there = slip.change(case.rig.scene)
    assert there.lost is not None
    _, mended = case.mended(slip)
    np.testing.assert_allclose(there.rows.q[~there.lost], mended.rows.q, atol=1e-9)
    np.testing.assert_allclose(mended.rows.q[5:-5], case.rig.scene.rows.q[7:-5], atol=5e-3)


def test_every_hypothesis_is_made_once(case: Case) -> None:
    """As many as there are: one and all; pairs, the reverse and orders along; hands; quarter and half turns."""
    rig, kind = case.rig, case.machine.sensors[0].type
    makers = (joints.signs, joints.exchanged, poses.mirrored, poses.turned, poses.poses, joints.quarter_turns)
    count = {maker: len(list(maker(rig, rig.scene))) for maker in makers}
    few = kind == "position"
    assert count[joints.signs] == (3 + 2 if few else 6 + 1)  # those of one kind, and all, together
    assert count[joints.exchanged] == (1 if few else 15 + 1 + 5)  # slides with slides only
    assert count[joints.quarter_turns] == (3 if few else 18)
    assert count[poses.mirrored] == {"pose": 6 + 24, "targets": 6, "position": 6}[kind]
    assert count[poses.turned] == 23
    plain = {f"measured {a} with the other sign" for a in "xyz"} | {
        f"measured {a} and {b} exchanged" for a, b in ("xy", "xz", "yz")
    }
    assert {slip.says.partition(",")[0] for slip in list(poses.mirrored(rig, rig.scene))[:6]} == plain
    assert count[poses.poses] == {"pose": 2 + 2 + 2 * 12 + 5, "targets": 0, "position": 0}[kind]
    assert len(list(poses.targets(rig, rig.scene))) == (5 if kind == "targets" else 0)
    for maker in (
        units.units,
        joints.signs,
        joints.exchanged,
        poses.targets,
        poses.poses,
        order.shifted,
        joints.quarter_turns,
    ):
        said = [(s.says, s.fix) for s in maker(rig, rig.scene)]
        assert len(set(said)) == len(said)


def about(axes: str, angles: np.ndarray) -> list[Rotation]:
    ways = [np.eye(3)["xyz".index(axis)] for axis in axes]
    return [Rotation.from_rotvec(angle * way) for angle, way in zip(angles, ways, strict=True)]


def test_angles_are_turned_as_their_words_say(tmp_path: Path) -> None:
    """Moving axes turn with the body, fixed ones do not; products of matrices are what they are written as."""
    case = Case(tmp_path, *columns_of("pose"))
    read = np.array([case.rig.scene.rows.observations[n][3] for n in ("rx", "ry", "rz")])
    for slip in poses.poses(case.rig, case.rig.scene):
        there = turns(slip.change(case.rig.scene))[3]
        if m := re.fullmatch(r"rx, ry, rz as angles about (\w), (\w), (\w), (moving|fixed) axes", slip.says):
            parts = about("".join(m.groups()[:3]), read)
            parts = parts if m[4] == "moving" else parts[::-1]
        elif m := re.fullmatch(
            r"rx, ry, rz as angles of their axes: R(.)\(r.\) R(.)\(r.\) R(.)\(r.\)", slip.says
        ):
            axes = "".join(m.groups())
            parts = about(axes, read[["xyz".index(axis) for axis in axes]])
        elif "quaternion" in slip.says:
            x, y, z, w = Rotation.from_rotvec(read).as_quat()
            first = slip.says.endswith("read as scalar last (x, y, z, w)")
            parts = [Rotation.from_quat([y, z, w, x] if first else [w, x, y, z])]
        else:
            parts = [Rotation.from_rotvec(-read)]
        expected = reduce(lambda a, b: a * b, parts)
        assert (expected.inv() * there).magnitude() < 1e-9, slip.says
        assert slip.where == (("x", "y", "z") if "inverse)" in slip.says else ()) + ("rx", "ry", "rz")


def test_a_mirror_maps_points_and_turns_alike(tmp_path: Path) -> None:
    """S x and S R S': of the other hand for ``mirrored``, of the same for ``turned``; the first leaves no turn as it was."""
    case = Case(tmp_path, *columns_of("pose"))
    scene = case.rig.scene
    before = np.column_stack([scene.rows.observations[n] for n in "xyz"])
    for maker, hand in ((poses.mirrored, -1.0), (poses.turned, 1.0)):
        for k, slip in enumerate(maker(case.rig, scene)):
            there = slip.change(scene)
            after = np.column_stack([there.rows.observations[n] for n in "xyz"])
            s = np.linalg.lstsq(before, after, rcond=None)[0].T
            np.testing.assert_allclose(np.abs(s).sum(axis=0), 1.0, atol=1e-9)
            assert np.linalg.det(s) == pytest.approx(hand)
            whole = hand < 0 and k < 6
            expected = s @ turns(scene).as_matrix() @ s.T if whole else turns(scene).as_matrix()
            np.testing.assert_allclose(turns(there).as_matrix(), expected, atol=1e-9)
            stays = np.isclose(np.diag(s), 1.0)
            moved = tuple(axis for axis, same in zip("xyz", stays, strict=True) if not same)
            assert tuple(sorted(slip.where)) == moved


def test_what_goes_with_a_joint_is_mended_with_it(tmp_path: Path) -> None:
    """The side and the speed that it arrived with change their sign, or their name, as its readings do."""
    case = Case(tmp_path, document(), sides(recorded()[:ROWS]))
    sheet = case.pair.sheets[0]

    def mended(maker: Callable[[Rig, Scene], Iterable[Slip]], *where: str) -> Sheet:
        slip = next(slip for slip in maker(case.rig, case.rig.scene) if slip.where == where)
        return slip.mend(case.pair).sheets[0]

    other_way, swapped = mended(joints.signs, "q2"), mended(joints.exchanged, "q2", "q5")
    for name in sheet.units:
        sign = -1.0 if name in ("q2", "approach.q2", "velocity.q2") else 1.0
        np.testing.assert_allclose(other_way.numbers(name), sign * sheet.numbers(name))
    assert np.array_equal(swapped.numbers("x"), sheet.numbers("x"))
    for kind in ("", "approach.", "velocity."):
        one, other = f"{kind}q2", f"{kind}q5"
        np.testing.assert_allclose(swapped.numbers(other), sheet.numbers(one))


@pytest.mark.parametrize("frame", ["base", "tool"])
def test_a_frame_that_is_elsewhere_is_told_and_stated_as_unknown(frame: str, tmp_path: Path) -> None:
    case = Case(tmp_path, *columns_of("pose"))
    found = case.rig.scene.p.copy()
    at = case.rig.at[frame]
    found[at] += [30.0, -40.0, 0.0, 0.0, 0.0, 0.2]
    slip = frames.frame_unknown(case.rig, frame, found)
    before, after = (case.rig.frames_of(p)[frame == "tool"] for p in (case.rig.scene.p, found))
    turn = np.degrees(Rotation.from_matrix(before[:3, :3].T @ after[:3, :3]).magnitude())
    assert slip.says == f"frames.{frame} stands 50 mm and {turn:.3g} deg from where the file says"
    machine, mended = case.mended(slip)
    np.testing.assert_allclose(mended.p, found, rtol=1e-5)
    unknown = {p.name for p in machine.parameters if np.isinf(p.tolerance)}
    assert unknown == {case.rig.names[k] for k in at}
    bare = document()
    parent = bare["frames"].pop(frame)["in"]
    other = Case(tmp_path, bare, recorded()[:ROWS])
    left_out = frames.frame_unknown(other.rig, frame, found)
    assert left_out.says.startswith(f"frames.{frame} is left out, which says that it is exactly the identity")
    assert left_out.fix.startswith(f"add frames.{frame} with")
    assert left_out.mend(other.pair).get(("frames", frame, "in")) == parent


def test_a_zero_out_of_the_range_is_mended_in_its_column(tmp_path: Path) -> None:
    """Where readings leave the joint's range, which counts from the right zero."""
    machine, rows = columns_of("pose")
    machine["mechanism"]["joints"][0]["range"] = [-100.0, 100.0]
    rows["q1"] = np.linspace(-140.0, 60.0, len(rows))  # some out of range: zero or whole turns are off
    case = Case(tmp_path, machine, rows)
    slip = joints.offset(case.rig, 0, np.radians(40.0))
    mended = slip.mend(case.pair)
    assert mended.document == case.pair.document
    np.testing.assert_allclose(mended.sheets[0].numbers("q1"), rows["q1"] + 40.0, atol=1e-9)
    round_again = joints.offset(case.rig, 0, np.radians(-300.0)).mend(case.pair).sheets[0].numbers("q1")
    # whole turns bring it into the range
    np.testing.assert_allclose(round_again, rows["q1"] + 60.0, atol=1e-9)


def test_tolerances_grow_with_a_file_in_another_unit_and_never_with_a_mechanism_alone(tmp_path: Path) -> None:
    """Those of a mechanism that is drawn a thousand times smaller are not what the file states: it has its own."""
    case = Case(tmp_path, *columns_of("pose"))
    grows = case.rig.lengths
    found = [s for s in units.units(case.rig, case.rig.scene) if "lengths in" in s.says]
    assert len(found) == 2 * 6  # units but mm, of the mechanism and of the whole file
    for slip in found:
        there = slip.change(case.rig.scene)
        long = np.flatnonzero(grows & (case.rig.scene.p != 0.0))
        k = next(k for k in long if case.rig.names[k].startswith("q"))
        assert there.p[k] == pytest.approx(there.drawn * case.rig.scene.p[k])
        if slip.where == ("units.length",):
            tolerance = {p.name: p.tolerance for p in case.mended(slip)[0].parameters}
            stated = np.array([tolerance.get(name, 0.0) for name in case.rig.names])[grows]
            np.testing.assert_allclose(stated, there.stated * case.rig.tolerance[grows], rtol=1e-9)
        else:
            assert there.stated == min(there.drawn, 1.0)


def test_an_inverse_pose_inverted_is_the_pose(tmp_path: Path) -> None:
    case = Case(tmp_path, *columns_of("pose"))
    slip = next(s for s in poses.poses(case.rig, case.rig.scene) if s.kind == "inverse-pose")
    twice = slip.change(slip.change(case.rig.scene))
    for name, values in case.rig.scene.rows.observations.items():
        np.testing.assert_allclose(twice.rows.observations[name], values, atol=1e-9)
    there = slip.change(case.rig.scene)
    place = [np.column_stack([s.rows.observations[n] for n in "xyz"]) for s in (case.rig.scene, there)]
    np.testing.assert_allclose(turns(case.rig.scene).apply(place[1]) + place[0], 0.0, atol=1e-9)
