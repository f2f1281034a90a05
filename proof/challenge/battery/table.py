"""Folders of the battery side by side: a column for each, a row for each figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from challenge.battery.figures import figures
from challenge.battery.parts import PARTS
from challenge.battery.results import done, read
from challenge.figures import Figure
from truepose.errors import InputError


def table(folders: Sequence[Path]) -> str:
    """Markdown. A figure counts the cases that every folder has, and says how many each has.

    Raises InputError for a folder without results, and where no case is in all of them.
    """
    for folder in folders:
        if not any(done(folder, part) for part in PARTS):
            raise InputError(
                f"{folder}: found no results, expected a folder of 'python -m challenge.battery sit'"
            )
    blocks = [block for part in PARTS if (block := _block(part, folders))]
    if not blocks:
        raise InputError(f"{', '.join(map(str, folders))}: found no case that all have, expected some")
    head = f"| figure | {' | '.join(_names(folders))} |"
    return (
        "\n".join([head, "|---|" + "---|" * len(folders), *(line for block in blocks for line in block)])
        + "\n"
    )


def _block(part: str, folders: Sequence[Path]) -> list[str]:
    """The rows of a part; none where no case is in all folders."""
    had = [done(folder, part) for folder in folders]
    both = set.intersection(*had)
    if not both:
        return []
    columns = [figures(part, read(folder, part, both)) for folder in folders]
    counts = " | ".join(f"{len(both)} of {len(own)}" for own in had)
    rows = [f"| **{part}**: cases that all have | {counts} |"]
    return [
        *rows,
        *(f"| {same[0].name} | {' | '.join(map(_cell, same))} |" for same in zip(*columns, strict=True)),
    ]


def _cell(figure: Figure) -> str:
    if figure.value is None:
        return "-"
    return (
        f"{figure.hits} of {figure.n}" if figure.share and figure.hits <= figure.n else f"{figure.value:.3g}"
    )


def _names(folders: Sequence[Path]) -> list[str]:
    """Names of folders; whole paths where two are called alike."""
    short = [folder.resolve().name for folder in folders]
    return short if len(set(short)) == len(short) else [str(folder) for folder in folders]


__all__ = ["table"]
