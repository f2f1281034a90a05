"""``challenge``: says where the examination of the diagnosis has gone."""

from __future__ import annotations

from typing import Annotated

import typer

from truepose.commands.common import BAD_INPUT, fail

MOVED = "challenge: the examination is not installed any more; in a clone of the project, run: python -m challenge"


def challenge(
    words: Annotated[list[str] | None, typer.Argument(metavar="...", help="Whatever it took before.")] = None,
) -> None:
    """Moved: ``python -m challenge`` runs the examination in a clone of the project."""
    fail(MOVED, BAD_INPUT)
