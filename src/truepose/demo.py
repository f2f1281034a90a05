"""``demo``: the whole job on a bundled recording."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import (
    DIAGNOSIS,
    JsonOption,
    check_directory,
    check_machine,
    finish,
    progress,
    written,
)
from truepose.errors import InputError

NAMES = ("telescope", "mount", "nanopositioner", "polisher")
"""Machines that come with a recording."""
MACHINE, RECORDING, TRUTH = "machine.yaml", "recording.csv", "truth.json"


NameArg = Annotated[str, typer.Argument(metavar=f"[{'|'.join(NAMES)}]", help="Which machine.")]
OutputOption = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Directory for the results.")
]


def demo(
    name: NameArg = NAMES[0],
    output: OutputOption = Path("truepose-demo"),
    as_json: JsonOption = False,
) -> None:
    """The whole job on a bundled recording: diagnosis.json, improved.yaml and report.html.

    Example: truepose demo telescope -o truepose-demo
    """
    from truepose.identification.diagnosis.diagnose import diagnose
    from truepose.identification.recording.load import load_recording
    from truepose.identification.report.diagnosis import diagnosis_document
    from truepose.identification.report.files import REPORT, write_diagnosis
    from truepose.identification.report.results import diagnosis_summary
    from truepose.models.load import load_machine
    from truepose.shown.text import first_screen

    if name not in NAMES:
        raise InputError(f"demo: found {name!r}, expected one of {', '.join(NAMES)}")
    check_directory(output, DIAGNOSIS)
    with (
        resources.as_file(resources.files("truepose.models") / "machines" / name) as bundle,
        progress("diagnosing") as say,
    ):
        machine = load_machine(bundle / MACHINE)
        check_machine(output, DIAGNOSIS, machine.name)
        result = diagnose(machine, load_recording(machine, [bundle / RECORDING]), progress=say)
        say("writing the report")
        names = write_diagnosis(result, output)
        truth = _truth(bundle / TRUTH)
    summary = diagnosis_summary(result, "demo", written(output, names))
    told = diagnosis_document(result, output)
    lines = [*first_screen(told), f"the recording was simulated with: {truth}", f"report: {output / REPORT}"]
    finish(summary, lines, told.notes, as_json=as_json)


def _truth(path: Path) -> str:
    """Return what the simulator put in, which the diagnosis never saw."""
    stated = json.loads(path.read_text(encoding="utf-8"))
    effects = stated["effects"] if "effects" in stated else [stated["effect"]]
    return "; ".join(f"{one['effect']} at {', '.join(one['place'])}" for one in effects) or "no effect"
