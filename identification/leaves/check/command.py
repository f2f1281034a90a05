"""``check``: finds slips of units, signs, order and frames between a machine file and a recording of it."""

from __future__ import annotations

from pathlib import Path

import typer

from truepose.commands import common
from truepose.commands.identify import IrradianceOption


@common.options(fix="DIR: Write the corrected machine file and recordings there.")
def check(
    machine: common.MachineArg,
    recordings: common.RecordingsArg,
    fix: Path | None = None,
    irradiance: IrradianceOption = None,
    as_json: common.JsonOption = False,
) -> None:
    """Find slips of units, signs, order and frames, and say how to mend them; exit code 2 where something is wrong.

    Example: truepose check machine.yaml recording.csv --fix mended
    """
    from truepose.identification.leaves.check.pair import Pair
    from truepose.identification.leaves.check.run import check_files
    from truepose.identification.leaves.check.showing import check_lines
    from truepose.identification.report.json_text import json_text

    if fix is not None:
        common.check_directory(fix)
    with common.progress("checking"):
        result, _, rows = check_files(machine, recordings, irradiance=irradiance or ())
        written: list[str] = []
        if fix is not None and any(f.mend for f in result.found):
            written = result.mended(Pair.read(machine, recordings)).write(fix)
    if as_json:
        notes = list(rows.notes) if rows is not None else []
        common.tell(json_text({**result.document(), "files": written, "notes": notes}), nl=False)
    else:
        common.tell("".join(f"{line}\n" for line in check_lines(result, written)), nl=False)
    if result.verdict == "wrong":
        raise typer.Exit(common.BAD_INPUT)


COMMANDS = (check,)
