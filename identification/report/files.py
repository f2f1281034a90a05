"""Results written down: a report alone, or what the command of the same name writes, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from truepose.files import FILES_SHA256, atomic_directory, atomic_write_text, sha256_of
from truepose.identification.diagnosis.null_fits import far_rows
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.tool_pose import calibrated_pose
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.gate import Caution
from truepose.identification.report import pages
from truepose.identification.report.fitted import file_of
from truepose.identification.report.json_text import json_text
from truepose.identification.report.results import calibration_json, diagnosis_json
from truepose.identification.report.row_words import far_row_words
from truepose.models.file.machine_file import ExpectedPose
from truepose.models.load import DIAGNOSIS
from truepose.shown.result import files, html

REPORT = "report.html"


@html.register
def _(result: Calibration) -> str:
    far = far_row_words(calibration_json(result, far_rows(result))["rows_that_do_not_fit"])
    return pages.calibration_html(
        result, far, pose=calibrated_pose(result.fit, result.recording, result.began)
    )


@html.register
def _(result: Diagnosis) -> str:
    return pages.report_html(result)


@files.register
def _(result: Calibration, output: Path) -> list[str]:
    pose = calibrated_pose(result.fit, result.recording, result.began)
    return write_calibration(result, calibration_json(result, far_rows(result)), output, pose)


@files.register
def _(result: Diagnosis, output: Path) -> list[str]:
    return write_diagnosis(result, output)


def write_calibration(
    result: Calibration,
    document: Mapping[str, Any],
    output: Path,
    pose: ExpectedPose | None,
    cautions: Sequence[str] = (),
) -> list[str]:
    """``calibrated.yaml``, ``fit.json`` (its ``document``) and ``report.html``; their names.

    ``pose``: what the fit is worth to the tool; ``cautions`` stand above the report.
    """
    far = far_row_words(document["rows_that_do_not_fit"])
    with atomic_directory(output) as partial:
        _calibration_files(result, document, partial, pose)
        page = pages.calibration_html(result, far, cautions, pose)
        atomic_write_text(partial / REPORT, page)
        return sorted(file.name for file in partial.iterdir())


def write_diagnosis(
    result: Diagnosis, output: Path, truth: Mapping[str, Any] | None = None, caution: Caution | None = None
) -> list[str]:
    """``diagnosis.json``, ``improved.yaml`` and ``report.html``, whose last page holds the ``truth`` of a simulation.

    A ``caution`` stands above all.
    """
    with atomic_directory(output, last=DIAGNOSIS) as partial:
        page = pages.report_html(result, truth, caution.sentences if caution else None)
        _diagnosis_files(result, partial, caution, page)
        return sorted(file.name for file in partial.iterdir())


def put_both(
    calibration: Calibration, diagnosis: Diagnosis, caution: Caution, partial: Path, *, brief: bool = False
) -> None:
    """What calibrate and diagnose write, into a folder that is not published yet: one ``report.html``, the diagnosis's.

    ``brief``: without the report.
    """
    document = {**calibration_json(calibration, far_rows(calibration)), **caution.document}
    pose = calibrated_pose(calibration.fit, calibration.recording, calibration.began)
    _calibration_files(calibration, document, partial, pose)
    page = None if brief else pages.report_html(diagnosis, None, caution.sentences)
    _diagnosis_files(diagnosis, partial, caution, page)


def _calibration_files(
    result: Calibration, document: Mapping[str, Any], partial: Path, pose: ExpectedPose | None
) -> None:
    write_calibrated(partial / "calibrated.yaml", result.fit, result.recording, pose, kept=result.kept)
    atomic_write_text(partial / "fit.json", json_text(document))


def _diagnosis_files(result: Diagnosis, partial: Path, caution: Caution | None, page: str | None) -> None:
    """Write the files of a diagnosis; ``diagnosis.json`` holds the digest of each that is there before it."""
    found = caution.document if caution else {}
    write_calibrated(partial / "improved.yaml", **file_of(result))
    if page is not None:
        atomic_write_text(partial / REPORT, page)
    digests = {FILES_SHA256: sha256_of(partial)}
    atomic_write_text(partial / DIAGNOSIS, json_text({**diagnosis_json(result), **found, **digests}))
