"""Runs the study and prints its tables; exit code 1 where a name was wrong or an omission was not told."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from .study import OMISSIONS, Told, Way, whole, without


def main(
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Keeps all files.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="How many arms.")] = 4,
) -> None:
    """Every arm the whole way; the first one again with gravity, tolerances or base left out."""
    with tempfile.TemporaryDirectory() as room:
        home = output or Path(room)
        ways = [whole(home / f"arm{seed}", seed) for seed in range(1, seeds + 1)]
        told = [without(home / "arm1", name) for name in OMISSIONS] if not ways[0].faults else []
    typer.echo(report(ways, told))
    sys.exit(0 if told and all(w.right for w in ways) and all(t.right for t in told) else 1)


def report(ways: list[Way], told: list[Told]) -> str:
    """Markdown."""
    lines = ["| arm | names | unseen poses, plain -> improved, mm | seconds | |", "|---|---|---|---|---|"]
    for w in ways:
        names = ", ".join(f"{e} {p}" for e, p in sorted(w.named)) or "none"
        steps = " + ".join(f"{d.words[0]} {d.seconds:.1f}" for d in w.done)
        state = "; ".join(w.faults) or ("right" if w.right else "**wrong**")
        lines.append(
            f"| {w.seed} | {names} | {w.before:.3f} -> {w.after:.3f} | {w.seconds:.1f} ({steps}) | {state} |"
        )
    lines += [
        "",
        "| left out | check says | exits of check, diagnose | asserted | |",
        "|---|---|---|---|---|",
    ]
    for t in told:
        names = ", ".join(f"{e} {p}" for e, p in sorted(t.guessed)) or "nothing"
        state = "told" if t.right else "**not told**"
        found = f"{t.verdict}: {', '.join(t.kinds) or 'nothing'}"
        lines.append(f"| {t.omitted} | {found} | {t.exits[0]}, {t.exits[1]} | {names} | {state} |")
    return "\n".join(lines)


if __name__ == "__main__":
    typer.run(main)
