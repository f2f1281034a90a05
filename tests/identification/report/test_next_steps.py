"""What to do next, what improved.yaml holds, and before and after: each follows from the result alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from support.told_diagnoses import diagnosis, finding
from truepose.errors import InputError
from truepose.identification.diagnosis.result import (
    UNNAMED,
    Alternative,
    Applied,
    Diagnosis,
    Finding,
    PoseError,
    Proof,
)
from truepose.identification.fit.summary import FitSummary
from truepose.identification.report.applied_words import (
    applied_words,
    check_applicable,
    expected_pose,
    expected_words,
    pose_json,
)
from truepose.identification.report.before_after import before_after_words, rms_words, sensor_unit
from truepose.identification.report.calibration_words import (
    calibrated_headline,
    calibrated_words,
    nothing_against,
)
from truepose.identification.report.verdict import misfit_clause
from truepose.identification.report.next_steps import after_calibration, after_diagnosis
from truepose.models.file.machine_file import ExpectedPose
from truepose.models.machine.machine import Machine

OUT = Path("out")
NAN = float("nan")
GOOD = PoseError(0.5, 0.2)
WHOLE = Applied("whole", "role", GOOD, 0.4, GOOD, 0.4)
PLAIN = Applied("plain", "role", PoseError(0.5, 0.5), 1.0, PoseError(0.5, 0.9), 1.2)
USE = "truepose codegen out/improved.yaml -o controller"
CHECK = "next: units, signs, order, frames: truepose check MACHINE RECORDING"


def steps(found: Diagnosis, *, calibrated: bool = True) -> list[str]:
    return after_diagnosis(found, OUT, calibrated=calibrated)


def open_one(effect: str = "backlash", probability: float = 0.6, **more: Any) -> Finding:
    return replace(finding(probability, 1), effect=effect, **more)


def test_what_is_no_calibration_is_looked_at_first() -> None:
    assert steps(diagnosis("missing-physics", open_one(), applied=WHOLE), calibrated=False) == [CHECK]
    machine = diagnosis("adequate").nominal
    assert after_calibration(machine, OUT, calibrated=False, doubtful=False) == [CHECK]
    use = "truepose codegen out/calibrated.yaml -o controller"
    assert after_calibration(machine, OUT, calibrated=True, doubtful=False) == [f"next: {use}"]
    find = "next: what is missing: truepose diagnose MACHINE RECORDING -o diagnosis"
    assert after_calibration(machine, OUT, calibrated=True, doubtful=True) == [find, f"or: {use}"]


@pytest.mark.parametrize(
    ("verdict", "applied", "used"),
    [
        ("adequate", None, True), ("adequate", PLAIN, True), ("missing-physics", WHOLE, True),
        ("missing-physics", PLAIN, False), ("missing-physics", None, False),
    ],
)  # fmt: skip
def test_a_result_that_gains_something_is_used(verdict: str, applied: Applied | None, used: bool) -> None:
    assert steps(diagnosis(verdict, applied=applied)) == ([f"next: {USE}"] if used else [])
    assert steps(diagnosis("unknown", applied=applied)) == [
        CHECK,
        *([f"then: {USE}"] if applied is WHOLE else []),
    ]


def test_what_tells_open_names_apart_is_planned() -> None:
    """Not for a name that is certain, of rows, without rivals that have a name and can be tested, or without a name itself."""
    plan = f"truepose plan MACHINE -n 40 -o poses.csv --diagnosis {OUT / 'diagnosis.json'}"
    assert steps(diagnosis("missing-physics", open_one())) == [f"next: tell them apart: {plan}"]
    nameless = Alternative(UNNAMED, ("q2",), 0.1, 36.0)
    untested = Alternative("friction-hysteresis", ("q2",), 0.1, 36.0, tested=False)
    for decided in (
        open_one(probability=0.9999), open_one("outliers"), open_one("empirical"),
        open_one(equivalents=()), open_one(equivalents=(nameless,)), open_one(equivalents=(untested,)),
    ):  # fmt: skip
        assert steps(diagnosis("missing-physics", decided)) == []
        assert steps(diagnosis("unknown", decided)) == [CHECK]
    both = steps(diagnosis("unknown", open_one(experiment="reverse it"), applied=WHOLE))
    assert both == [f"next: tell them apart: {plan}", "  or: reverse it", f"then: {USE}"]
    sure = replace(finding(0.9999, 1), place=("q7",))
    # the option names the finding only where it is not the one that is taken without it
    (second,) = steps(diagnosis("missing-physics", sure, open_one()))
    assert second.endswith(f"{plan} --discriminate backlash@q1+q2")


def test_a_long_command_keeps_to_the_width_with_less_of_it() -> None:
    for length, starts in (
        (20, "next: tell them apart: truepose plan {} -n 40"),
        (45, "next: tell them apart: truepose plan MACHINE -n 40"),
        (200, "next: tell them apart: truepose plan MACHINE -n 40"),
    ):
        path = "m" * (length - 5) + ".yaml"
        machine = SimpleNamespace(
            name="arm", file=SimpleNamespace(path=Path(path)), residual_units={"position": "mm"}
        )
        (line,) = after_diagnosis(
            diagnosis("missing-physics", open_one(), nominal=machine), OUT, calibrated=True
        )
        assert line.startswith(starts.format(path)) and len(line) <= 110


def test_a_command_that_no_line_holds_has_nothing_but_what_it_needs() -> None:
    machine = SimpleNamespace(
        name="arm", file=SimpleNamespace(path=Path("m.yaml")), residual_units={"position": "mm"}
    )
    far = Path("o" * 120)
    sure = replace(finding(0.9999, 1), place=("q7",))
    found = diagnosis("missing-physics", sure, open_one(), nominal=machine)
    (line,) = after_diagnosis(found, far, calibrated=True)
    assert line == f"next: truepose plan MACHINE -n 40 -o poses.csv --diagnosis {far / 'diagnosis.json'}"


# -- what improved.yaml holds --------------------------------------------------------------------------

WHERE = "on the validation rows, after a rigid refit"
GAINED = f"Error of the tool's position, {WHERE}: 500 µm with plain calibration, 200 µm with improved.yaml."
BOTH = GAINED.replace(
    "500 µm with plain calibration", "900 µm with the ordinary fit, 500 µm held to the drawing"
)
UNREAD = "Whether the tool's pose gains is not judged: no sensor reads its position, or not in enough rows."
HELD = "improved.yaml holds effects with a name alone."


@pytest.mark.parametrize(
    ("applied", "said"),
    [
        (None, []),
        (WHOLE, [GAINED]),
        (replace(WHOLE, baselines={"ordinary": 0.9, "drawing": 0.5}), [BOTH]),
        (replace(WHOLE, pose=None), [UNREAD]),
        (replace(WHOLE, model="names", whole_pose=None, whole_ratio=NAN), [GAINED]),
        (replace(WHOLE, model="names"), [GAINED]),
        (
            replace(WHOLE, model="names", whole_pose=PoseError(0.5, 0.6)),
            [GAINED, f"With all that was found the tool would be worse ({WHERE}: 500 µm with plain calibration, 600 µm):"
             " improved.yaml holds effects with a name alone."],
        ),
        (
            replace(WHOLE, model="sure-names", whole_pose=None, whole_ratio=1.25),
            [GAINED, "With all that was found, readings that were not fitted get worse (rms 1.25 of plain calibration's):"
             " improved.yaml holds effects whose place and driver are sure alone."],
        ),
        (
            replace(WHOLE, model="names", whole_ratio=0.9),
            [GAINED, f"With all that was found geometry leaves its tolerances, or predicts held-out rows less well: {HELD}"],
        ),
        (
            replace(WHOLE, model="names", whole_pose=PoseError(0.5, 0.3)),
            [GAINED, f"Held out, that is 300 µm with all that was found: {HELD}"],
        ),
        (
            replace(PLAIN, whole_pose=PoseError(0.5, 0.5), whole_ratio=0.9),
            ["With all that was found geometry leaves its tolerances, or predicts held-out rows less well:"
             " improved.yaml holds plain calibration."],
        ),
        (
            PLAIN,
            [f"With all that was found the tool would be worse ({WHERE}: 500 µm with plain calibration, 900 µm):"
             " improved.yaml holds plain calibration."],
        ),
    ],
)  # fmt: skip
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
    assert expected_pose(own) == ExpectedPose("plain calibration", 0.5, 0.2, rows)
    assert f"on {rows}, after a rigid refit" in applied_words(own)[0]
    assert expected_pose(None) is None and expected_pose(replace(own, pose=None)) is None


def machine_of(**file: Any) -> Machine:
    given = {"path": Path("a.yaml"), "nominal": {"a": 1.0}, "pose_error": None, "refused": (), **file}
    return cast(Machine, SimpleNamespace(name="arm", file=SimpleNamespace(**given)))


def test_a_file_says_what_to_expect_of_the_tool() -> None:
    told = ExpectedPose("plain calibration", 0.5, 0.2, "the validation rows")
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
        check_applicable(machine_of(pose_error=replace(told, after=0.6)))
    with pytest.raises(InputError, match=r"a\.yaml: NOT CALIBRATED: far off; odd; find the mistake"):
        check_applicable(machine_of(refused=("far off", "odd")))


# -- before and after ----------------------------------------------------------------------------------


def judged(before: float, after: float, held: float | None = None, **more: Any) -> Diagnosis:
    fits = {
        name: SimpleNamespace(
            chi2_per_dof=1.0,
            rms={"position": size},
            validation_rms=None if held is None else {"position": held * size},
        )
        for name, size in (("free", 0.9 * before), ("before", before), ("after", after))
    }
    return diagnosis("missing-physics", fits=fits, **{"terms": ("one",), **more})


def test_what_was_held_out_in_turn_is_told_where_there_are_no_other_rows() -> None:
    fell = Proof("blocks", (), 0.42, (0.3, 0.5), None, None, None)
    in_turn = "; held out in turn, rms falls to 0.420 of plain calibration's"
    line = "position: 0.270 mm with the ordinary fit, 0.300 mm held to the drawing, 0.200 mm after on the fitted rows"
    assert before_after_words(judged(0.3, 0.2)) == [line]
    assert before_after_words(judged(0.3, 0.2, proof=fell)) == [line + in_turn]
    for ratio in (1.0, 1.2, NAN):
        assert before_after_words(judged(0.3, 0.2, proof=replace(fell, ratio=ratio))) == [line]
    assert before_after_words(judged(0.3, 0.2, 2.0, proof=fell)) == [
        "position: 0.540 mm with the ordinary fit, 0.600 mm held to the drawing, 0.400 mm after on held-out rows"
    ]
    assert before_after_words(judged(0.3, 0.2, proof=fell, terms=())) == [
        "position: 0.200 mm rms on the fitted rows"
    ]
    for name in ("free", "before", "after"):
        mixed = judged(0.3, 0.2, 2.0)
        mixed.fits[name].validation_rms = None  # type: ignore[misc]
        assert before_after_words(mixed) == [line]  # held-out rows of some fits alone are beside nothing
    (unknown,) = before_after_words(judged(NAN, 0.02))
    assert unknown.startswith("position: - with the ordinary fit, - held to the drawing, 20.0 µm after")


@pytest.mark.parametrize(
    ("size", "unit", "told"),
    [(0.1, "mm", (1.0, "mm")), (0.0999, "mm", (1e3, "um")), (0.5, "rad", (1e3, "mrad")), (0.0, "mm", (1.0, "mm")),
     (0.0, "rad", (1.0, "rad"))],
)  # fmt: skip
def test_millimetres_are_told_from_a_tenth_on(size: float, unit: str, told: tuple[float, str]) -> None:
    assert sensor_unit(size, unit) == told


def test_three_kinds_of_reading_are_told() -> None:
    sizes = {kind: 0.01 * k for k, kind in enumerate("abcd", 1)}
    assert rms_words(sizes, dict.fromkeys("abcd", "mm"), "here") == [
        "a: 10.0 µm rms here", "b: 20.0 µm rms here", "c: 30.0 µm rms here",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("chi2", "worst", "good"),
    [(1.0, 3.0, True), (1.3, 3.1, True), (1.31, 3.0, False), (1.0, 3.11, False), (NAN, NAN, True)],
)
def test_a_calibration_is_good_where_misfit_and_constants_are_those_of_a_true_model(
    chi2: float, worst: float, good: bool
) -> None:
    told = FitSummary({"position": 0.012}, chi2, {"position": 0.013}, worst, "q1.d", 3.1)
    assert nothing_against(told) is good
    said, fine = calibrated_words("arm", told)
    assert fine is good and ("Something may be missing" in said) is not good
    assert (" (within the 3.10 that" if not worst > 3.1 else " (beyond the 3.10 that") in said
    channels = [
        SimpleNamespace(name=f"P1.{axis}", unit="mm", sigma=0.01, kind="position", point="P1")
        for axis in "xyz"
    ]
    machine = cast(Machine, SimpleNamespace(name="arm", residual_units={"position": "mm"}, channels=channels))
    line, fine = calibrated_headline(machine, told)
    outcome = "is calibrated" if good else "was fitted, but the fit leaves more than noise"
    assert fine is good and said.startswith(f"arm {outcome}: ")
    assert line.startswith(
        f"arm {outcome}: it misses the position of rows that were not fitted by 13.0 µm;"
        " the instrument alone makes 17.3 µm."
    )
    assert line.endswith(" Something may be missing.") is not good
    fitted, _ = calibrated_headline(machine, replace(told, validation_rms=None))
    assert fitted.startswith(f"arm {outcome}: it misses the position by 12.0 µm; the instrument alone")
    assert calibrated_headline(machine, replace(told, rms={}, validation_rms=None)) == calibrated_words(
        "arm", replace(told, rms={}, validation_rms=None)
    )
    for channel in channels:
        channel.sigma = 1.0
    coarse, _ = calibrated_headline(machine, told)  # one unit for both, that of the larger one
    assert "were not fitted by 0.0130 mm; the instrument alone makes 1.73 mm." in coarse


@pytest.mark.parametrize(("chi2", "said"), [(0.77, False), (0.76, True), (1.3, False), (1.31, True)])
def test_a_misfit_is_spoken_of_beyond_its_limits(chi2: float, said: bool) -> None:
    found = judged(1.0, 1.0)
    found.fits["after"].chi2_per_dof = chi2  # type: ignore[misc]
    assert bool(misfit_clause(found)) is said


@pytest.mark.parametrize(
    ("noise", "explains"),
    [(1.0, False), (1.08, False), (1.1, True), (1.22, True), (1.36, True), (1.4, False)],
)
def test_noise_explains_a_misfit_of_its_own_square_to_a_quarter(noise: float, explains: bool) -> None:
    found = replaced(judged(1.0, 1.0), verdict="adequate", noise=noise)
    found.fits["after"].chi2_per_dof = 1.5  # type: ignore[misc]
    assert ("noise of that size explains it" in misfit_clause(found)) is explains


def replaced(found: Diagnosis, **more: Any) -> Diagnosis:
    return cast(Diagnosis, SimpleNamespace(**{**vars(found), **more}))
