"""Notes on a corrected program: what was taken for granted is said, each with the option that tells otherwise."""

from __future__ import annotations

from dataclasses import replace

import pytest

from support.results import machine
from truepose.identification.programs.correct import Correction
from truepose.identification.programs.program import Left
from truepose.identification.report.program_words import Limit, correction_lines, correction_notes

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
