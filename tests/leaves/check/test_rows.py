"""Rows that stand out, and set-ups that change from a row on: which rows, by how much, in numbers of all rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from support.checked_arm import ARM, checked, document, recorded, standing, written
from support.right_pairs import known_machine, law, poses_read, right_recording
from truepose.arrays import Array
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Check, Found
from truepose.identification.leaves.check.run import check_files, check_loaded
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine
from truepose.wording import shortened

XYZ = ("x", "y", "z")
ROWS = 40
SIZES = {
    25.4: "25.4 times too {} (in inch?)",
    1e3: "1000 times too {} (in m?)",
    10.0: "10 times too {} (in cm?)",
}


seeds = st.integers(0, 2**31 - 1)
axes = st.sampled_from(XYZ)
few = st.lists(st.integers(0, ROWS - 1), min_size=1, max_size=6, unique=True).map(sorted)


def arm() -> Machine:
    return known_machine("arm", "pose", "known", "known")


def with_column(recording: Recording, name: str, values: Array) -> Recording:
    return replace(recording, observations={**recording.observations, name: values})


def only(found: Check) -> Found:
    (one,) = found.found
    return one


def check_head(one: Found, places: list[int]) -> None:
    """That these rows (from 0), and no other, are told by their numbers and their count."""
    rows = shortened([str(k + 1) for k in places], 6)
    plural = "s" if len(places) > 1 else ""
    assert (one.kind, one.verdict, one.mend) == ("rows-stand-out", "suspect", None)
    assert one.says.startswith(f"row{plural} {rows} ({len(places)} of {ROWS}): "), one.says


@law()
@given(seeds, few, axes, st.sampled_from(sorted(SIZES)), st.booleans())
def test_rows_in_another_unit_are_told_with_their_factor(
    seed: int, places: list[int], axis: str, factor: float, small: bool
) -> None:
    rows = right_recording(arm(), ROWS, seed)
    z = rows.observations[axis].copy()
    z[places] *= 1.0 / factor if small else factor
    one = only(check_loaded(arm(), with_column(rows, axis, z)))
    check_head(one, places)
    assert one.says.endswith(f"{axis} {SIZES[factor].format('small' if small else 'large')}"), one.says


@law()
@given(seeds, few.filter(lambda rows: len(rows) > 1), axes, st.floats(200.0, 5000.0), st.booleans())
def test_rows_that_are_off_by_a_constant_are_told_with_it(
    seed: int, places: list[int], axis: str, size: float, below: bool
) -> None:
    rows = right_recording(arm(), ROWS, seed)
    away = -size if below else size
    z = rows.observations[axis].copy()
    z[places] += away
    one = only(check_loaded(arm(), with_column(rows, axis, z)))
    check_head(one, places)
    told, _, unit = one.says.rpartition(f"off by a constant: {axis} ")[2].partition(" ")
    assert unit == "mm" and float(told) == pytest.approx(away, rel=0.05), one.says


@law()
@given(seeds, st.lists(st.integers(0, ROWS - 1), min_size=2, max_size=6, unique=True).map(sorted))
def test_figures_are_of_all_rows(seed: int, places: list[int]) -> None:
    """What is left is an rms over every row, those that stand out as well."""
    rows = right_recording(arm(), ROWS, seed)
    x = rows.observations["x"].copy()
    x[places] += 3000.0
    found = check_loaded(arm(), with_column(rows, "x", x))
    assert found.left == pytest.approx(3000.0 * np.sqrt(len(places) / ROWS), rel=0.01)
    assert (found.unit, found.rows) == ("mm", ROWS)


def set_up(machine: Machine, frame: str, axis: int, mm: float, cut: int, seed: int) -> Recording:
    """A recording whose base or tool stands elsewhere from a row on, along axes of the frame that it is stated in."""
    rows = right_recording(machine, ROWS, seed)
    position, turns = poses_read(rows)
    way = np.zeros((ROWS, 3))
    way[cut:, axis] = mm
    if frame == "tool":
        tool = Rotation.from_matrix(standing(ARM["frames"]["tool"])[:3, :3])
        way = (turns * tool.inv()).apply(way)
    moved = dict(zip(XYZ, (position + way).T, strict=True))
    return replace(rows, observations={**rows.observations, **moved})


@pytest.mark.nightly
@law(5)
@given(
    seeds,
    st.sampled_from(["base", "tool"]),
    st.integers(0, 2),
    st.floats(50.0, 400.0),
    st.booleans(),
    st.integers(10, 30),
)
def test_a_frame_that_moved_is_told_with_row_direction_and_size(
    seed: int, frame: str, axis: int, size: float, back: bool, cut: int
) -> None:
    mm = -size if back else size
    found = check_loaded(arm(), set_up(arm(), frame, axis, mm, cut, seed))
    first = found.found[0]
    # a small move may be physics: a mount that gives way; it is never passed over
    assert first.kind == "sessions-mixed" and first.verdict in ("suspect", "wrong"), found.found
    assert f"the {frame} stands elsewhere, by {frame} " in first.says, first.says
    told, unit = first.says.rpartition(f"{frame} {XYZ[axis]} ")[2].split(",")[0].split()
    assert unit == "mm" and float(told) == pytest.approx(mm, rel=0.05), first.says
    row = int(first.says.partition(" row ")[2].split()[0])
    assert row == cut + 1, first.says


@pytest.mark.nightly
def test_set_ups_are_mended_by_sessions(tmp_path: Path) -> None:
    """Each gets a number in a column; where a file says so already, it is a suspect, and a small move is physics."""
    rows = recorded()
    rows.loc[25:, "x"] += 400.0
    first = checked(tmp_path, document(), rows).found[0]
    assert first.mend is not None
    assert first.fix.startswith("give each set-up its own number in a column 'session'")
    pair = Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])
    (sheet,) = first.mend(pair).sheets
    assert list(sheet.cells["session"]) == ["1"] * 25 + ["2"] * 20
    twice = replace(pair, sheets=pair.sheets * 2)
    assert first.mend(twice) is twice
    said = checked(tmp_path, document(), rows.assign(session=np.repeat([1, 2], [25, 20])))
    assert [(f.kind, f.verdict) for f in said.found] == [("sessions-mixed", "suspect")]
    assert "'per: session' in frames.base" in said.found[0].fix
    rows.loc[25:, "x"] -= 385.0
    near = checked(tmp_path, document(), rows.assign(session=np.repeat([1, 2], [25, 20])))
    assert "sessions-mixed" not in {f.kind for f in near.found}


def test_the_worst_session_of_a_base_that_is_set_up_anew_is_told(tmp_path: Path) -> None:
    """Readings of the second day stand in metres; those of the first are right."""
    machine = document()
    machine["frames"]["base"]["per"] = "session"
    rows = recorded().assign(session=np.repeat([1, 2], [22, 23]))
    rows.loc[22:, [*XYZ]] /= 1000.0
    path, recording = written(tmp_path, machine, rows)
    found = check_files(path, [recording])[0]
    assert (found.verdict, found.found[0].kind, found.rows) == ("wrong", "unit-length", 45)
