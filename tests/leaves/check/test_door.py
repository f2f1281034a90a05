"""The law of the door: nothing right is refused, whatever is free or known; what a free frame can undo is no slip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from support.checked_arm import JOINTS, columns, document, recorded, written
from support.right_pairs import (
    FAMILIES,
    SENSORS,
    TOLERANCES,
    fewest_rows,
    known_machine,
    law,
    poses_read,
    right_recording,
)
from truepose.arrays import Array
from truepose.identification.leaves.check.result import Check
from truepose.identification.leaves.check.run import check_files, check_loaded
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

XYZ, TURNS = ("x", "y", "z"), ("rx", "ry", "rz")


frames = st.sampled_from(sorted(TOLERANCES))
machines = st.builds(
    known_machine, st.sampled_from(FAMILIES), st.sampled_from(sorted(SENSORS)), frames, frames
)
seeds = st.integers(0, 2**31 - 1)
shares = st.sampled_from([0.02, 0.2, 1.0])


def words(found: Check) -> list[tuple[str, str, str]]:
    return [(f.verdict, f.kind, f.says) for f in found.found]


def with_seen(recording: Recording, position: Array, turns: Rotation | None) -> Recording:
    read = dict(zip(XYZ, position.T, strict=True))
    if turns is not None:
        read |= dict(zip(TURNS, turns.as_rotvec().T, strict=True))
    return replace(recording, observations=read)


@law(18)
@given(machines, st.integers(0, 20), shares, seeds)
def test_a_machine_inside_its_tolerances_is_not_refused(
    machine: Machine, more: int, share: float, seed: int
) -> None:
    rows = right_recording(machine, fewest_rows(machine) + more, seed, share=share)
    found = check_loaded(machine, rows)
    assert found.verdict != "wrong", words(found)


@law(18)
@given(machines, st.integers(0, 20), shares, seeds)
def test_a_machine_as_it_is_drawn_is_right(machine: Machine, more: int, share: float, seed: int) -> None:
    rows = right_recording(machine, fewest_rows(machine) + more, seed, off=0.0, share=share)
    found = check_loaded(machine, rows)
    assert found.verdict == "ok", words(found)
    assert found.left is not None


@law(15)
@given(st.sampled_from(["arm", "gantry", "hybrid"]), st.floats(-0.8, 0.8), seeds)
def test_zeros_of_end_joints_are_turns_of_frames_that_are_free(family: str, turn: float, seed: int) -> None:
    """The first joint's zero turns the base, the last one's the tool, if they turn and stay in their ranges."""
    machine = known_machine(family, "pose", "free", "free")
    rows = right_recording(machine, fewest_rows(machine) + 8, seed, off=0.3, share=0.5)
    units = [a.reading_unit for a in machine.mechanism.actuators]
    ends = {0: family == "arm", len(units) - 1: True}
    for k in (k for k, turning in ends.items() if turning):
        q = rows.q.copy()
        q[:, k] += turn
        found = check_loaded(machine, replace(rows, q=q))
        assert found.verdict == "ok", (k, words(found))


@law(15)
@given(st.sampled_from(["arm", "gantry", "ups"]), seeds, st.permutations((0, 1, 2)), st.booleans())
def test_axes_turned_are_a_turn_of_a_base_that_is_free(
    family: str, seed: int, order: list[int], other: bool
) -> None:
    machine = known_machine(family, "position", "free", "known")
    rows = right_recording(machine, fewest_rows(machine) + 8, seed, off=0.3)
    turn = np.eye(3)[order]
    turn[0] *= np.sign(np.linalg.det(turn))
    turn[1:] *= -1.0 if other else 1.0
    position = np.column_stack([rows.observations[n] for n in XYZ])
    found = check_loaded(machine, with_seen(rows, position @ turn.T, None))
    assert found.verdict == "ok", words(found)


def spoilt(rows: Recording, kind: str) -> Recording:
    """A recording that is right, or has one slip."""
    if kind == "sign":
        return replace(rows, q=rows.q * np.where(np.arange(rows.q.shape[1]) == 1, -1.0, 1.0))
    if kind == "metres":
        read = rows.observations
        return replace(rows, observations={**read, **{axis: read[axis] / 1e3 for axis in XYZ}})
    return rows


@law(3)
@given(st.sampled_from(["right", "sign", "metres"]), seeds, st.integers(0, 2**16))
def test_the_world_frame_and_the_order_of_rows_change_no_verdict(kind: str, seed: int, other: int) -> None:
    """Of an arm whose base nobody knows: another world is another base."""
    machine = known_machine("arm", "pose", "free", "known")
    rows = spoilt(right_recording(machine, 30, seed), kind)
    rng = np.random.default_rng(other)
    turn, shift = (
        Rotation.random(random_state=other),
        rng.uniform(-1e3, 1e3, 3) * (1e-3 if kind == "metres" else 1),
    )
    position, turns = poses_read(rows)
    moved = with_seen(rows, turn.apply(position) + shift, turn * turns)
    ways = [check_loaded(machine, one) for one in (rows, moved, rows.subset(rng.permutation(30)))]
    first = [(f.verdict, f.kind, f.where) for f in ways[0].found]
    assert ways[0].verdict == ("ok" if kind == "right" else "wrong"), words(ways[0])
    for found in ways[1:]:
        assert [(f.verdict, f.kind, f.where) for f in found.found] == first


@pytest.mark.parametrize("kind", ["right", "sign"])
def test_units_of_the_files_change_no_verdict(kind: str, tmp_path: Path) -> None:
    """The same pair, written in metres and radians."""
    rows, machine = recorded(), document()
    rows = columns(rows, lambda v: -v, "q3")[1] if kind == "sign" else rows
    path, recording = written(tmp_path, machine, rows)
    plain = check_files(path, [recording])[0]
    other: dict[str, Any] = document(units={"length": "m", "angle": "rad"})
    for joint in other["mechanism"]["joints"]:
        joint |= {k: joint[k] / 1e3 for k in ("a", "d")}
        joint |= {k: float(np.radians(joint[k])) for k in ("alpha", "theta")}
    for frame in other["frames"].values():
        frame["xyz"] = [v / 1e3 for v in frame["xyz"]]
        frame["rpy"] = np.radians(frame["rpy"]).tolist()
        frame["tolerance"] = {
            "xyz": frame["tolerance"]["xyz"] / 1e3, "rpy": float(np.radians(frame["tolerance"]["rpy"])),
        }  # fmt: skip
    other["sensor"]["sigma"] = {"xyz": 0.03e-3, "rot": float(np.radians(0.005))}
    other["tolerances"] = {"length": 0.2e-3, "angle": float(np.radians(0.05))}
    for mass in other["masses"].values():
        mass["com"] = [v / 1e3 for v in mass["com"]]
    metric = rows.copy()
    metric[[*XYZ]] /= 1e3
    metric[[*JOINTS, *TURNS]] = np.radians(metric[[*JOINTS, *TURNS]])
    path, recording = written(tmp_path, other, metric)
    found = check_files(path, [recording])[0]
    told = [[(f.verdict, f.kind, f.where) for f in one.found] for one in (plain, found)]
    assert told[0] == told[1]
    assert found.verdict == ("ok" if kind == "right" else "wrong")
    assert found.left == pytest.approx(plain.left, rel=1e-3)
