"""``drift``: which parameters move between recordings, and when to recalibrate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import (
    DRIFT,
    GateOption,
    JsonOption,
    MachineArg,
    RecordingsArg,
    ShuffledOption,
    check_directory,
    check_machine,
    finish,
    gated,
    progress,
    written,
)
from truepose.errors import InputError

OutputOption = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Directory for drift.json and report.html."),
]
AccuracyOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="LENGTH|ANGLE",
        help='Residuals that are good enough, such as "50 nm" or "0.01 deg"; repeatable.',
    ),
]


def drift(
    machine: MachineArg,
    recordings: RecordingsArg,
    output: OutputOption = None,
    accuracy: AccuracyOption = None,
    shuffled: ShuffledOption = False,
    anyway: GateOption = False,
    as_json: JsonOption = False,
) -> None:
    """Which parameters move between recordings, how fast, and when to recalibrate.

    A file is a session of its own unless a column 'session' says otherwise. An older calibration suffices while its
    residuals do not show that something moved, or are within --accuracy.

    Example: truepose drift machine.yaml day0.csv day1.csv day8.csv
    """
    from truepose.identification.leaves.drift.analysis import drift as run
    from truepose.identification.leaves.drift.page import drift_document
    from truepose.identification.leaves.drift.showing import write_drift
    from truepose.identification.leaves.drift.words import drift_json
    from truepose.shown.text import LINES, first_screen

    if output is not None:
        check_directory(output, DRIFT)
    wanted = _wanted(accuracy or ())
    with progress("comparing recordings") as say:
        say("checking")
        loaded, recording, caution = gated(machine, recordings, anyway=anyway, shuffled=shuffled)
        if output is not None:
            check_machine(output, DRIFT, loaded.name)
        accepted = {k: wanted[unit] for k, unit in loaded.residual_units.items() if unit in wanted}
        found = run(loaded, recording, accuracy=accepted, progress=say)
        files = [] if output is None else written(output, write_drift(found, output, caution))
    summary = {"command": "drift", **drift_json(found), **caution.document, "files": files}
    told = replace(drift_document(found), cautions=caution.sentences)
    finish(summary, [*first_screen(told, 2 * LINES), *files], told.notes, as_json=as_json)


def _wanted(texts: Sequence[str]) -> dict[str, float]:
    """Residuals that are good enough, by their unit (mm, rad)."""
    from truepose.models.file.fields import quantity

    out: dict[str, float] = {}
    for text in texts:
        known = {unit: quantity(text, unit) for unit in ("mm", "rad")}
        found = {unit: value for unit, value in known.items() if value is not None and value >= 0.0}
        if not found:
            raise InputError(f"--accuracy: found {text!r}, expected a length or an angle such as '50 nm'")
        out |= found
    return out


COMMANDS = (drift,)
