"""What every command shares: options, errors as one line with an exit code, progress, notes, summaries."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from truepose.errors import ConvergenceError, InputError, TrueposeError

BAD_INPUT, NOT_CONVERGED = 2, 3
DELAY = 2.0
"""Seconds of work before a progress display appears."""

MachineArg = Annotated[
    Path, typer.Argument(metavar="MACHINE", help="Machine file (YAML).", show_default=False)
]
RecordingArg = Annotated[
    Path,
    typer.Argument(
        metavar="RECORDING", help="Recording (text, Parquet, Excel or a ROS bag).", show_default=False
    ),
]
RecordingsArg = Annotated[
    list[Path],
    typer.Argument(
        metavar="RECORDING...",
        help="One or several recordings (text, Parquet, Excel or ROS bags).",
        show_default=False,
    ),
]
DirectoryOption = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Directory for the results.", show_default=False)
]
FileOption = Annotated[
    Path,
    typer.Option(
        "-o", "--output", metavar="FILE", help="File to write (.csv or .parquet).", show_default=False
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else.")
]
AnywayOption = Annotated[
    bool,
    typer.Option("--anyway", help="Go on where the file would leave the tool worse than plain calibration."),
]
PluginOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin",
        metavar="FILE",
        help="Python file that registers effects, sensors or builders; repeatable.",
    ),
]


@contextlib.contextmanager
def reported(plugins: Sequence[Path] | None = None) -> Iterator[None]:
    """Load plugins, run the block, and turn an error a user can mend into one line and an exit code."""
    from truepose.models.registry import load_plugin

    try:
        for path in plugins or ():
            load_plugin(path)
        yield
    except ConvergenceError as exc:
        fail(str(exc), NOT_CONVERGED)
    except TrueposeError as exc:
        fail(str(exc), BAD_INPUT)


def fail(message: str, code: int) -> None:
    """One line on standard error, then out."""
    typer.echo("error: " + " ".join(message.splitlines()), err=True)
    raise typer.Exit(code)


@contextlib.contextmanager
def progress(label: str) -> Iterator[Callable[[str], None]]:
    """A display of what is going on after two seconds, on a terminal only; yields how to say what goes on."""
    if not (sys.stdout.isatty() and sys.stderr.isatty()):
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    display = Progress(*columns, console=Console(stderr=True), transient=True)
    task = display.add_task(label, total=None)
    timer = threading.Timer(DELAY, display.start)
    timer.daemon = True
    timer.start()
    try:
        yield lambda text: display.update(task, description=text)
    finally:
        timer.cancel()
        timer.join()
        display.stop()


def finish(summary: Mapping[str, Any], lines: Iterable[str], notes: Iterable[str], *, as_json: bool) -> None:
    """The end of a command: the JSON summary alone, or plain lines with notes on standard error."""
    if as_json:
        from truepose.identification.report.json_text import json_text

        typer.echo(json_text({**summary, "notes": list(notes)}), nl=False)
        return
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    for line in lines:
        typer.echo(line)


def check_directory(path: Path) -> None:
    """Refuse at once what could only fail after the work: a file in the directory's place."""
    for place in (path, *path.parents):
        if place.exists():
            if not place.is_dir():
                raise InputError(f"{path}: expected a directory for the results, found the file {place}")
            return


def check_file(path: Path) -> None:
    """Refuse at once an output that cannot be a file."""
    if path.is_dir():
        raise InputError(f"{path}: expected a file to write, found a directory")
    if not path.absolute().parent.is_dir():
        raise InputError(f"{path}: cannot write the file: its directory does not exist")


def written(directory: Path, names: Iterable[str]) -> list[str]:
    """Paths of the files written, as text."""
    return [str(directory / name) for name in names]
