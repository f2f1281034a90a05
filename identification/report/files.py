"""Results written down, whole or not at all; their machine as its file would be read, and their residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import singledispatch
from pathlib import Path
from typing import Any

import pandas as pd

from truepose.files import FILES_SHA256, atomic_directory, atomic_write_text, sha256_of
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import (
    Estimate,
    Fitted,
    machine_of,
    predicted_frame,
    residual_frame,
)
from truepose.identification.fit.write_machine import calibrated_text, write_calibrated
from truepose.identification.load import Caution
from truepose.identification.prediction.predict import predict
from truepose.identification.recording.load import as_recording
from truepose.identification.report.applied_words import expected_pose
from truepose.identification.report.diagnosis import diagnosis_document
from truepose.identification.report.estimate import calibration_document
from truepose.identification.report.json_text import json_text
from truepose.identification.report.results import calibration_json, diagnosis_json, diagnosis_judgement
from truepose.models.load import DIAGNOSIS
from truepose.models.machine.machine import Machine
from truepose.models.units import convert
from truepose.shown.html import page
from truepose.shown.result import files

REPORT = "report.html"


@files.register
def _(result: Calibration, output: Path) -> list[str]:
    return write_calibration(result, calibration_json(result), output)


@files.register
def _(result: Diagnosis, output: Path) -> list[str]:
    return write_diagnosis(result, output)


def write_calibration(
    result: Calibration,
    fit: Mapping[str, Any],
    output: Path,
    cautions: Sequence[str] = (),
) -> list[str]:
    """``calibrated.yaml``, ``fit.json`` (its content ``fit``) and ``report.html``; their names.

    ``cautions`` stand above the report.
    """
    told = calibration_document(result, fit["rows_that_do_not_fit"])
    with atomic_directory(output) as partial:
        _calibration_files(result, fit, partial)
        atomic_write_text(partial / REPORT, page(replace(told, cautions=cautions)))
        return sorted(file.name for file in partial.iterdir())


def write_diagnosis(result: Diagnosis, output: Path, caution: Caution | None = None) -> list[str]:
    """Write ``diagnosis.json``, ``improved.yaml`` and ``report.html``, below a ``caution``; return their names."""
    with atomic_directory(output, last=DIAGNOSIS) as partial:
        _diagnosis_files(result, partial, caution)
        return sorted(file.name for file in partial.iterdir())


def put_both(
    calibration: Calibration, diagnosis: Diagnosis, caution: Caution, partial: Path, *, brief: bool = False
) -> None:
    """What calibrate and diagnose write, into a folder that is not published yet: one ``report.html``, the diagnosis's.

    ``brief``: without the report.
    """
    _calibration_files(calibration, {**calibration_json(calibration), **caution.document}, partial)
    _diagnosis_files(diagnosis, partial, caution, brief=brief)


def _calibration_files(result: Calibration, fit: Mapping[str, Any], partial: Path) -> None:
    write_calibrated(partial / "calibrated.yaml", **file_of(result))
    atomic_write_text(partial / "fit.json", json_text(fit))


def _diagnosis_files(
    result: Diagnosis, partial: Path, caution: Caution | None, *, brief: bool = False
) -> None:
    """Write the files of a diagnosis; ``diagnosis.json`` holds the digest of each that is there before it."""
    found, sentences = (caution.document, caution.sentences) if caution else ({}, ())
    write_calibrated(partial / "improved.yaml", **file_of(result))
    if not brief:
        told = diagnosis_document(result, checked=caution is not None)
        atomic_write_text(partial / REPORT, page(replace(told, cautions=sentences)))
    digests = {FILES_SHA256: sha256_of(partial)}
    atomic_write_text(partial / DIAGNOSIS, json_text({**diagnosis_json(result), **found, **digests}))


@singledispatch
def file_of(result: Fitted) -> dict[str, Any]:
    """Return what ``write_calibrated`` takes to write the machine of a result, by name."""
    raise TypeError(f"found a {type(result).__name__}, expected an estimate, a calibration or a diagnosis")


@file_of.register
def _(result: Estimate) -> dict[str, Any]:
    return {"estimate": result, "recording": result.recording}


@file_of.register
def _(result: Calibration) -> dict[str, Any]:
    return {"estimate": result.fit, "recording": result.recording, "pose": result.pose, "kept": result.kept}


@file_of.register
def _(result: Diagnosis) -> dict[str, Any]:
    pose, judgement = expected_pose(result.applied), diagnosis_judgement(result)
    return {"estimate": result.after, "recording": result.recording, "pose": pose, "judgement": judgement}


@predicted_frame.register
def _(result: Fitted, rows: Any) -> pd.DataFrame:
    """Return what the machine of a result predicts for rows."""
    return predict(result.machine, as_recording(result.machine, rows, need_observations=False))


@machine_of.register
def _(result: Fitted) -> Machine:
    """Return the machine of a result as its file would be read. Raises InputError where the machine has no file."""
    told = file_of(result)
    file = told["estimate"].nominal.file
    return calibrated_text(file.path if file else "", **told)[1]


@residual_frame.register
def _(result: Fitted) -> pd.DataFrame:
    """Return the residuals (n, m) of a result's fit in the machine file's units, and which rows were fitted."""
    fit: Estimate = file_of(result)["estimate"]
    units, index = fit.nominal.units, fit.recording.to_frame().index
    values = fit.residual * [channel.sigma for channel in fit.nominal.channels]
    columns = {
        channel.name: convert(values[:, k], channel.unit, units.written(channel.unit))
        for k, channel in enumerate(fit.nominal.channels)
    }
    return pd.DataFrame({**columns, "fitted": fit.used}, index=index)
