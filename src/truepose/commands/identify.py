"""``calibrate`` and ``diagnose``: from a machine and its recordings to a directory of results."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.commands.common import (
    DIAGNOSIS,
    FIT,
    DirectoryOption,
    GateOption,
    JsonOption,
    MachineArg,
    RecordingsArg,
    ShuffledOption,
    check_directory,
    check_machine,
    finish,
    gated,
    note,
    progress,
    refuse,
    written,
)

if TYPE_CHECKING:
    from truepose.identification.diagnosis.result import Diagnosis
    from truepose.identification.fit.calibrate import Calibration
    from truepose.identification.load import Caution

STOPPING = "the search ends, and what was found is named and written; Ctrl-C again stops at once"
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

OnlyOption = Annotated[
    str,
    typer.Option(
        help="Fit these alone: frames (base,tool), parts (q4), constants (q4.theta) or the zeros of all joints (offset). All "
        "else, effects included, is held as the file has it; a frame may stand anywhere.",
        metavar="NAMES",
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
TryColumnsOption = Annotated[
    str | None,
    typer.Option(
        metavar="all|NAME,NAME...",
        help="Try columns of numbers that the machine file does not declare as drivers: all, or those named. The more are "
        "tried, the more evidence each needs.",
    ),
]
PriorOption = Annotated[
    Path | None,
    typer.Option(
        "--prior",
        metavar="FILE",
        help="What a fleet of such machines says is likely: the prior.yaml of its statistics.",
    ),
]


def calibrate(
    machine: MachineArg,
    recordings: RecordingsArg,
    output: DirectoryOption,
    estimator: EstimatorOption = "map",
    solver: SolverOption = "gn",
    only: OnlyOption = "",
    irradiance: IrradianceOption = None,
    shuffled: ShuffledOption = False,
    anyway: GateOption = False,
    as_json: JsonOption = False,
) -> None:
    """Identify the machine's constants; writes calibrated.yaml, fit.json and report.html.

    Example: truepose calibrate machine.yaml day1.csv day2.csv -o fit

    Example: truepose calibrate result/improved.yaml other.csv --only base,tool -o moved
    """
    from truepose.identification.fit.calibrate import calibrate as run

    check_directory(output, FIT)
    with progress("calibrating") as say:
        say("checking")
        loaded, rows, caution = gated(
            machine, recordings, irradiance=irradiance or (), anyway=anyway, shuffled=shuffled
        )
        check_machine(output, FIT, loaded.name)
        result = run(loaded, rows, estimator=estimator, solver=solver, only=_names(only), progress=say)
        summary, lines = _calibration_written(result, caution, output, say)
    finish({"command": "calibrate", **summary}, lines, result.notes, as_json=as_json)
    refuse(result.judgement, output, as_json=as_json)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _calibration_written(
    result: Calibration, caution: Caution, output: Path, say: Callable[[str], None]
) -> tuple[dict[str, Any], list[str]]:
    """Write the results into ``output``; what is told of them, for --json and in lines."""
    from truepose.identification.report.estimate import calibration_document
    from truepose.identification.report.files import write_calibration
    from truepose.identification.report.results import calibration_json
    from truepose.shown.text import first_screen

    say("looking for rows that do not fit")
    fit = calibration_json(result)
    say("writing the report")
    files = write_calibration(result, {**fit, **caution.document}, output, caution.sentences)
    summary = {**{k: fit[k] for k in _BRIEF}, "files": written(output, files), **caution.document}
    told = calibration_document(result, fit["rows_that_do_not_fit"], output)
    lines = first_screen(replace(told, cautions=caution.sentences))
    return summary, [*lines, f"calibrated machine: {output / 'calibrated.yaml'}"]


_BRIEF = (
    "judgement", "status", "iterations", "rows", "chi2_per_dof", "rms", "validation_rms", "rank",
    "rows_that_do_not_fit", "free_parameters", "worst_parameter_sigma",
)  # fmt: skip


def diagnose(
    machine: MachineArg,
    recordings: RecordingsArg,
    output: DirectoryOption,
    irradiance: IrradianceOption = None,
    try_columns: TryColumnsOption = None,
    prior: PriorOption = None,
    shuffled: ShuffledOption = False,
    anyway: GateOption = False,
    as_json: JsonOption = False,
) -> None:
    """Locate, name, model and prove what the model leaves out.

    Writes diagnosis.json, improved.yaml and report.html. Ctrl-C ends the search and concludes with what was found by then; a
    second Ctrl-C ends the command.

    Example: truepose diagnose machine.yaml recording.csv -o result
    """
    from truepose.identification.diagnosis.diagnose import diagnose as run
    from truepose.identification.learned_prior import read_prior
    from truepose.identification.report.notes import diagnosis_notes
    from truepose.identification.report.results import diagnosis_judgement

    learned = None if prior is None else read_prior(prior)
    check_directory(output, DIAGNOSIS)
    with progress("checking"):
        tried = None if try_columns is None else [] if try_columns == "all" else _names(try_columns)
        loaded, rows, caution = gated(
            machine,
            recordings,
            irradiance=irradiance or (),
            anyway=anyway,
            shuffled=shuffled,
            tried=tried,
        )
        check_machine(output, DIAGNOSIS, loaded.name)
    with progress("diagnosing") as say:
        with first_interrupt() as stop:
            result = run(loaded, rows, prior=learned, progress=say, stop=stop)
        say("writing the report")
        summary, lines = _diagnosis_written(result, caution, output)
    finish(summary, lines, diagnosis_notes(result), as_json=as_json)
    refuse(diagnosis_judgement(result), output, as_json=as_json)


@contextlib.contextmanager
def first_interrupt() -> Iterator[Callable[[], bool]]:
    """Let a first Ctrl-C during the block ask for an end only; yield whether it came. A second one ends the command."""
    came = list[int]()

    def hear(number: int, _: object) -> None:
        came.append(number)
        signal.signal(signal.SIGINT, before)
        note(STOPPING)

    before = signal.signal(signal.SIGINT, hear)
    try:
        yield lambda: bool(came)
    finally:
        signal.signal(signal.SIGINT, before)


def _diagnosis_written(result: Diagnosis, caution: Caution, output: Path) -> tuple[dict[str, Any], list[str]]:
    """Write the results into ``output``; what is told of them, for --json and in lines."""
    from truepose.identification.report.diagnosis import diagnosis_document
    from truepose.identification.report.files import REPORT, write_diagnosis
    from truepose.identification.report.results import diagnosis_summary
    from truepose.shown.text import first_screen

    files = written(output, write_diagnosis(result, output, caution=caution))
    told = diagnosis_document(result, output, checked=True)
    lines = [*first_screen(replace(told, cautions=caution.sentences)), f"report: {output / REPORT}"]
    return {**diagnosis_summary(result, "diagnose", files), **caution.document}, lines
