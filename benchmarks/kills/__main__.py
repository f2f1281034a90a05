"""Kills every command that writes: ``python -m benchmarks.kills -n 100 -o FILE.md``."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import tempfile
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .cases import CASES
from .inputs import write_inputs
from .study import Row, study

LIBRARIES = (
    "truepose.identification.diagnosis.engine",
    "truepose.identification.fit.calibrate",
    "truepose.identification.leaves.drift.analysis",
    "truepose.identification.leaves.planning.plan",
    "truepose.identification.report.files",
    "truepose.shown.html",
    "truepose.identification.leaves.fleet.run",
    "truepose.identification.leaves.check.run",
    "truepose.models.leaves.starting.sources",
    "truepose.models.leaves.export.write",
    "truepose.codegen.c",
    "truepose.codegen.leaves.embedded.write",
    "pandas",
    "pyarrow.parquet",
)
"""What is loaded once, so that the time of a command is that of its work."""


class Sent(StrEnum):
    """Signals by the names of the option."""

    kill = "kill"
    int = "int"
    term = "term"


def load() -> None:
    """Load what commands need, in the process that others are forked from."""
    for name in LIBRARIES:
        importlib.import_module(name)


def main(
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="The table.")] = None,
    n: Annotated[int, typer.Option("-n", "--kills", min=1, help="How many for each command.")] = 100,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the moments.")] = 1,
    only: Annotated[str, typer.Option("--only", metavar="NAME,...", help="Only these commands.")] = "",
    sent: Annotated[Sent, typer.Option("--signal", help="What is sent.")] = Sent.kill,
) -> None:
    """Kill, look, run again, and write the table; exit code 1 where a result was mixed or something was left."""
    wanted = [case for case in CASES if not only or case.name in only.split(",")]
    if only and len(wanted) < len(only.split(",")):
        typer.echo(
            f"--only: found {only!r}, expected names among {', '.join(case.name for case in CASES)}", err=True
        )
        sys.exit(2)
    number = signal.Signals[f"SIG{sent.name.upper()}"]
    rows = []
    load()
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        folder = Path(name)
        write_inputs(folder / "in")
        for case in wanted:
            place = folder / case.name.replace(" ", "_")
            place.mkdir()
            rows.append(study(case, folder / "in", place, kills=n, seed=seed, number=number))
            typer.echo(_line(rows[-1]))
            for text in rows[-1].untrue:
                typer.echo(f"  {text}", err=True)
    if output is not None:
        output.write_text(_page(rows, n, seed, sent), encoding="utf-8")
    sys.exit(0 if all(row.right for row in rows) else 1)


def _line(row: Row) -> str:
    states = " | ".join(str(row.states[name]) for name in ("old", "new", "mixed"))
    told = f"{len(row.litter)} | {len(row.untrue)} | {row.slowest:.2f}"
    return f"| {row.name} | {row.lasts:.2f} | {row.kills} | {states} | {told} |"


def _page(rows: list[Row], n: int, seed: int, sent: Sent) -> str:
    killed = sent is Sent.kill
    litter, slowest = (
        ("litter left after next run", "slowest next run, s") if killed else ("litter", "slowest end, s")
    )
    words = f"`python -m benchmarks.kills -n {n} --seed {seed} --signal {sent.name} -o FILE.md`"
    head = f"| command | takes, s | signals | old | new | mixed | {litter} | told wrongly | {slowest} |"
    total = sum(row.kills for row in rows)
    return "\n".join(
        [
            f"# Commands that are {'killed' if killed else 'stopped'} at any moment",
            "",
            f"{total} signals SIG{sent.name.upper()}, at random moments of each command, more of them at its end, where it "
            "publishes. `old` and `new`: which result a reader finds then, of all files of the command together.",
            "",
            head,
            "|---|" + "---:|" * 8,
            *map(_line, rows),
            "",
            f"{words}, {os.cpu_count()} processors.",
            "",
        ]
    )


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    typer.run(main)
