"""Notes on a corrected program: what was taken for granted is said, each with the option that tells otherwise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from support.results import machine
from truepose.identification.leaves.programs.correct import NEARBY, Corrected, Correction
from truepose.identification.leaves.programs.program import Left, Target
from truepose.identification.leaves.programs.words import (
    Limit,
    correction_json,
    correction_lines,
    correction_notes,
)

NOTHING = Correction("", (), (), {}, 0.0, (), None, (0, 0))
NO_NOMINAL = "the machine file has no `nominal:`; its own constants are taken for the controller's"


def test_nothing_taken_for_granted_is_nothing_said() -> None:
    assert correction_notes(NOTHING, machine(), Limit()) == [NO_NOMINAL]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"drivers": {"payload": 2.5, "temperature.base": 20.0}}, "at all targets: payload = 2.5, temperature.base = 20; --at"),
        ({"unnamed": (3, 0)}, "poses that name no base (3) stand in the robot's own; --base"),
        ({"unnamed": (0, 4)}, "poses that name no tool (4) are the machine file's tool's; --tool"),
        ({"assumed": ("gun", "pen")}, "taken for the machine file's tool: gun, pen; --frame"),
        ({"arrival": 0.0123}, "they count as halfway, which is up to 0.0123 mm at the tool"),
        ({"nearby": 0.456}, "it should be another by up to 0.456 mm"),
    ],
)  # fmt: skip
def test_each_thing_taken_for_granted_is_one_note(given: dict[str, object], said: str) -> None:
    notes = correction_notes(replace(NOTHING, **given), machine(), Limit())  # type: ignore[arg-type]
    assert len(notes) == 2 and said in notes[0] and notes[1] == NO_NOMINAL


@pytest.mark.parametrize(("count", "says"), [(1, "1 place is"), (2, "2 places are")])
def test_places_that_are_left_have_their_lines(count: int, says: str) -> None:
    left = tuple(Left(7 + k, "P1", "why") for k in range(count))
    lines = correction_lines(replace(NOTHING, left=left), "title", machine().file.path, machine().file.path)  # type: ignore[union-attr]
    assert lines[0].endswith(": 0 targets corrected, title")
    assert lines[1] == f"  {says} not corrected, or not wholly:"
    assert [line.partition(".yaml")[2] for line in lines[2:]] == [f":{7 + k}: P1: why" for k in range(count)]


# -- sizes ---------------------------------------------------------------------------------------------


def corrected(line: int, position: float, rotation: float = 0.0, **more: Any) -> Corrected:
    """A target whose correction has this size: mm, deg."""

    def twist(share: float) -> NDArray[np.float64]:
        turn = np.radians(rotation) * share
        return np.array([0.6 * position * share, 0.8 * position * share, 0.0, 0.0, 0.6 * turn, 0.8 * turn])

    given: dict[str, Any] = {
        "change": twist(1.0),
        "before": twist(2.0),
        "after": twist(0.01),
        "reconfigured": False,
    }
    target = Target(line, f"P{line}", "pose", ())
    return Corrected(target, (), **{**given, **more})


def test_corrections_are_told_by_their_median_and_their_largest() -> None:
    done = (corrected(1, 1.0, 0.1), corrected(2, 3.0, 0.3), corrected(3, 8.0, 0.2))
    file = Path("a.mod")
    lines = correction_lines(
        replace(NOTHING, done=done, left=(Left(7, "P7", "why"),)), "title", file, Path("b.mod")
    )
    assert lines == [
        "b.mod: 3 targets corrected, title",
        "  correction: median 3 mm, 0.2 deg, largest 8 mm, 0.3 deg",
        "  largest pose error, as the calibrated model has it: 16 mm, 0.6 deg with the program as it was, 0.08 mm, 0.003 deg"
        " with this one, rounding of its numbers included",
        "  1 place is not corrected, or not wholly:",
        "    a.mod:7: P7: why",
    ]
    (one, *_) = correction_lines(replace(NOTHING, done=done[:1]), "title", file, Path("b.mod"))
    assert one == "b.mod: 1 target corrected, title"
    assert len(correction_lines(replace(NOTHING, done=done), "title", file, file)) == 3


@pytest.mark.parametrize(
    ("position", "rotation", "told"),
    [(4.99, 0.99, False), (5.01, 0.0, True), (0.0, 1.01, True), (9.0, 9.0, True)],
)
def test_a_correction_beyond_either_limit_is_pointed_out(
    position: float, rotation: float, told: bool
) -> None:
    found = replace(NOTHING, done=(corrected(4, position, rotation),))
    notes = correction_notes(found, machine(), Limit())
    beyond = [
        note for note in notes if note.startswith("corrections of more than 5 mm or 1 deg: line 4 (P4, ")
    ]
    assert bool(beyond) is told and len(notes) == 1 + told
    listed = correction_json(found, Limit())["beyond_limit"]
    assert isinstance(listed, list) and len(listed) == told
    if told:
        assert listed[0]["line"] == 4 and listed[0]["target"] == "P4"
        assert listed[0]["position"] == {"value": pytest.approx(position), "unit": "mm"}
        assert listed[0]["rotation"] == {"value": pytest.approx(np.radians(rotation)), "unit": "rad"}


@pytest.mark.parametrize(("count", "more"), [(5, ""), (6, ", and 1 more"), (9, ", and 4 more")])
def test_a_note_names_five_lines(count: int, more: str) -> None:
    done = tuple(corrected(k, 0.1, reconfigured=k != 3) for k in range(count + 1))
    notes = correction_notes(replace(NOTHING, done=done), machine(), Limit())
    told = [k for k in range(count + 1) if k != 3][:5]
    names = ", ".join(f"line {k} (P{k})" for k in told)
    assert (
        notes[0]
        == f"axes pass a border, so that numbers of the configuration changed with them: {names}{more}"
    )


def test_the_same_as_data() -> None:
    done = (corrected(1, 1.0), corrected(2, 3.0), corrected(3, 8.0, reconfigured=True))
    found = replace(
        NOTHING, done=done, left=(Left(7, "P7", "why"),), nearby=0.4, unnamed=(3, 4), arrival=0.01
    )
    document = correction_json(found, Limit())
    assert document["targets"] == 3 and document["reconfigured"] == [3]
    sizes = cast("dict[str, dict[str, dict[str, float]]]", document["correction"])
    assert (sizes["median"]["position"]["value"], sizes["largest"]["position"]["value"]) == pytest.approx(
        (3.0, 8.0)
    )
    errors = cast("dict[str, dict[str, dict[str, float]]]", document["largest_error"])
    assert (errors["before"]["position"]["value"], errors["after"]["position"]["value"]) == pytest.approx(
        (16.0, 0.08)
    )
    assert document["left"] == [{"line": 7, "what": "P7", "why": "why"}]
    assert (document["without_base"], document["without_tool"]) == (3, 4)
    assert document["nearby"] == {"value": 0.4, "unit": "mm", "distance": {"value": NEARBY, "unit": "mm"}}
    bare = correction_json(NOTHING, Limit())
    assert bare["nearby"] is None and "correction" not in bare and "largest_error" not in bare
