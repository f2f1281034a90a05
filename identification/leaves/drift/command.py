"""``drift``: which parameters move between recordings, and when to recalibrate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from truepose.commands import common
from truepose.errors import InputError


@common.options(
    output="-o --output DIR: Directory for drift.json and report.html.",
    accuracy='LENGTH|ANGLE: Residuals that are good enough, such as "50 nm" or "0.01 deg"; repeatable.',
)
def drift(
    machine: common.MachineArg,
    recordings: common.RecordingsArg,
    output: Path | None = None,
    accuracy: list[str] | None = None,
    shuffled: common.ShuffledOption = False,
    anyway: common.GateOption = False,
    as_json: common.JsonOption = False,
) -> None:
    """Which parameters move between recordings, how fast, and when to recalibrate.

    A file is a session of its own unless a column 'session' says otherwise. An older calibration suffices while its
    residuals do not show that something moved, or are within --accuracy.

    Example: truepose drift machine.yaml day0.csv day1.csv day8.csv
    """
    from truepose.identification.leaves.drift.analysis import drift as run
    from truepose.identification.leaves.drift.showing import drift_document, write_drift
    from truepose.identification.leaves.drift.words import drift_json
    from truepose.shown.text import LINES, first_screen

    if output is not None:
        common.check_directory(output, common.DRIFT)
    wanted = _wanted(accuracy or ())
    with common.progress("comparing recordings") as say:
        say("checking")
        loaded, recording, caution = common.gated(machine, recordings, anyway=anyway, shuffled=shuffled)
        if output is not None:
            common.check_machine(output, common.DRIFT, loaded.name)
        accepted = {k: wanted[unit] for k, unit in loaded.residual_units.items() if unit in wanted}
        found = run(loaded, recording, accuracy=accepted, progress=say)
        files = [] if output is None else common.written(output, write_drift(found, output, caution))
    summary = {"command": "drift", **drift_json(found), **caution.document, "files": files}
    told = replace(drift_document(found), cautions=caution.sentences)
    common.finish(summary, [*first_screen(told, 2 * LINES), *files], told.notes, as_json=as_json)


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
