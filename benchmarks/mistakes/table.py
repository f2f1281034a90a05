"""The results: a Markdown table, kinds in rows, and every case as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from truepose.files import atomic_write_text

from .correct import CORRECT
from .kinds import KINDS
from .scoring import Scored


def write_results(output: Path, results: Sequence[Scored]) -> str:
    """``table.md`` and ``cases.json``; the table."""
    text = table(results)
    atomic_write_text(output / "table.md", text)
    atomic_write_text(output / "cases.json", json.dumps([asdict(r) for r in results], indent=1) + "\n")
    return text


def table(results: Sequence[Scored]) -> str:
    """Markdown."""
    wrong = [r for r in results if r.kind != CORRECT]
    lines = [
        "| mistake | cases | named first | named at all | place right | told: wrong, suspect | corrected pair fits |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [_row(kind, own) for kind in KINDS if (own := [r for r in wrong if r.kind == kind])]
    if wrong:
        lines.append(_row("**all**", wrong))
    right = [r for r in results if r.kind == CORRECT]
    if right:
        lines += ["", *_of_right(right)]
    lines += ["", *_times(results), ""]
    return "\n".join(lines)


def _row(kind: str, own: Sequence[Scored]) -> str:
    told = f"{sum(r.verdict == 'wrong' for r in own)}, {sum(r.verdict == 'suspect' for r in own)}"
    asked = [r for r in own if r.fits is not None]
    fits = f"{sum(bool(r.fits) for r in asked)} of {len(asked)}" if asked else ""
    counts = (sum(getattr(r, name) for r in own) for name in ("first", "named", "placed"))
    return f"| {kind} | {len(own)} | {' | '.join(map(str, counts))} | {told} | {fits} |"


def _of_right(right: Sequence[Scored]) -> list[str]:
    groups: dict[str, list[Scored]] = {"real recordings": [], "bundled": [], "practice": [], "simulated": []}
    for r in right:
        first = r.source.split()[0]
        names = {"real": "real recordings", "bundled": "bundled", "practice": "practice"}
        groups[names.get(first, "simulated")].append(r)
    groups = {**groups, "**all**": list(right)}
    lines = ["| right pairs | cases | ok | suspect | wrong | no answer |", "|---|---|---|---|---|---|"]
    for name, own in groups.items():
        if own:
            counts = [sum(r.verdict == v for r in own) for v in ("ok", "suspect", "wrong", "")]
            lines.append(f"| {name} | {len(own)} | {' | '.join(map(str, counts))} |")
    accused = [f"{r.name} ({r.source}): {r.verdict or 'no answer'}, {', '.join(r.kinds)}" for r in right]
    blamed = [text for text, r in zip(accused, right, strict=True) if r.verdict != "ok"]
    return [*lines, "", *(f"* {text}" for text in blamed)]


def _times(results: Sequence[Scored]) -> list[str]:
    own, whole = (np.array([getattr(r, name) for r in results]) for name in ("seconds", "wall"))
    return [
        f"Seconds of `check` itself: median {np.median(own):.2f}, largest {own.max():.2f} "
        f"({results[int(own.argmax())].name}); with the interpreter: median {np.median(whole):.2f}, largest {whole.max():.2f}."
    ]


__all__ = ["table", "write_results"]
