"""Base and tool where the file says they are not: how far off is worth a word, which of them, and which tables have no name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from truepose.identification.check.stated import frames_off

from support.checked_arm import EXACT, Document, document, recorded, rig_of, written
from truepose.identification.check.pair import Pair
from truepose.identification.check.result import Found
from truepose.identification.check.unread import unnamed_table

TOLERANCE = {"base": 5.0, "tool": 2.0}


def moved(machine: Document, frame: str, tolerances: float) -> Document:
    machine["frames"][frame]["xyz"][1] += tolerances * TOLERANCE[frame]
    return machine


def told(folder: Path, stated: Document, real: Document) -> list[Found]:
    rig = rig_of(folder, stated, real)
    return frames_off(rig, rig.scene, rig.stand())


@pytest.mark.parametrize("frame", ["base", "tool"])
def test_a_frame_is_off_where_its_tolerances_cost_more_than_noise_of_two_and_a_half(
    frame: str, tmp_path: Path
) -> None:
    """Spread over the 54 readings of nine rows of twelve: 18 tolerances."""
    limit = 2.5 * np.sqrt(54.0)
    drawn = document(sensor=EXACT)
    assert told(tmp_path, drawn, moved(document(sensor=EXACT), frame, 0.97 * limit)) == []
    (found,) = told(tmp_path, drawn, moved(document(sensor=EXACT), frame, 1.03 * limit))
    assert (found.kind, found.where, found.verdict) == (f"{frame}-missing", (f"frames.{frame}",), "wrong")
    assert found.says.endswith("from where the file says") and found.unit == "mm"
    size = float(found.says.split(" stands ")[1].split()[0])
    assert size == pytest.approx(1.03 * limit * TOLERANCE[frame], rel=0.02)
    assert found.before is not None and found.after is not None and found.after < 1e-9 < found.before


def test_both_frames_are_told_where_both_are_off(tmp_path: Path) -> None:
    real = moved(moved(document(sensor=EXACT), "base", 60.0), "tool", 60.0)
    assert [f.kind for f in told(tmp_path, document(sensor=EXACT), real)] == ["base-missing", "tool-missing"]


@pytest.mark.parametrize(("mm", "kinds"), [(0.05, []), (60.0, ["base-missing"])])
def test_frames_that_are_said_to_be_exact_may_miss_by_what_the_drawing_explains(
    mm: float, kinds: list[str], tmp_path: Path
) -> None:
    drawn, real = document(sensor=EXACT), document(sensor=EXACT)
    for machine in (drawn, real):
        for frame in ("base", "tool"):
            machine["frames"][frame]["tolerance"] = {"xyz": 0, "rpy": 0}
    real["frames"]["base"]["xyz"][0] += mm
    assert [f.kind for f in told(tmp_path, drawn, real)] == kinds


def test_a_base_that_nobody_knows_is_nowhere_off(tmp_path: Path) -> None:
    drawn, real = document(sensor=EXACT), document(sensor=EXACT)
    drawn["frames"]["base"]["tolerance"] = {"xyz": float("inf"), "rpy": float("inf")}
    real["frames"]["base"]["xyz"] = [5000.0, 0.0, 0.0]
    assert told(tmp_path, drawn, real) == []


def nameless(convention: str) -> Document:
    """The arm's table without a name, as the readings were made with it, or with rows one joint on."""
    machine = document()
    del machine["mechanism"]["convention"]
    joints = machine["mechanism"]["joints"]
    if convention == "modified":
        before = [{"a": 0.0, "alpha": 0.0}, *({k: row[k] for k in ("a", "alpha")} for row in joints)]
        machine["mechanism"]["joints"] = [row | old for row, old in zip(joints, before, strict=False)]
    return machine


@pytest.mark.parametrize(
    ("convention", "words"),
    [("standard", "a data sheet's standard table"), ("modified", "a modified table (Craig)")],
)
def test_a_table_without_a_name_is_that_of_which_the_readings_are(
    convention: str, words: str, tmp_path: Path
) -> None:
    path, rows = written(tmp_path, nameless(convention), recorded()[:20])
    pair = Pair.read(path, [rows])
    check = unnamed_table(pair, [rows])
    assert check is not None
    (found,) = check.found
    assert (found.kind, found.where) == ("dh-convention", ("mechanism.joints", "mechanism.convention"))
    assert found.says == f"the joints have a field 'a' and no convention is stated; as {words} they fit best"
    assert found.fix == f"state 'convention: {convention}' beside 'joints'"
    assert (found.verdict, found.before, found.unit, check.rows) == ("wrong", None, "mm", 20)
    # tolerances of the arm: 0.2 mm and 0.05 deg over a metre
    assert found.after is not None and found.after == check.left and 0.1 < found.after < 5.0
    assert found.mend is not None
    assert found.mend(pair).get(("mechanism", "convention")) == convention


def _named(machine: Document) -> None:
    machine["mechanism"]["convention"] = "standard"


def _hexapod(machine: Document) -> None:
    machine["mechanism"]["type"] = "6-ups"


def _without_a(machine: Document) -> None:
    for row in machine["mechanism"]["joints"]:
        del row["a"]


def _no_rows(machine: Document) -> None:
    machine["mechanism"]["joints"] = "six"


def _otherwise(machine: Document) -> None:
    machine["sensor"]["type"] = "guess"


def _nothing(machine: Document) -> None:
    machine["mechanism"] = "arm"


@pytest.mark.parametrize("change", [_named, _hexapod, _without_a, _no_rows, _otherwise, _nothing])
def test_other_faults_of_a_file_are_no_matter_of_names(change: Any, tmp_path: Path) -> None:
    machine = nameless("standard")
    change(machine)
    path, rows = written(tmp_path, machine, recorded()[:20])
    assert unnamed_table(Pair.read(path, [rows]), [rows]) is None
