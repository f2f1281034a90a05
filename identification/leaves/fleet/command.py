"""``fleet``: a folder of machines with their recordings, checked, calibrated and diagnosed side by side."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import (
    BAD_INPUT,
    FLEET,
    DirectoryOption,
    GateOption,
    JsonOption,
    PluginOption,
    ShuffledOption,
    check_directory,
    fail,
    finish,
    written,
)
from truepose.commands.identify import PriorOption
from truepose.commands.progress import counted
from truepose.errors import InputError

if TYPE_CHECKING:
    from truepose.pool import Pool

FolderArg = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of the fleet: a folder for each machine.")
]
WorkersOption = Annotated[
    int,
    typer.Option(
        "-j",
        "--workers",
        metavar="N",
        help="Machines at once; 0: one for each processor.",
        min=0,
        show_default=False,
    ),
]
DaskOption = Annotated[
    str,
    typer.Option(
        "--dask",
        metavar="ADDRESS",
        help="Scheduler of a Dask cluster that works in place of this computer's cores (tcp://host:8786). Its workers "
        "have this version of truepose and see DIR and the results under the same paths.",
    ),
]
BriefOption = Annotated[bool, typer.Option("--brief", help="Without the report.html of each machine.")]


def fleet(
    folder: FolderArg,
    output: DirectoryOption,
    workers: WorkersOption = 0,
    dask: DaskOption = "",
    brief: BriefOption = False,
    prior: PriorOption = None,
    shuffled: ShuffledOption = False,
    anyway: GateOption = False,
    as_json: JsonOption = False,
    plugin: PluginOption = None,
) -> None:
    """Check, calibrate and diagnose a fleet of machines side by side.

    Writes a table (fleet.csv), a page (fleet.html), fleet.json, a prior file for diagnose --prior, and the results of each
    machine in machines/NAME/.

    DIR/NAME/ holds a machine file (machine.yaml, or the only .yaml there) beside its recordings, which may be in
    DIR/NAME/recordings/. Several recordings are taken together, in the order of their names. A DIR/machine.yaml is for all
    folders that have none; with it, a recording DIR/NAME.csv is a machine, too. What does not fit is a row that says why.

    Started again it goes on where it was, and works on machines only whose files, options or truepose have changed.

    Example: truepose fleet line1 -o line1-results

    Example: truepose fleet line1 -o line1-results --workers 2 --brief
    """
    from truepose.identification.leaves.fleet.page import fleet_document
    from truepose.identification.leaves.fleet.run import FILES, PAGE, run_fleet
    from truepose.identification.leaves.fleet.words import fleet_json, headline
    from truepose.identification.leaves.fleet.work import Options
    from truepose.shown.text import LINES, first_screen

    check_directory(output, FLEET)
    plugins = tuple(path.resolve() for path in plugin or ())
    options = Options(anyway, shuffled, brief, plugins, None if prior is None else prior.resolve())
    with counted("fleet") as hear, _pool(workers, dask) as pool:
        found = run_fleet(folder, output, pool, options, progress=hear)
    summary = {"command": "fleet", **fleet_json(found), "files": written(output, FILES)}
    lines = [*first_screen(fleet_document(found), 2 * LINES), f"report: {output / PAGE}"]
    finish(summary, lines, (), as_json=as_json)
    if not found.diagnosed:
        fail(f"{folder}: {headline(found)} {output / FILES[0]} says why", BAD_INPUT)


@contextlib.contextmanager
def _pool(workers: int, dask: str) -> Iterator[Pool]:
    """Cores of this computer, or a cluster."""
    from truepose.pool import Cores, cluster
    from truepose.threads import cores

    if dask and workers:
        raise InputError(
            "--dask: found with --workers, expected one of them: a cluster has the workers that it has"
        )
    if not dask:
        yield Cores(workers or cores())
        return
    with cluster(dask) as found:
        yield found


COMMANDS = (fleet,)
