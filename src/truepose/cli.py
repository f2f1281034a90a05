"""The command line, ``truepose COMMAND``: each command is a thin wrapper around a function of the library."""

from __future__ import annotations

import functools
import inspect
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from truepose.commands.catalogue import effects, schema
from truepose.commands.common import PluginOption, reported
from truepose.commands.compensate import compensate
from truepose.commands.controller import codegen
from truepose.commands.identifiability import identifiability
from truepose.commands.identify import calibrate, diagnose
from truepose.commands.one_line import OneLineCommand, OneLineGroup
from truepose.commands.tables import predict, simulate
from truepose.demo import demo
from truepose.leaves import modules_named

app = typer.Typer(
    name="truepose",
    cls=OneLineGroup,
    help="Calibrates precision robots, finds the physics their models leave out, writes the controller's C.",
    epilog="Exit codes: 0 done, 2 bad input or no calibration, 3 the fit did not converge (nothing is written).",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _with_common(command: Callable[..., None]) -> Callable[..., None]:
    """Return the command with the option ``--plugin``, its errors reported in one line."""
    own = inspect.signature(command, eval_str=True)

    @functools.wraps(command)
    def run(*, plugin: list[Path] | None = None, **options: Any) -> None:
        with reported(plugin):
            command(**options, **({"plugin": plugin} if "plugin" in own.parameters else {}))

    added = inspect.Parameter("plugin", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=PluginOption)
    parameters = {**own.parameters, "plugin": added}
    run.__signature__ = own.replace(parameters=list(parameters.values()))  # type: ignore[attr-defined]
    run.__annotations__ = {name: parameter.annotation for name, parameter in parameters.items()}
    return run


ORDER = (
    "demo", "init", "check", "calibrate", "diagnose", "identifiability", "drift", "fleet", "plan", "poses", "predict",
    "simulate", "compensate", "codegen", "export", "effects", "schema", "import",
)  # fmt: skip
"""How the help lists commands: in the order of the work, then others by name."""


def commands() -> dict[str, Callable[..., None]]:
    """Return the commands of the kernel and of the leaves; a leaf's takes the place of the kernel's of the same name."""
    kernel = (
        demo, calibrate, diagnose, identifiability, predict, simulate, compensate, codegen, effects, schema,
    )  # fmt: skip
    leaves = (command for leaf in modules_named("command") for command in leaf.COMMANDS)
    named = {command.__name__.strip("_"): command for command in (*kernel, *leaves)}
    return dict(sorted(named.items(), key=lambda item: (*ORDER, item[0]).index(item[0])))


for _name, _command in commands().items():
    app.command(_name, cls=OneLineCommand)(_with_common(_command))


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
    """Run the command line as a program, which ends with it."""
    for library in ("OPENBLAS", "OMP", "MKL"):
        # matrices are small here: threads of the linear algebra wait for each other longer than they work
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a name or a unit that the terminal has no letters for
            stream.reconfigure(errors="backslashreplace")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: temporary files go
    app()


if __name__ == "__main__":
    main()
