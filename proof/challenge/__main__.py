"""``python -m challenge``: the blind examination of the diagnosis engine, run from a clone."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import (
    DirectoryOption,
    JsonOption,
    PluginOption,
    check_directory,
    finish,
    reported,
)
from truepose.commands.progress import counted
from truepose.errors import InputError

if TYPE_CHECKING:
    from challenge.examine import Challenge
    from challenge.score_table import Table

CountOption = Annotated[
    int | None,
    typer.Option(
        "-n",
        "--cases",
        metavar="N",
        min=1,
        help="How many cases: 400, or all that were drawn.",
        show_default=False,
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed that all cases follow from.")]
JobsOption = Annotated[
    int, typer.Option("--jobs", metavar="J", min=0, help="Processes; 0: one for each core.")
]
MachinesOption = Annotated[
    str,
    typer.Option("--machines", metavar="A,B,...", help="Only these simulated machines.", show_default=False),
]
StrataOption = Annotated[
    str,
    typer.Option(
        "--strata",
        metavar="X,Y,...",
        help="Only these strata: null, single, concealed, look-alike, two, out-of-library, real-like.",
        show_default=False,
    ),
]
AgainOption = Annotated[bool, typer.Option("--again", help="Diagnose cases anew that have a result.")]
TimeoutOption = Annotated[
    float, typer.Option("--timeout", metavar="S", min=1.0, help="Seconds after which a diagnosis has failed.")
]
DrawOption = Annotated[bool, typer.Option("--draw", help="Write cases and answers only.")]
CasesOption = Annotated[
    Path | None,
    typer.Option(
        "--drawn",
        metavar="DIR",
        help="Diagnose the cases of this directory, drawn before.",
        show_default=False,
    ),
]


def challenge(
    output: DirectoryOption,
    n: CountOption = None,
    seed: SeedOption = 1,
    jobs: JobsOption = 0,
    machines: MachinesOption = "",
    strata: StrataOption = "",
    draw: DrawOption = False,
    drawn: CasesOption = None,
    again: AgainOption = False,
    timeout: TimeoutOption = 900.0,
    as_json: JsonOption = False,
    plugin: PluginOption = None,
) -> None:
    """The blind examination of the diagnosis engine, and its table.

    Simulated machines, whose physics is computed another way than the catalogue's, make recordings with nothing missing,
    known imperfections, or many at once; the engine sees machine and recording only. Writes cases/, answers/, results/,
    table.md and table.json. A directory that holds results is continued.

    Example: python -m challenge -n 12 -o examination
    Drawn once, sat by two engines: python -m challenge --draw -o drawn; python -m challenge --drawn drawn -o first
    """
    with reported(plugin):
        from challenge.examine import CASES, run, sitting
        from challenge.examine import challenge as asked

        check_directory(output)
        plugins = tuple(p.resolve() for p in plugin or ())
        if drawn is None:
            names = {"only_machines": _names(machines), "strata": _names(strata)}
            wanted = asked(output, n or CASES, seed=seed, timeout=timeout, plugins=plugins, **names)
        else:
            _alone(draw or bool(machines or strata))
            wanted = replace(sitting(drawn, output, n, timeout), plugins=plugins)
        with counted("drawing" if draw else "examining") as hear:
            seats = run(wanted, jobs=jobs or os.cpu_count() or 1, again=again, draw_only=draw, progress=hear)
        _finish(wanted, len(seats), output, draw=draw, as_json=as_json)


def _alone(beside: bool) -> None:
    """Cases that were drawn are what they are. Raises InputError."""
    if beside:
        raise InputError("challenge: found --drawn beside --draw, --machines or --strata, expected it alone")


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _tabled(output: Path, cases: list[str], drawn: Path | None) -> Table:
    """Score the cases and write the table's files."""
    from challenge.report import tabled

    return tabled(output, cases, drawn)


def _finish(asked: Challenge, done: int, output: Path, *, draw: bool, as_json: bool) -> None:
    """Say how many cases were drawn; else score all, write the table and say what is in it."""
    names = [seat.name for seat in asked.seats]
    if draw:
        told = f"{done} of {len(names)} cases drawn: {output}"
        finish({"command": "challenge", "drawn": done}, [told], [], as_json=as_json)
    else:
        _finish_table(_tabled(output, names, asked.drawn), output, as_json)


def _finish_table(found: Table, output: Path, as_json: bool) -> None:
    from challenge.score_table import lines
    from challenge.table_document import document

    files = [str(output / name) for name in ("table.md", "table.json")]
    whole = document(found)
    summary = {
        "command": "challenge",
        **{k: whole[k] for k in ("cases", "figures", "undrawn")},
        "files": files,
    }
    failed = [f"{s.solution.case}: {s.failure}" for s in found.scores if s.failure]
    notes = [*failed, *(f"not drawn: {text}" for text in found.undrawn)]
    text = [
        f"{len(found.scores)} cases",
        *(f"  {line}" for line in lines(found)),
        f"table: {output / 'table.md'}",
    ]
    finish(summary, text, notes, as_json=as_json)


app = typer.Typer(name="python -m challenge", add_completion=False, rich_markup_mode=None)
app.command()(challenge)

if __name__ == "__main__":
    app()
