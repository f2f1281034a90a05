"""``check``: finds slips of units, signs, order and frames between a machine file and a recording of it."""

from __future__ import annotations

from pathlib import Path

import typer

from truepose.commands.common import (
    BAD_INPUT,
    JsonOption,
    MachineArg,
    RecordingsArg,
    check_directory,
    options,
    progress,
    tell,
)
from truepose.commands.identify import IrradianceOption


@options(fix="DIR: Write the corrected machine file and recordings there.")
def check(
    machine: MachineArg,
    recordings: RecordingsArg,
    fix: Path | None = None,
    irradiance: IrradianceOption = None,
    as_json: JsonOption = False,
) -> None:
    """Find slips of units, signs, order and frames, and say how to mend them; exit code 2 where something is wrong.

    Example: truepose check machine.yaml recording.csv --fix mended
    """
    from truepose.identification.leaves.check.pair import Pair
    from truepose.identification.leaves.check.run import check_files
    from truepose.identification.leaves.check.showing import check_lines
    from truepose.identification.report.json_text import json_text

    if fix is not None:
        check_directory(fix)
    with progress("checking"):
        result, _, rows = check_files(machine, recordings, irradiance=irradiance or ())
        written: list[str] = []
        if fix is not None and any(f.mend for f in result.found):
            written = result.mended(Pair.read(machine, recordings)).write(fix)
    if as_json:
        notes = list(rows.notes) if rows is not None else []
        tell(json_text({**result.document(), "files": written, "notes": notes}), nl=False)
    else:
        tell("".join(f"{line}\n" for line in check_lines(result, written)), nl=False)
    if result.verdict == "wrong":
        raise typer.Exit(BAD_INPUT)


COMMANDS = (check,)
