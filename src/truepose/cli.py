"""The command line, ``truepose COMMAND``: each command is a thin wrapper around a function of the library."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from truepose.commands.catalogue import effects
from truepose.commands.challenge import challenge
from truepose.commands.compensate import compensate
from truepose.commands.controller import codegen
from truepose.commands.drift import drift
from truepose.commands.export import export
from truepose.commands.identifiability import identifiability
from truepose.commands.identify import calibrate, diagnose
from truepose.commands.import_ import import_
from truepose.commands.init import init
from truepose.commands.plan import plan
from truepose.commands.poses import poses
from truepose.commands.schema import schema
from truepose.commands.tables import predict, simulate
from truepose.demo import demo

app = typer.Typer(
    name="truepose",
    help="Calibrates precision robots, finds the physics their models leave out, writes the controller's C.",
    epilog="Exit codes: 0 done, 2 bad input, 3 the fit did not converge (nothing is written).",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for _command in (
    demo,
    init,
    calibrate,
    diagnose,
    identifiability,
    drift,
    plan,
    poses,
    predict,
    simulate,
    compensate,
    codegen,
    export,
    challenge,
    effects,
    schema,
):
    app.command()(_command)
app.command("import")(import_)


def _version(wanted: bool) -> None:
    if wanted:
        from truepose import __version__

        typer.echo(f"truepose {__version__}")
        raise typer.Exit()


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def main() -> None:
    """Entry point of the console command."""
    for library in ("OPENBLAS", "OMP", "MKL"):
        # matrices are small here: threads of the linear algebra wait for each other longer than they work
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    app()


if __name__ == "__main__":
    main()
