"""``calibrate`` and ``diagnose``: from a machine and its recordings to a directory of results."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.commands.common import (
    DirectoryOption,
    JsonOption,
    MachineArg,
    PluginOption,
    RecordingsArg,
    finish,
    progress,
    reported,
    written,
)
from truepose.commands.judgement import refuse
from truepose.commands.results import DIAGNOSIS, FIT, check_directory, check_machine

if TYPE_CHECKING:
    from truepose.identification.diagnosis.result import Diagnosis
    from truepose.identification.fit.calibrate import Calibration
    from truepose.models.machine_file import ExpectedPose

FITTING = (
    ("fitting", 3.0),
    ("fitting without tolerances", 4.0),
    ("looking for rows", 2.0),
    ("writing the report", 1.0),
)
DIAGNOSING = (
    ("fitting without effects", 1.0),
    ("weighing", 5.0),
    ("naming and proving", 3.0),
    ("writing the report", 1.0),
)
"""What ``calibrate`` and ``diagnose`` do one after the other, and about how long each takes beside the others."""
EstimatorOption = Annotated[
    str,
    typer.Option(
        help="map: tolerances as the prior; ols: readings alone; liu, ridge, pcr: readings alone, biased "
        "towards the drawing where columns are nearly dependent; huber: map that bends for outliers.",
        metavar="map|ols|liu|ridge|pcr|huber",
    ),
]
SolverOption = Annotated[
    str,
    typer.Option(
        help="gn: Gauss-Newton; lm: Levenberg-Marquardt; ipopt: keeps bounds, passive joints as unknowns.",
        metavar="gn|lm|ipopt",
    ),
]

IrradianceOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--irradiance",
        metavar="FILE",
        help="Photocurrent (CSV or Parquet: pose t I) of a recording without dL, counted in fringes; repeatable, "
        "in the order of the recordings.",
    ),
]


def calibrate(
    machine: MachineArg,
    recordings: RecordingsArg,
    output: DirectoryOption,
    estimator: EstimatorOption = "map",
    solver: SolverOption = "gn",
    irradiance: IrradianceOption = None,
    as_json: JsonOption = False,
    plugin: PluginOption = None,
) -> None:
    """Identify the machine's constants; writes calibrated.yaml, fit.json and report.html.

    Example: truepose calibrate machine.yaml day1.csv day2.csv -o fit
    """
    with reported(plugin):
        from truepose.identification.diagnosis.far_rows import far_rows
        from truepose.identification.fit.calibrate import calibrate as run
        from truepose.identification.fit.tool_pose import calibrated_pose
        from truepose.identification.fringes.load import load_recording
        from truepose.identification.report.results import calibration_json
        from truepose.identification.report.terminal import calibration_lines
        from truepose.models.load import load_machine

        check_directory(output, FIT)
        with progress("calibrating", FITTING) as say:
            loaded = load_machine(machine)
            check_machine(output, FIT, loaded.name)
            rows = load_recording(loaded, recordings, irradiance=irradiance or (), progress=say)
            result = run(loaded, rows, estimator=estimator, solver=solver, progress=say)
            say("looking for rows that do not fit")
            fit = calibration_json(result, far_rows(result))
            pose = calibrated_pose(result.fit, result.recording)
            say("writing the report")
            names = write_calibration(result, fit, output, pose)
        summary = {"command": "calibrate", **{k: fit[k] for k in _BRIEF}, "files": written(output, names)}
        finish(summary, calibration_lines(result, fit, output, pose), result.notes, as_json=as_json)
        refuse(result.judgement, output, as_json=as_json)


_BRIEF = (
    "judgement",
    "status",
    "iterations",
    "rows",
    "chi2_per_dof",
    "rms",
    "validation_rms",
    "rank",
    "rows_that_do_not_fit",
    "free_parameters",
    "worst_parameter_sigma",
)


def diagnose(
    machine: MachineArg,
    recordings: RecordingsArg,
    output: DirectoryOption,
    irradiance: IrradianceOption = None,
    as_json: JsonOption = False,
    plugin: PluginOption = None,
) -> None:
    """Locate, name, model and prove what the model leaves out.

    Writes diagnosis.json, improved.yaml and report.html.

    Example: truepose diagnose machine.yaml recording.csv -o result
    """
    with reported(plugin):
        from truepose.identification.diagnosis.engine import diagnose as run
        from truepose.identification.fringes.load import load_recording
        from truepose.identification.report.judgement_words import diagnosis_judgement
        from truepose.identification.report.notes import diagnosis_notes
        from truepose.identification.report.terminal import diagnosis_lines, diagnosis_summary
        from truepose.models.load import load_machine

        check_directory(output, DIAGNOSIS)
        with progress("diagnosing", DIAGNOSING) as say:
            loaded = load_machine(machine)
            check_machine(output, DIAGNOSIS, loaded.name)
            rows = load_recording(loaded, recordings, irradiance=irradiance or (), progress=say)
            result = run(loaded, rows, progress=say)
            say("writing the report")
            names = write_diagnosis(result, output)
        finish(
            diagnosis_summary(result, "diagnose", written(output, names)),
            diagnosis_lines(result, output),
            diagnosis_notes(result),
            as_json=as_json,
        )
        refuse(diagnosis_judgement(result), output, as_json=as_json)


def write_calibration(
    result: Calibration, document: Mapping[str, Any], output: Path, pose: ExpectedPose | None
) -> list[str]:
    """The three files of a calibration, whole or not at all; ``document`` is that of ``fit.json``.

    ``pose``: what the fit is worth to the tool.
    """
    from truepose.files import atomic_directory, atomic_write_text
    from truepose.identification.fit.write_machine import write_calibrated
    from truepose.identification.report.json_text import json_text
    from truepose.identification.report.pages import calibration_html
    from truepose.identification.report.row_words import far_row_words

    far = far_row_words(document["rows_that_do_not_fit"])
    with atomic_directory(output) as partial:
        write_calibrated(partial / "calibrated.yaml", result.fit, result.recording, pose)
        atomic_write_text(partial / "fit.json", json_text(document))
        atomic_write_text(
            partial / "report.html", calibration_html(result.fit, result.free, result.recording, far)
        )
        return sorted(file.name for file in partial.iterdir())


def write_diagnosis(result: Diagnosis, output: Path, truth: dict[str, object] | None = None) -> list[str]:
    """The three files of a diagnosis, whole or not at all; ``truth`` is for the report's last page alone."""
    from truepose.files import atomic_directory, atomic_write_text
    from truepose.identification.fit.write_machine import write_calibrated
    from truepose.identification.report.applied_words import expected_pose
    from truepose.identification.report.json_text import json_text
    from truepose.identification.report.judgement_words import diagnosis_judgement
    from truepose.identification.report.pages import report_html
    from truepose.identification.report.results import diagnosis_json

    with atomic_directory(output) as partial:
        atomic_write_text(partial / "diagnosis.json", json_text(diagnosis_json(result)))
        pose = expected_pose(result.applied)
        judgement = diagnosis_judgement(result)
        write_calibrated(partial / "improved.yaml", result.after, result.recording, pose, judgement)
        atomic_write_text(partial / "report.html", report_html(result, truth))
        return sorted(file.name for file in partial.iterdir())
