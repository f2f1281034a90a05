"""The option ``--try-columns``: alone it means all columns, else the names that follow it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from truepose.commands.one_line import OneLineCommand

OPTION, ALL = "--try-columns", "all"
TryColumnsOption = Annotated[
    str | None,
    typer.Option(
        OPTION,
        metavar="[NAME,NAME...]",
        help="Try columns of numbers that the machine file does not declare as drivers: all, or those named. The more are "
        "tried, the more evidence each needs.",
    ),
]


class WithTryColumns(OneLineCommand):
    """A command whose ``--try-columns`` may stand without names."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Fill in that all are meant where no names follow: an option, a file or the end does."""
        out: list[str] = []
        for k, text in enumerate(args):
            following = args[k + 1] if k + 1 < len(args) else "-"
            bare = text == OPTION and (following.startswith("-") or Path(following).exists())
            out += [OPTION, ALL] if bare else [text]
        return super().parse_args(ctx, out)


def tried_names(option: str | None) -> list[str] | None:
    """The names of an option, none of them for all columns; None where the option was not given."""
    if option is None:
        return None
    names = [name.strip() for name in option.split(",") if name.strip()]
    return [] if names == [ALL] else names
