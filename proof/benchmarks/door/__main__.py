"""Tries the law of the door: ``python -m benchmarks.door --per-kind 6 --right 40 --seed 1 --jobs 2 -o DIR``."""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path
from typing import Annotated

import typer
from door.outcome import RIGHT, Outcome
from door.recordings import recordings
from door.sitting import sit, sit_recording
from door.slips import SLIPS
from door.table import write_results
from joblib import Parallel, delayed


def main(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Table, results, pairs that fail.")
    ],
    per_kind: Annotated[int, typer.Option("--per-kind", min=0, help="How many wrong pairs of a kind.")] = 6,
    right: Annotated[int, typer.Option("--right", min=0, help="How many drawn right pairs.")] = 40,
    real: Annotated[bool, typer.Option(help="Whether recordings of others are tried, too.")] = True,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed that all pairs follow from.")] = 1,
    kinds: Annotated[str, typer.Option("--kinds", metavar="KIND,...", help="Only these kinds.")] = "",
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="Processes.")] = 2,
) -> None:
    """Draw, ask ``check``, calibrate, and write ``table.md`` and ``cases.json``."""
    names = [name.strip() for name in kinds.split(",") if name.strip()] or list(SLIPS)
    if unknown := [name for name in names if name not in SLIPS]:
        typer.echo(f"--kinds: found {unknown[0]!r}, expected some of {', '.join(SLIPS)}", err=True)
        sys.exit(2)
    keep = output / "cases"
    output.mkdir(parents=True, exist_ok=True)
    work = [delayed(_quiet)(sit_recording, name, keep) for name in (recordings() if real else ())]
    work += [delayed(_quiet)(sit, RIGHT, k, seed, keep) for k in range(right)]
    work += [delayed(_quiet)(sit, kind, k, seed, keep) for kind in names for k in range(per_kind)]
    start, outcomes = time.perf_counter(), []
    for outcome in Parallel(jobs, return_as="generator", batch_size=1)(work):
        outcomes.append(outcome)
        if outcome.breaks_the_law:
            typer.echo(f"{time.perf_counter() - start:7.1f} s  {outcome.name}: {outcome.verdict}", err=True)
    typer.echo(write_results(output, outcomes))


def _quiet(examine: object, *about: object) -> Outcome:
    """Return an outcome without numpy's words on poses that a slip puts out of reach."""
    warnings.simplefilter("ignore")
    return examine(*about)  # type: ignore[operator,no-any-return]


if __name__ == "__main__":
    typer.run(main)
