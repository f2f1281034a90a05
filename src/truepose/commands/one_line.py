"""The end of a command: an exit code, and one line on standard error where something went wrong."""

from __future__ import annotations

import contextlib
import inspect
import os
import sys
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from truepose.errors import ConvergenceError, TrueposeError
from truepose.files import reason
from truepose.version import VERSION

FAULT, BAD_INPUT, NOT_CONVERGED, STOPPED = 1, 2, 3, 130
CLICK_ERROR: type[Exception] = next(  # typer has a click of its own, or another package's
    kind for kind in inspect.getmro(typer.BadParameter) if kind.__name__ == "ClickException"
)


class OneLineGroup(TyperGroup):
    """All commands: each error is reported in one line, in tests as in a terminal."""

    def main(self, *arguments: Any, standalone_mode: bool = True, **options: Any) -> Any:
        """Run the command that the arguments name, and leave with its exit code."""
        options |= {"prog_name": options.get("prog_name") or "truepose", "standalone_mode": False}
        run = partial(super().main, *arguments, **options)
        if not standalone_mode:
            return run()
        sys.exit(exit_code(run))


class OneLineCommand(TyperCommand):
    """A command that refuses an empty word: as a path it would be the working directory."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse empty words, as a variable that is not set leaves one, then parse."""
        for before, word in pairwise(["arguments", *args]):
            if not word or (word.startswith("--") and word.endswith("=")):
                where = word.removesuffix("=") or before
                raise typer.BadParameter(f"{where}: found an empty text, expected a name", ctx=ctx)
        return super().parse_args(ctx, args)


def exit_code(run: Callable[[], object]) -> int:
    """Run a command and return its exit code; write one line on standard error where it failed."""
    try:
        code = run()
    except SystemExit as exc:
        code = 0 if isinstance(exc.__context__, BrokenPipeError) else exc.code  # nobody reads on: no fault
    except BrokenPipeError:
        forget(sys.stdout)
        return 0
    except CLICK_ERROR as exc:
        _say_usage(exc)
        return BAD_INPUT
    except (KeyboardInterrupt, typer.Abort):
        code = STOPPED
    except Exception as exc:
        if isinstance(exc, OSError):
            forget(sys.stdout)  # it may be what is full
        words = describe(exc)
        say(words or _report(exc))
        return NOT_CONVERGED if isinstance(exc, ConvergenceError) else BAD_INPUT if words else FAULT
    if code == STOPPED:  # what typer makes of Ctrl-C
        say("stopped")
    return code if isinstance(code, int) else 0


def describe(exc: Exception) -> str:
    """Return what a user can mend, in words; an empty text for a fault of the program."""
    if isinstance(exc, TrueposeError):
        return str(exc)
    if isinstance(exc, MemoryError) or "bad_alloc" in str(exc):
        return "found too little memory, expected fewer rows, poses or parameters at once"
    if isinstance(exc, RecursionError):
        return "found levels nested deeper than can be followed, expected fewer"
    if isinstance(exc, OSError) and exc.errno is not None:
        return f"{exc.filename or 'the system says'}: {reason(exc)}"
    return ""


def say(message: str) -> None:
    """Write one line on standard error, if anybody can read it."""
    try:
        typer.echo("error: " + " ".join(message.split("\n")), err=True)
        sys.stderr.flush()
    except OSError:
        forget(sys.stderr)


def forget(stream: Any) -> None:
    """Let a stream that nobody takes lead nowhere: Python would report it once more at its end."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _say_usage(exc: Any) -> None:
    """Write what typer has to say of the command line; its help as it is."""
    if type(exc).__name__ == "NoArgsIsHelpError":
        exc.show()
        return
    command = exc.ctx.command_path.partition(" ")[2] if getattr(exc, "ctx", None) else ""
    own = isinstance(exc, typer.BadParameter) and exc.param is None
    message = str(exc.message if own and exc.message else exc.format_message()).rstrip(".")
    errors = getattr(
        exc.__cause__, "errors", None
    )  # of pydantic, with which newer versions of typer read types
    message += f", found {errors()[0]['input']!r}" if callable(errors) else ""
    say(
        f"{command}: {message}; see truepose {command} --help"
        if command
        else f"{message}; see truepose --help"
    )


def _report(exc: Exception) -> str:
    """Write a report of a fault of the program into the folder for temporary files, and say how to send it."""
    import platform
    import shlex
    import tempfile
    import traceback

    place = "no report of it could be written"
    with contextlib.suppress(OSError):
        options = {"prefix": "truepose-fault-", "suffix": ".txt", "encoding": "utf-8"}
        with tempfile.NamedTemporaryFile("w", delete=False, errors="backslashreplace", **options) as report:  # type: ignore[call-overload]
            report.write(f"truepose {VERSION}, Python {platform.python_version()}, {platform.platform()}\n")
            report.write(f"{shlex.join(sys.argv)}\n\n")
            traceback.print_exception(exc, file=report)
            place = f"please send the report {report.name}"
    what = " ".join(f"{type(exc).__name__}: {exc}".split())[:200]
    return f"a fault of truepose {VERSION}, not of your files ({what}); {place}"
