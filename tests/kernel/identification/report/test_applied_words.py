"""What improved.yaml holds and why, and what a machine file says of the tool's position before it is applied."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from truepose.errors import InputError
from truepose.identification.diagnosis.result import Applied, PoseError
from truepose.identification.report.applied_words import (
    applied_words,
    check_applicable,
    expected_pose,
    expected_words,
    pose_json,
)
from truepose.models.file.sections import ExpectedPose
from truepose.models.machine.machine import Machine

NAN = float("nan")
GOOD = PoseError(0.5, 0.2)
WHOLE = Applied("whole", "role", GOOD, 0.4, GOOD, 0.4)
NAMES = replace(WHOLE, model="names")
PLAIN = Applied("plain", "role", PoseError(0.5, 0.5), 1.0, PoseError(0.5, 0.9), 1.2)
UNREAD = "Whether the tool's pose gains is not judged: no sensor reads its position, or not in enough rows."
HELD = "improved.yaml holds effects with a name alone. With all that was found"
WORSE = "held-out readings or the tool get worse, or geometry leaves its tolerances."


@pytest.mark.parametrize(
    ("applied", "said"),
    [
        (None, []),
        (WHOLE, []),
        (replace(WHOLE, pose=None), [UNREAD]),
        (replace(NAMES, whole_pose=None, whole_ratio=NAN), []),
        (NAMES, []),
        (
            replace(NAMES, whole_pose=PoseError(0.5, 0.6)),
            [f"{HELD} the tool would be worse: 600 µm, 500 µm with plain calibration."],
        ),
        (replace(NAMES, whole_ratio=0.9), [f"{HELD} {WORSE}"]),
        (
            PLAIN,
            [
                "improved.yaml holds plain calibration. With all that was found the tool would be worse:"
                " 900 µm, 500 µm with plain calibration."
            ],
        ),
    ],
)
def test_what_the_file_holds_and_why(applied: Applied | None, said: list[str]) -> None:
    assert applied_words(applied) == said


@pytest.mark.parametrize(
    ("held_out", "rows"),
    [
        ("role", "the validation rows"),
        ("blocks", "rows held out in turn"),
        ("none", "the fitted rows"),
        ("x", "x"),
    ],
)
def test_the_rows_on_which_the_tool_was_judged(held_out: str, rows: str) -> None:
    own = replace(WHOLE, held_out=held_out)
    assert expected_pose(own) == ExpectedPose(than="plain calibration", before=0.5, after=0.2, rows=rows)
    assert expected_pose(None) is None and expected_pose(replace(own, pose=None)) is None


def machine_of(**file: Any) -> Machine:
    given = {"path": Path("a.yaml"), "nominal": {"a": 1.0}, "pose_error": None, "refused": (), **file}
    return cast(Machine, SimpleNamespace(name="arm", file=SimpleNamespace(**given)))


def test_a_file_says_what_to_expect_of_the_tool() -> None:
    told = ExpectedPose(than="plain calibration", before=0.5, after=0.2, rows="the validation rows")
    judged = machine_of(pose_error=told)
    assert expected_words(judged) == (
        "expected error of the tool's position (the validation rows, after a rigid refit):"
        " 500 µm with plain calibration, 200 µm with this file"
    )
    assert pose_json(judged) == {
        "than": "plain calibration", "before": 0.5, "after": 0.2, "unit": "mm", "rows": "the validation rows",
    }  # fmt: skip
    bare = cast(Machine, SimpleNamespace(name="arm", file=None))
    for machine, said in (
        (bare, "not known, the file was not calibrated"),
        (machine_of(nominal={}), "not known, the file was not calibrated"),
        (machine_of(), "not judged, no sensor read it in enough rows"),
    ):
        assert expected_words(machine).endswith(said) and pose_json(machine) is None
        check_applicable(machine)
    check_applicable(judged)
    with pytest.raises(
        InputError, match=r"found 0\.6 mm with this file, expected no more than the 0\.5 mm with plain"
    ):
        check_applicable(machine_of(pose_error=told.model_copy(update={"after": 0.6})))
    with pytest.raises(InputError, match=r"a\.yaml: NOT CALIBRATED: far off; odd; find the mistake"):
        check_applicable(machine_of(refused=("far off", "odd")))
