"""Draws cases on MuJoCo's arms: ``python -m challenge.mujoco -n 12 --seed 1 -o DIR``; none of them is sat."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from truepose.errors import TrueposeError


def main(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Where cases and answers go.")
    ],
    n: Annotated[int, typer.Option("-n", "--cases", metavar="N", min=1, help="How many cases.")] = 12,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed that all cases follow from.")] = 1,
    arms: Annotated[str, typer.Option("--arms", metavar="A,B,...", help="Only these arms.")] = "",
    strata: Annotated[str, typer.Option("--strata", metavar="X,Y,...", help="Only these strata.")] = "",
) -> None:
    """Draw cases whose physics is MuJoCo's, with their keys."""
    start = time.perf_counter()
    try:
        from challenge.mujoco.written import (
            Asked,
            write,
        )  # says what is missing where MuJoCo is not installed

        asked = Asked(output, n, seed, _names(arms), _names(strata))
        done = write(asked, lambda said: typer.echo(f"{time.perf_counter() - start:7.1f} s  {said}"))
    except TrueposeError as exc:
        typer.echo(str(exc), err=True)
        sys.exit(1)
    typer.echo(f"{len(done)} cases in {output}")


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


if __name__ == "__main__":
    typer.run(main)
