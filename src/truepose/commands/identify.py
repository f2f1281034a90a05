"""``calibrate`` and ``diagnose``: from a machine and its recordings to a directory of results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import (
    DirectoryOption,
    JsonOption,
    MachineArg,
    PluginOption,
    RecordingsArg,
    check_directory,
    finish,
    progress,
    reported,
    written,
)

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

    Example: truepose calibrate machine.yaml day1.csv day2.csv -o result
    """
    with reported(plugin):
        from truepose.identification.fit.calibrate import calibrate as run
        from truepose.identification.fringes.load import load_recording
        from truepose.identification.report.files import write_calibration
        from truepose.identification.report.results import calibration_json
        from truepose.identification.report.terminal import calibration_lines
        from truepose.models.load import load_machine

        check_directory(output)
        with progress("calibrating") as say:
            loaded = load_machine(machine)
            rows = load_recording(loaded, recordings, irradiance=irradiance or (), progress=say)
            result = run(loaded, rows, estimator=estimator, solver=solver, progress=say)
            fit = calibration_json(result)
            names = write_calibration(result, fit, output)
        summary = {"command": "calibrate", **{k: fit[k] for k in _BRIEF}, "files": written(output, names)}
        finish(summary, calibration_lines(result, fit, output), result.notes, as_json=as_json)


_BRIEF = (
    "status",
    "iterations",
    "rows",
    "chi2_per_dof",
    "rms",
    "validation_rms",
    "rank",
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
        from truepose.identification.report.files import write_diagnosis
        from truepose.identification.report.notes import diagnosis_notes
        from truepose.identification.report.terminal import diagnosis_lines, diagnosis_summary
        from truepose.models.load import load_machine

        check_directory(output)
        with progress("diagnosing") as say:
            loaded = load_machine(machine)
            rows = load_recording(loaded, recordings, irradiance=irradiance or (), progress=say)
            result = run(loaded, rows, progress=say)
            names = write_diagnosis(result, output)
        finish(
            diagnosis_summary(result, "diagnose", written(output, names)),
            diagnosis_lines(result, output),
            diagnosis_notes(result),
            as_json=as_json,
        )
