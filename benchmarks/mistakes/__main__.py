"""Draws right pairs and mistakes, and sits them: ``python -m benchmarks.mistakes -n 200 --seed 2 -o DIR``."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from truepose.errors import TrueposeError

from .drawing import Asked, draw
from .kinds import KINDS
from .sitting import sit
from .table import write_results


def main(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Cases, results and table.")],
    n: Annotated[int, typer.Option("-n", "--cases", min=0, help="How many mistakes.")] = 200,
    correct: Annotated[
        int, typer.Option("--correct", help="How many right pairs; as many as mistakes.")
    ] = -1,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed that all cases follow from.")] = 1,
    only: Annotated[str, typer.Option("--only", metavar="KIND,...", help="Only these kinds.")] = "",
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="Processes.")] = 2,
    truth: Annotated[Path | None, typer.Option("--truth", help="Where the truth goes: DIR-truth.")] = None,
    draw_only: Annotated[bool, typer.Option("--draw", help="Draw only.")] = False,
    drawn: Annotated[
        Path | None, typer.Option("--drawn", metavar="DIR", help="Sit cases drawn before.")
    ] = None,
) -> None:
    """Draw, sit, and write ``table.md`` and ``cases.json``."""
    start = time.perf_counter()
    source = drawn or output
    apart = truth or source.with_name(f"{source.name}-truth")
    kinds = tuple(name.strip() for name in only.split(",") if name.strip())
    if unknown := [name for name in kinds if name not in KINDS]:
        typer.echo(f"--only: found {unknown[0]!r}, expected some of {', '.join(KINDS)}", err=True)
        sys.exit(2)

    def say(text: str) -> None:
        typer.echo(f"{time.perf_counter() - start:7.1f} s  {text}")

    try:
        if drawn is None:
            draw(Asked(output, apart, n, n if correct < 0 else correct, seed, kinds), jobs, say)
        if not draw_only:
            results = sit(source, apart, output, jobs, say)
            typer.echo(write_results(output, results))
    except TrueposeError as exc:
        typer.echo(str(exc), err=True)
        sys.exit(2)


if __name__ == "__main__":
    typer.run(main)
