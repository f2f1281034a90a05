"""What a terminal shows of a calibration: what it left, what tolerances decided, rows that do not fit, what to do next."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from support.reports import arm, synthetic
from support.told_diagnoses import still
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.report.results import diagnosis_json
from truepose.identification.report.terminal import calibration_lines, diagnosis_summary
from truepose.models.file.machine_file import ExpectedPose

OUT = Path("out")
USE = "truepose codegen out/calibrated.yaml -o controller"


def fit(**more: Any) -> SimpleNamespace:
    """Of seven free constants, all of which the readings see."""
    own = cast(SimpleNamespace, still())
    own.prior.free = range(7)
    own.nominal.name = "arm"
    told = {"rank": 7, "worst_parameter_sigma": 2.5, "chi2_per_dof": 1.01}
    solution = SimpleNamespace(iterations=4)
    return SimpleNamespace(**{**vars(own), **told, "solution": solution, **more})


def figures(**more: object) -> dict[str, object]:
    plain: dict[str, object] = {
        "rows_that_do_not_fit": [],
        "validation_rms": {"position": {"value": 0.0123, "unit": "mm"}},
        "rms": {"position": {"value": 0.5, "unit": "mm"}},
        "worst_parameter": "q1.d",
        "worst_parameter_allowed": 3.1,
    }
    return plain | more


def lines(
    estimate: SimpleNamespace,
    told: dict[str, object] | None = None,
    pose: ExpectedPose | None = None,
    **more: Any,
) -> list[str]:
    judged = SimpleNamespace(refusal="")
    given = {"fit": estimate, "judgement": judged, "method": {"estimator": "map"}, "only": "", **more}
    result = cast(Calibration, SimpleNamespace(**given))
    return calibration_lines(result, told or figures(), OUT, pose)


def test_a_calibration_is_told_in_this_order() -> None:
    pose = ExpectedPose("nominal", 0.5, 0.2, "20 rows held out")
    row = {"file": "day/r.csv", "row": 3, "sigma": 9.0}
    assert lines(fit(), figures(rows_that_do_not_fit=[row]), pose) == [
        "arm: converged in 4 iterations",
        "  row 3 of r.csv does not fit: residuals of 9.0 sigma; look there before the model is suspected",
        "  position: 12.3 µm rms on held-out rows",
        "  the tool's position: 500 µm before (nominal), 200 µm after, on 20 rows held out, after a rigid refit",
        "  chi2 per degree of freedom 1.01",
        "  7 of 7 directions are seen by the readings",
        "  furthest from the drawing: q1.d, 2.5 tolerances",
        f"next: {USE}",
        "calibrated machine: out/calibrated.yaml",
    ]


def test_without_rows_that_were_held_out_those_that_were_fitted_are_told() -> None:
    assert "  position: 0.500 mm rms on the fitted rows" in lines(fit(), figures(validation_rms=None))


@pytest.mark.parametrize(
    ("estimator", "rank", "decided"),
    [
        ("map", 7, ""), ("ols", 7, ""),
        ("map", 6, "; tolerances decide the others"), ("huber", 6, "; tolerances decide the others"),
        *((flat, 6, "; the others stay at the drawing") for flat in ("ols", "liu", "ridge", "pcr")),
    ],
)  # fmt: skip
def test_what_decides_unseen_directions_is_the_estimator_s(estimator: str, rank: int, decided: str) -> None:
    said = f"  {rank} of 7 directions are seen by the readings{decided}"
    assert said in lines(fit(rank=rank), method={"estimator": estimator})


@pytest.mark.parametrize(
    ("chi2", "farthest", "allowed", "doubtful"),
    [(1.3, 3.1, 3.1, False), (1.31, 3.1, 3.1, True), (1.3, 3.2, 3.1, True), (1.0, 99.0, None, False)],
)
def test_what_is_missing_is_looked_for_where_the_fit_is_not_that_of_a_true_model(
    chi2: float, farthest: float, allowed: float | None, doubtful: bool
) -> None:
    told = lines(
        fit(chi2_per_dof=chi2, worst_parameter_sigma=farthest), figures(worst_parameter_allowed=allowed)
    )
    find = "next: what is missing: truepose diagnose MACHINE RECORDING -o diagnosis"
    assert told[-2] == (f"or: {USE}" if doubtful else f"next: {USE}")
    assert (told[-3] == find) is doubtful


def test_what_alone_was_fitted_and_what_is_no_calibration_is_told() -> None:
    alone = lines(fit(), only="base and tool")
    assert "  held as the machine file has it: all but base and tool" in alone
    assert not [line for line in alone if "furthest" in line]
    why = "NOT CALIBRATED: q1.d stands 900 tolerances from its drawing"
    first, *_, check, _ = lines(fit(), judgement=SimpleNamespace(refusal=why))
    assert first == f"{why} (arm: converged in 4 iterations)"
    assert check == "next: units, signs, order, frames: truepose check MACHINE RECORDING"


def test_the_brief_document_of_a_diagnosis_is_a_part_of_the_whole(tmp_path: Path) -> None:
    found = synthetic(arm(tmp_path))
    whole, brief = diagnosis_json(found), diagnosis_summary(found, "diagnose", ["a", "b"])
    assert brief.pop("command") == "diagnose" and brief.pop("files") == ["a", "b"]
    assert brief.items() <= whole.items()
    assert {"judgement", "verdict", "findings", "untestable", "fit", "proof", "applied"} <= set(brief)
