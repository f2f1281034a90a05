"""The command line's own errors in the words of all others: one line that says what was found and what was expected."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from truepose import faults
from truepose.stopping import stopping

CLICK_ERROR: type[Exception] = next(  # typer has a click of its own, or another package's
    kind for kind in inspect.getmro(typer.BadParameter) if kind.__name__ == "ClickException"
)
STOPPED = 130
"""What typer makes of an interruption."""


class OneLineGroup(TyperGroup):
    """All commands: whatever they raise is told in one line, in tests as in a terminal."""

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Run the command that the arguments name, and leave with its exit code."""
        stopping.written.clear()  # of a command before, in the same process
        run = partial(
            super().main,
            args=args,
            prog_name=prog_name or "truepose",
            complete_var=complete_var,
            standalone_mode=False,
            windows_expand_args=windows_expand_args,
            **extra,
        )
        if not standalone_mode:
            return run()
        sys.exit(faults.ended(partial(_told, run)))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse what is no name of anything before it is taken for one."""
        _check_texts(ctx, args)
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that was meant, or what there is."""
        try:
            return super().resolve_command(ctx, args)
        except CLICK_ERROR as exc:
            near = getattr(exc, "message", "").partition("Did you mean")[2]
            hint = f"; did you mean{near.rstrip('?')}?" if near else ""
            names = ", ".join(name for name in self.commands if not self.commands[name].hidden)
            raise typer.BadParameter(f"found the command {args[0]!r}, expected one of {names}{hint}") from exc


class OneLineCommand(TyperCommand):
    """A command that knows an empty name of a file: as a path it would be the working directory."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse names of files that are none."""
        _check_texts(ctx, args)
        named = {
            text
            for parameter in self.params
            if parameter.param_type_name == "option" and parameter.metavar in FILES
            for text in parameter.opts
        }
        for k, text in enumerate(args):
            before = args[k - 1] if k else ""
            option, sign, value = text.partition("=")
            of_file = before in named if not text else option in named and bool(sign) and not value
            if of_file or not (text or before.startswith("-")):
                where = (option or before) if of_file else "arguments"
                raise typer.BadParameter(f"{where}: found an empty text, expected a name", ctx=ctx)
        return super().parse_args(ctx, args)


FILES = ("FILE", "DIR", "FILE|DIR")
"""What options of files and folders take, as the help has it."""


def _check_texts(ctx: Any, args: Sequence[str]) -> None:
    for text in args:
        if "\0" in text:
            raise typer.BadParameter(f"found {text!r}, expected no character NUL", ctx=ctx)


def _told(run: Callable[[], Any]) -> int:
    """The exit code; what typer itself has to say is said in a line, its help as it is."""
    try:
        code = run()
    except typer.Abort:
        return faults.stopped()
    except CLICK_ERROR as exc:
        if type(exc).__name__ == "NoArgsIsHelpError":
            exc.show()  # type: ignore[attr-defined]
        else:
            faults.say(_words(exc))
        return faults.BAD_INPUT
    return faults.stopped() if code == STOPPED or stopping.number else code if isinstance(code, int) else 0


def _words(exc: Exception) -> str:
    """``plan: '-n' / '--poses': found 'abc', expected a valid integer; truepose plan --help tells more``."""
    ctx = getattr(exc, "ctx", None)
    path = ctx.command_path if ctx is not None else "truepose"
    command = path.partition(" ")[2]
    message = _message(exc).rstrip(".")
    said = f"{command}: {message}" if command else message
    return f"{said}; truepose {command} --help tells what it takes".replace("truepose  ", "truepose ")


def _message(exc: Exception) -> str:
    text = str(getattr(exc, "message", "")) or str(exc)
    found = _found(exc.__cause__)
    parameter = getattr(exc, "param", None)
    if found is not None and parameter is not None:
        hint = " / ".join(parameter.opts) if parameter.param_type_name == "option" else parameter.name
        return f"{hint}: found {found!r}, expected {_expected(text)}"
    if isinstance(exc, typer.BadParameter) and text and parameter is None:
        return text  # our own
    text = str(exc.format_message())  # type: ignore[attr-defined]
    return text[:1].lower() + text[1:]


def _found(cause: BaseException | None) -> object:
    """The value that pydantic would not take, with which newer versions of typer read types."""
    errors = getattr(cause, "errors", None)
    return errors()[0]["input"] if callable(errors) else None


def _expected(text: str) -> str:
    for beginning in ("Input should be ", "is not "):
        if beginning in text:
            return text.partition(beginning)[2].partition(", unable")[0].rstrip(".")
    return f"another value: {text}"


__all__ = ["OneLineCommand", "OneLineGroup"]
