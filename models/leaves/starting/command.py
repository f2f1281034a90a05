"""``init``: a commented machine file to start from, and an empty recording with the columns that it needs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import JsonOption, check_file, finish
from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_write_text
from truepose.models.file.limits import within
from truepose.wording import joined

if TYPE_CHECKING:
    from truepose.models.leaves.starting.start import Start

OutputOption = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="FILE", help="Machine file to write (.yaml).")
]
TableOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Denavit-Hartenberg table (CSV): columns a, alpha, d, theta."),
]
ConventionOption = Annotated[
    str, typer.Option(metavar="NAME", help="Of the table: standard, modified (Craig) or khalil.")
]
UrdfOption = Annotated[Path | None, typer.Option(metavar="FILE", help="URDF to read the chain from.")]
BaseLinkOption = Annotated[str, typer.Option(metavar="LINK", help="First link of the URDF's chain.")]
TipLinkOption = Annotated[
    str,
    typer.Option(
        metavar="LINK", help="Last link of the URDF's chain; several, with commas between them, make a tree."
    ),
]
ExpandOption = Annotated[
    bool, typer.Option("--expand", help="Write the URDF's chain out instead of naming the file.")
]
MjcfOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="MJCF (MuJoCo) to read the machine from.")
]
TipOption = Annotated[str, typer.Option(metavar="BODY", help="Last body of the MJCF's machine.")]
ArmOption = Annotated[str, typer.Option(metavar="NAME", help="Bundled machine (see --list).")]
ListOption = Annotated[bool, typer.Option("--list", help="List the bundled machines and leave.")]
SensorOption = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="pose, position, targets, ballbar, socket, distance, direction, tilt or angle; several with commas.",
    ),
]
BaseOption = Annotated[
    str,
    typer.Option(metavar="X,Y,Z[,R,P,Y]", help="Base in the sensor's frame, mm and deg. Left out: unknown."),
]
ToolOption = Annotated[
    str,
    typer.Option(metavar="X,Y,Z[,R,P,Y]", help="Tool in the flange's frame, mm and deg. Left out: unknown."),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Overwrite a machine file that is there.")]


def init(
    output: OutputOption = None,
    table: TableOption = None,
    convention: ConventionOption = "",
    urdf: UrdfOption = None,
    base_link: BaseLinkOption = "",
    tip_link: TipLinkOption = "",
    expand: ExpandOption = False,
    mjcf: MjcfOption = None,
    tip: TipOption = "",
    arm: ArmOption = "",
    list_: ListOption = False,
    sensor: SensorOption = "",
    base: BaseOption = "",
    tool: ToolOption = "",
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """A commented machine file to start from, and an empty recording beside it with the columns it needs.

    The mechanism comes from a table, a URDF, an MJCF or a bundled machine. Base and tool are unknown unless told. What the
    machine file leaves out of its source is listed.

    Example: truepose init --arm ur5e --sensor position -o cell3.yaml

    Example: truepose init --table kr10.csv --convention standard -o kr10.yaml
    """
    if list_:
        _list(as_json)
        return
    path = _machine_path(output, force)
    frames = {"base": _frame(base, "--base"), "tool": _frame(tool, "--tool")}
    sources = {"--table": table, "--urdf": urdf, "--mjcf": mjcf, "--arm": arm}
    given = [option for option, value in sources.items() if value]
    if len(given) > 1:
        raise InputError(f"found {joined(given)}, expected one of them")
    if convention and table is None:
        raise InputError(
            "--convention: found it without --table, expected a table that it is the convention of"
        )
    # readers are imported when they are needed: most of them take longer to load than to run
    if table is not None:
        from truepose.models.leaves.starting.table import table_start

        start = table_start(table, convention)
    elif urdf is not None:
        from truepose.models.leaves.starting.urdf import urdf_start

        start = urdf_start(urdf, path, base_link, tip_link or tip, written_out=expand)
    elif mjcf is not None:
        from truepose.models.leaves.starting.mjcf import mjcf_start

        start = mjcf_start(mjcf, tip_link or tip)
    elif arm:
        from truepose.models.leaves.starting.start import bundled_start

        start = bundled_start(arm)
    else:
        raise InputError("found no source of the mechanism, expected --table, --urdf, --mjcf or --arm")
    _write(start, frames, sensor, path, as_json)


def _write(
    start: Start, frames: Mapping[str, tuple[float, ...] | None], sensor: str, path: Path, as_json: bool
) -> None:
    """Write both files in one step; a recording that is there already may hold measurements and stays."""
    from truepose.models.leaves.starting.written import files_of

    recording = path.with_name(f"{path.stem}_recording.csv")
    kept = recording.exists()
    machine_text, recording_text = files_of(start, **frames, sensor=sensor)
    if not start.tested:
        _check_built(machine_text, path)
    with atomic_directory(path.parent) as partial:
        atomic_write_text(partial / path.name, machine_text)
        if not kept:
            atomic_write_text(partial / recording.name, recording_text)
    header = recording_text.splitlines()[-1]
    lines = [
        f"{path}: {start.title}; the lines marked CHECK are yours to check",
        f"{recording}: one row a measured configuration, {header}",
        f"then: truepose calibrate {path} {recording} -o result",
    ]
    summary = {
        "command": "init",
        "name": start.called,
        "columns": header.split(","),
        "files": [str(path), str(recording)],
        "left_out": list(start.left_out),
    }
    notes = [f"left out: {line}" for line in start.left_out]
    notes += [f"{recording}: left as it stands"] if kept else []
    finish(summary, lines, notes, as_json=as_json)


def _check_built(text: str, path: Path) -> None:
    """Raise InputError where a machine file that is to stand at ``path`` cannot be built."""
    from truepose.models.file.machine_file import checked_machine
    from truepose.models.file.yaml_document import parse_document
    from truepose.models.load import build_machine

    build_machine(checked_machine(path, parse_document(text, path)))


def _list(as_json: bool) -> None:
    from truepose.models.leaves.starting.start import bundled

    titles = bundled()
    width = max(map(len, titles))
    lines = [f"{name:<{width}}  {title}" for name, title in titles.items()]
    finish({"command": "init", "arms": dict(titles)}, lines, (), as_json=as_json)


def _machine_path(output: Path | None, force: bool) -> Path:
    if output is None:
        raise InputError("-o: found no file to write, expected one: truepose init --arm ur5e -o machine.yaml")
    check_file(output)
    if output.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"-o: found {str(output)!r}, expected a machine file that ends in .yaml")
    if output.exists() and not force:
        raise InputError(f"{output}: found a file that is there already, expected another name, or --force")
    return output


def _frame(text: str, option: str) -> tuple[float, ...] | None:
    """Three numbers, or six, of an option; None where it is not given."""
    if not text:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (3, 6) or not all(map(within, values)):
        raise InputError(f"{option}: found {text!r}, expected X,Y,Z or X,Y,Z,R,P,Y (mm and deg)")
    return values


COMMANDS = (init,)
