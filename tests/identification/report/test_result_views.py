"""The first screen of every result: its headline, gains, lists, table and steps, from what the result holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.examples import examples
from support.reports import (
    NAN,
    diagnosis_lines,
    fitted,
    gear,
    gear_finding,
    of,
    recorded,
    summary,
    summary_items,
)
from support.results import RESULTS
from support.told_drift import CHANGED, movement, told_drift
from truepose.identification.compensation.inverse import Inverse, Reach
from truepose.identification.compensation.rows import Compensation
from truepose.identification.diagnosis.result import (
    UNNAMED,
    Alternative,
    Applied,
    Diagnosis,
    Finding,
    Form,
    Lead,
    Levels,
    PoseError,
    Proof,
    Quantity,
    Remainder,
    Replication,
    Together,
)
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.identifiability.analysis import Identifiability, ParameterSight
from truepose.identification.identifiability.note import Note
from truepose.identification.report.documents import calibration_document, diagnosis_document
from truepose.identification.report.gains import diagnosis_gains, pose_gain, sensor_unit
from truepose.identification.report.numbers import significant
from truepose.identification.report.results import diagnosis_json, diagnosis_summary
from truepose.identification.report.steps import calibration_steps, machine_name, recording_names
from truepose.identification.signatures.untestable import Missing
from truepose.models.file.machine_file import ExpectedPose
from truepose.models.machine.machine import Machine
from truepose.shown.document import Command, Items, Table, Text
from truepose.shown.result import Shown, document
from truepose.shown.text import LINES, WIDTH

OUT = Path("out")
ERROR = PoseError(0.5, 0.2)
WHOLE = Applied("whole", "role", ERROR, 0.4, ERROR, 0.4)
PLAIN = Applied("plain", "role", PoseError(0.5, 0.5), 1.0, PoseError(0.5, 0.9), 1.2)
LOAD = Levels(0.99, "load", 0.95)
SURE = replace(gear_finding(), equivalents=())


def table(result: Shown) -> list[list[str]]:
    (found,) = of(document(result).summary, Table)
    return [list(row) for row in found.rows]


def facts(result: Shown) -> list[str]:
    return [item for block in of(document(result).summary, Items) for item in block.items]


def test_what_is_no_result_has_no_document() -> None:
    with pytest.raises(TypeError, match="found a int, expected a result"):
        document(3)


# -- fits ----------------------------------------------------------------------------------------------


def test_a_fit_says_its_misfit_its_rows_and_what_the_readings_see(machine: Machine) -> None:
    own = fitted(machine, recorded(machine))
    free = len(own.prior.free)
    used = own.residual[own.used]
    rms = 10.0 * float(np.sqrt(np.mean(np.sum(used**2, axis=1))))  # µm: a sigma is 0.01 mm
    misfit = significant(own.chi2_per_dof)
    assert document(own).headline == f"Estimate of arm: misfit chi2/dof {misfit}, rms position {rms:.1f} µm"
    rows = f"25 rows fitted, 75 readings{{}}; the readings see {free - 1} of {free} directions of the free constants"
    assert facts(own) == [rows.format("")]
    assert facts(replace(own, unassembled=(3, 4))) == [rows.format(", 2 rows cannot be assembled")]
    label = gear(machine).label
    assert facts(fitted(machine, recorded(machine), (gear(machine),)))[1] == f"effects: {label}"


def test_constants_stand_the_farthest_from_the_drawing_first(machine: Machine) -> None:
    """Those without a tolerance last, without a number of them."""
    own = fitted(machine, recorded(machine), (gear(machine),))
    far = [abs(float(row[-2])) if row[-2] != "-" else -1.0 for row in table(own)]
    assert far == sorted(far, reverse=True) and far[0] > 0.0 and far[-1] == -1.0
    frame = own.to_frame().set_index("parameter")
    for name, drawing, value, *_, away, unit in table(own):
        if name in frame.index:
            row = frame.loc[name]
            assert float(value) == pytest.approx(row["value"], abs=0.02 * abs(row["std"]) + 1e-5)
            assert float(drawing) == pytest.approx(row["nominal"], rel=1e-5, abs=1e-9)
            assert unit == row["unit"] and float(away) == pytest.approx(row["in_tolerances"], rel=1e-2)


def calibrated(machine: Machine, away: float = 1.0, **method: str) -> Calibration:
    recording = recorded(machine)
    given = {"estimator": "map", "solver": "gn"} | method
    return Calibration(fitted(machine, recording, away=away), None, recording, ("a note",), given)


def test_a_calibration_says_rows_that_do_not_fit_its_gain_and_how_sure_it_is(machine: Machine) -> None:
    found = calibrated(machine, 0.1)
    far = [{"file": "day/r.csv", "row": 3, "sigma": 9.0}]
    told = calibration_document(found, far, ExpectedPose("nominal", 0.5, 0.2, "20 rows held out"), OUT)
    assert told.headline == "arm is calibrated: nothing speaks against the fit." and told.tone == "good"
    tool, position = told.gains
    assert (tool.kind, tool.before, tool.after) == ("tool position error, rms", "0.500 mm", "0.200 mm")
    assert tool.note == "on 20 rows held out, after a rigid refit" and tool.shares == pytest.approx(
        (1.0, 0.4, 0.0)
    )
    held = 10.0 * float(np.sqrt(np.mean(np.sum(found.fit.residual[found.recording.validation] ** 2, axis=1))))
    assert (position.before, position.after, position.note) == ("", f"{held:.1f} µm", "on held-out rows")
    rows, sure = of(told.summary, Items)
    assert rows.title == "Rows that do not fit" and rows.items[0].startswith("row 3 of r.csv does not fit")
    free = len(found.fit.prior.free)
    assert [item.split(";")[0] for item in sure.items][
        2
    ] == f"{free - 1} of {free} directions are seen by the readings"
    assert "(within the 3" in sure.items[1] or "(within the" in sure.items[1]
    assert told.notes == ("a note",)
    assert [getattr(step, "command", "") for step in told.steps] == [
        "truepose codegen out/calibrated.yaml -o controller"
    ]
    assert (
        not calibration_document(replace(found, recording=replace(found.recording)), [], None).gains[0].before
    )


@pytest.mark.parametrize("estimator", ["map", "huber", "ols", "liu", "ridge", "pcr"])
def test_what_decides_unseen_directions_is_the_estimator_s(machine: Machine, estimator: str) -> None:
    held = (
        "tolerances decide the others" if estimator in ("map", "huber") else "the others stay at the drawing"
    )
    assert summary_items(calibrated(machine, estimator=estimator), "How sure")[2].endswith(f"; {held}")


def test_a_fit_that_leaves_more_than_noise_or_is_no_calibration_is_not_applied_first(
    machine: Machine,
) -> None:
    far = document(calibrated(machine, 20.0))
    assert "leaves more than noise" in far.headline and far.tone == "warn"
    commands = [getattr(step, "command", "") for step in far.steps]
    assert [line.split()[1] for line in commands] == ["diagnose", "codegen"]
    wild = document(calibrated(machine, 900.0))
    assert wild.headline.startswith("NOT CALIBRATED: ")
    assert [step.command for step in of(wild.steps, Command)] == ["truepose check arm.yaml a&b.csv"]
    files = ["/far/off/a.csv", "my rows.csv"]
    (use,) = calibration_steps(machine, files, None, calibrated=True, doubtful=False)
    assert use == Command("truepose codegen calibrated.yaml -o controller", "apply it, as C:")
    assert recording_names(files) == "a.csv my\\ rows.csv"
    assert recording_names(files, whole=True) == "/far/off/a.csv my\\ rows.csv"
    assert machine_name(machine) == "arm.yaml" and machine_name(replace(machine, file=None)) == "MACHINE"


# -- diagnoses and findings ----------------------------------------------------------------------------


def test_a_diagnosis_is_told_in_this_order(plain: Diagnosis) -> None:
    found = replace(
        plain,
        applied=replace(WHOLE, baselines={"ordinary": 0.9, "drawing": 0.5}),
        findings=(replace(gear_finding(), levels=LOAD, probability=0.6),),
        missing=(Missing(("latency",), "no `time`", "add it"),),
        together=(Together("load", ("q1", "q2"), 0.98),),
        remainder=Remainder(("q1",), "temperature.air", Form("curve"), 1.5, {"position": 0.004}),
        disagreement=0.2,
        outlier_rows=tuple(range(1, 15)),
    )
    starts = [
        "The model of arm misses that something at q1 follows the weight carried (95.0 %)",
        "  tool position error, rms: 0.900 mm with the ordinary fit, 0.500 mm held to the drawing, 0.200 mm after; on",
        "  position error, rms: 13.0 µm with the ordinary fit, 13.0 µm held to the drawing, 13.0 µm after; on",
        "  something at q1 follows the weight carried: 95.0 %; which law is open",
        "  together: q1 or q2: at least one follows",
        "  remainder: 1.50 sigma rms, q1 errs as a smooth curve in temperature.air; hypothesised; modelling it",
        "  against it: Probabilities are known to 20 % only",
        "  could not be tested: latency between joints and sensor (latency): no `time`; add it",
        "  could not be tested: thermal expansion (thermal-expansion): no temperature.link1 column",
        "  14 rows excluded as outliers: rows 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12 and 2 more",
        "  chi2 per degree of freedom: free 1.02, before 9.00, after 1.01",
        "next, tell explanations apart: truepose plan ",
        "next: or: sweep q1 alone; against encoder-eccentricity: turn the disc",
        "next, apply it, as C: truepose codegen out/improved.yaml -o controller",
    ]
    told = [line for line in diagnosis_lines(found, OUT, 40) if not line.startswith("    ")]
    assert len(told) == len(starts) + 1  # the headline has two lines
    for line, start in zip([told[0], *told[2:]], starts, strict=True):
        assert line.startswith(start[:90]), line


WORDS = st.text(alphabet="abcdefgh ", min_size=1, max_size=400).map(lambda t: t.strip() or "a")
NAMES = st.sampled_from(["q1", "leg3.a.x", "a-place-with-quite-a-long-name", "sensor"])
PROBABILITY = st.floats(0.0, 1.0)


@st.composite
def findings(draw: st.DrawFn) -> Finding:
    place = tuple(draw(st.lists(NAMES, min_size=1, max_size=20)))
    rivals = [
        Alternative(draw(st.sampled_from(["backlash", UNNAMED])), place, draw(PROBABILITY), 1.0)
        for _ in range(draw(st.integers(0, 8)))
    ]
    count = draw(st.sampled_from([0, 1, 3, 4, 126]))
    return replace(
        gear_finding(),
        effect=draw(st.sampled_from(["backlash", "empirical", "transmission-error", "wrong-constant"])),
        place=place,
        probability=draw(PROBABILITY),
        certainty=draw(PROBABILITY),
        equivalents=tuple(rivals),
        parameters={f"{'ab'[k % 2]}{k // 2 + 1}": Quantity(1e-4 * k, 1e-5, "rad") for k in range(count)},
        explanation=draw(WORDS),
        experiment=draw(WORDS),
        replication=draw(st.sampled_from([None, Replication((0.01, 0.9), agree=False)])),
        levels=Levels(draw(PROBABILITY), "load", draw(PROBABILITY)),
    )


@given(st.data())
@settings(max_examples=examples(40), deadline=None)
def test_any_diagnosis_is_told_on_one_screen(plain: Diagnosis, data: st.DataObject) -> None:
    lead, lack = Lead("backlash", ("q1",), Levels(0.5, "load", 0.4), 0.3), ("joint-compliance",) * 3
    found = replace(
        plain,
        verdict=data.draw(st.sampled_from(["adequate", "missing-physics", "unknown"])),
        concealed=data.draw(st.booleans()),
        findings=tuple(data.draw(st.lists(findings(), max_size=12))),
        leading=(lead,) * data.draw(st.integers(0, 5)),
        outlier_rows=tuple(range(data.draw(st.integers(0, 300)))),
        missing=tuple(
            Missing(lack, data.draw(WORDS), data.draw(WORDS)) for _ in range(data.draw(st.integers(0, 6)))
        ),
        remainder=data.draw(st.sampled_from([None, Remainder(("q1",), "q2", Form("linear", 0.4), 1.5)])),
        applied=data.draw(st.sampled_from([None, WHOLE, PLAIN])),
        disagreement=data.draw(st.sampled_from([0.0, 0.2])),
        terms=data.draw(st.sampled_from([(), plain.terms])),
    )
    lines = diagnosis_lines(found)
    assert len(lines) <= LINES
    assert all(len(line) <= WIDTH for line in lines if not line.startswith("next"))
    assert len(repr(found).split("\n")) <= LINES


def test_what_leads_is_told_and_findings_come_with_their_number_of_rows_left_out(plain: Diagnosis) -> None:
    leads = tuple(Lead("backlash", (f"q{k}",), Levels(0.5, "load", 0.4), 0.3) for k in range(14))
    found = replace(plain, verdict="unknown", findings=(), leading=leads)
    assert len(summary_items(found, "Leading, less probable than not")) == 12
    assert summary_items(plain, "Rows left out") == ["2 rows excluded as outliers: rows 7, 19"]
    assert summary_items(replace(plain, outlier_rows=()), "Rows left out") == []
    assert "platform-deformation" not in repr(plain) and "transmission-error" in repr(plain)


@pytest.mark.parametrize(
    ("verdict", "findings", "applied", "commands"),
    [
        ("missing-physics", (replace(gear_finding(), probability=0.8),), WHOLE, ["plan", "codegen"]),
        ("missing-physics", (SURE,), WHOLE, ["codegen"]),
        ("missing-physics", (SURE,), PLAIN, []),
        ("missing-physics", (SURE,), None, []),
        ("missing-physics", (replace(gear_finding(), probability=0.9999),), WHOLE, ["codegen"]),
        ("missing-physics", (replace(gear_finding(), effect="outliers"),), None, []),
        ("missing-physics", (replace(gear_finding(), effect="empirical"),), None, []),
        ("adequate", (), None, ["codegen"]),
        ("unknown", (), None, ["check"]),
        ("unknown", (), WHOLE, ["check", "codegen"]),
    ],
)
def test_what_to_do_next_follows_from_the_result(
    plain: Diagnosis,
    verdict: str,
    findings: tuple[Finding, ...],
    applied: Applied | None,
    commands: list[str],
) -> None:
    found = replace(plain, verdict=verdict, findings=findings, applied=applied)
    told = diagnosis_document(found, OUT)
    assert [step.command.split()[1] for step in of(told.steps, Command)] == commands
    page = [step.command for step in of(document(found).steps, Command)]
    assert all("/" not in line for line in page)  # a page names files alone
    if "check" in commands:
        checked = diagnosis_document(found, OUT, checked=True).steps
        assert isinstance(checked[0], Text) and checked[0].text.startswith("compare with the source: ")


def test_a_plan_names_the_finding_where_it_is_not_the_one_that_is_taken_without(plain: Diagnosis) -> None:
    certain = replace(gear_finding(), probability=0.9999, place=("q2",))
    unsure = replace(gear_finding(), probability=0.8)
    (plan, _) = document(replace(plain, findings=(certain, unsure))).steps
    assert cast(Command, plan).command == (
        "truepose plan arm.yaml -n 40 -o poses.csv --diagnosis diagnosis.json --discriminate transmission-error@q1"
    )
    untested = replace(unsure, equivalents=(replace(unsure.equivalents[0], tested=False),))
    assert document(replace(plain, findings=(untested,))).steps == []


def test_a_finding_says_what_it_could_also_be_and_its_coefficients() -> None:
    told = facts(gear_finding())
    assert document(gear_finding()).headline.endswith(": The gear of joint q1 turns unevenly.")
    also = "could also be: eccentric encoder disc (encoder-eccentricity) at q1 (6.0 %)"
    assert also in told and told[-1].startswith("what would separate it: sweep q1 alone")
    assert table(gear_finding()) == [["a", "0.0003", "1e-05", "rad"], ["b", "-0.0001", "nan", "rad"]]
    alone = replace(gear_finding(), equivalents=(), parameters={"g": Quantity(2.0, 0.125, "1")})
    assert not [fact for fact in facts(alone) if fact.startswith("could also be")]
    assert table(alone) == [["g", "2", "0.12", ""]]


def test_the_brief_document_of_a_diagnosis_is_a_part_of_the_whole(plain: Diagnosis) -> None:
    whole, brief = diagnosis_json(plain), diagnosis_summary(plain, "diagnose", ["a", "b"])
    assert brief.pop("command") == "diagnose" and brief.pop("files") == ["a", "b"]
    assert brief.items() <= whole.items()
    assert {"judgement", "verdict", "findings", "untestable", "fit", "proof", "applied"} <= set(brief)


# -- before and after ----------------------------------------------------------------------------------


def judged(
    plain: Diagnosis, before: float, after: float, held: float | None = None, **more: Any
) -> Diagnosis:
    fits = {
        name: replace(
            summary(1.0, 1.0),
            rms={"position": size},
            validation_rms=None if held is None else {"position": held * size},
        )
        for name, size in (("free", 0.9 * before), ("before", before), ("after", after))
    }
    return replace(plain, fits=fits, **more)


def test_what_was_gained_is_told_on_rows_held_out_where_there_are_any(plain: Diagnosis) -> None:
    fell = Proof("blocks", (), 0.42, (0.3, 0.5), None, None, None)
    (one,) = diagnosis_gains(judged(plain, 0.3, 0.2, proof=None))
    assert (one.before, one.after, one.floor) == ("0.270 mm", "0.200 mm", "the instrument alone: 0.0173 mm")
    assert (one.note, one.each) == (
        "on the fitted rows",
        "0.270 mm with the ordinary fit, 0.300 mm held to the drawing",
    )
    (turn,) = diagnosis_gains(judged(plain, 0.3, 0.2, proof=fell))
    assert turn.note.endswith("; held out in turn, rms falls to 0.420 of plain calibration's")
    for ratio in (1.0, NAN):
        assert (
            "in turn"
            not in diagnosis_gains(judged(plain, 0.3, 0.2, proof=replace(fell, ratio=ratio)))[0].note
        )
    (held,) = diagnosis_gains(judged(plain, 0.3, 0.2, 2.0, proof=fell))
    assert (held.before, held.after, held.note) == ("0.540 mm", "0.400 mm", "on held-out rows")
    (alone,) = diagnosis_gains(judged(plain, 0.3, 0.2, terms=()))
    assert (alone.before, alone.after, alone.note) == ("", "0.200 mm", "on the fitted rows")
    (lost,) = diagnosis_gains(judged(plain, NAN, 0.02))
    assert lost.before == "-" and lost.after == "20.0 µm" and all(np.isfinite(lost.shares))


@given(before=st.floats(1e-6, 1e3), after=st.floats(1e-6, 1e3))
@settings(max_examples=examples(60), deadline=None)
def test_bars_are_as_long_as_the_figures_beside_them(before: float, after: float) -> None:
    found = pose_gain({"x": before}, after, "rows")
    assert found.shares[:2] == pytest.approx((before / max(before, after), after / max(before, after)))
    assert found.before.split()[1] == found.after.split()[1]  # both in one unit


@pytest.mark.parametrize(
    ("size", "unit", "told"),
    [(0.1, "mm", (1.0, "mm")), (0.0999, "mm", (1e3, "um")), (0.5, "rad", (1e3, "mrad")), (0.0, "mm", (1.0, "mm")),
     (0.0, "rad", (1.0, "rad"))],
)  # fmt: skip
def test_millimetres_are_told_from_a_tenth_on(size: float, unit: str, told: tuple[float, str]) -> None:
    assert sensor_unit(size, unit) == told


# -- drift, paths and poses ----------------------------------------------------------------------------


def test_movements_of_a_drift_stand_by_what_became_of_them() -> None:
    kinds = ("unseen", "masked", "still", "anew", "perhaps", "moved")
    found = told_drift(
        *(movement(kind, kind, **({} if k < 3 else CHANGED), hidden=0.004) for k, kind in enumerate(kinds))
    )
    section = document(found).sections()[0]
    (rows,) = of(section.blocks, Table)
    assert [row[1] for row in rows.rows] == ["moved", "perhaps", "anew", "still", "masked", "unseen"]
    assert "cannot be shown" not in repr(found)
    assert document(told_drift(movement("a", "moved", **CHANGED), notes=("a note",))).notes == ["a note"]


def compensated(rows: int) -> Compensation:
    command = np.array([[1.0, -2.0], [0.5, 0.25]])[:rows]
    twist = np.zeros((rows, 6))
    return Compensation(("q1", "q2"), np.zeros((rows, 2)), command, np.zeros((rows, 4, 4)), twist, twist, "C")


def test_a_compensation_says_the_largest_correction_of_each_joint_either_way() -> None:
    assert document(compensated(2)).headline == "Compensation of 2 rows, solved by C"
    assert "largest pose error" in repr(compensated(2))
    assert table(compensated(2)) == [["q1", "1"], ["q2", "2"]]
    assert table(compensated(0)) == [["q1", "0"], ["q2", "0"]]


def test_an_inverse_says_how_many_poses_ended_how_and_what_is_left_at_most() -> None:
    status = np.array([Reach.SOLVED, Reach.JOINT_RANGE, Reach.SOLVED], dtype=np.intp)
    found = Inverse(
        ("q1",), np.array([[0.5], [1.0], [1.5]]), np.zeros((3, 0)), np.array([0.0, 0.25, 1e-9]),
        np.array([1e-9, 1e-3, 0.0]), status, np.zeros((3, 1), dtype=bool),
    )  # fmt: skip
    assert document(found).headline == "Inverse kinematics of 3 poses: 2 solved, 1 joint range"
    assert "left to the pose at most: 0.25 mm, 0.001 rad; joints in mm and rad" in repr(found)
    assert table(found)[1] == ["1", "joint range", "0.25", "0.001"]
    none = replace(found, q=np.zeros((0, 1)), position=np.zeros(0), rotation=np.zeros(0), status=status[:0])
    assert document(none).headline == "Inverse kinematics of 0 poses: none"


def test_constants_that_the_readings_tell_least_about_stand_first() -> None:
    """By what is left of the tolerance, to what is no rounding; where nothing decides before all, what is held last."""
    sizes = {
        "half": (0.5, 1.0), "well": (0.1, 1.0), "also half": (0.50000001, 1.0), "nothing": (np.inf, np.inf),
        "seen": (0.2, np.inf), "barely": (0.09, 0.1),
    }  # fmt: skip
    told = tuple(
        ParameterSight(name, "mm", tolerance, std, std, "partly", ())
        for name, (std, tolerance) in sizes.items()
    )
    found = RESULTS["identifiability nanopositioner"]()
    assert isinstance(found, Identifiability)
    own = replace(
        found, parameters=told, files=("/far/off/a.csv",), seed=None, notes=(Note("strokes", "q1"),)
    )
    assert [row[0] for row in table(own)] == ["nothing", "barely", "half", "also half", "well", "seen"]
    assert table(own)[:2] == [
        ["nothing", "unknown", "unknown", "partly"],
        ["barely", "0.1 mm", "0.09 mm", "partly"],
    ]
    assert f"{found.poses} poses of a.csv, " in document(own).headline
    assert document(own).notes == ["q1: every move counts as a long one; strokes that shrink are not planned"]
