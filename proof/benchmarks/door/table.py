"""The results: Markdown tables by kind, what breaks the law line by line, and every pair as JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from truepose.files import atomic_write_text

from .outcome import Outcome

COLUMNS = (
    *("kind", "pairs", "right, off, between", "ok", "suspect", "wrong", "refused"),
    *("off, but ok", "right, but wrong", "advice: right", "wrong", "none", "s"),
)


def write_results(output: Path, outcomes: Sequence[Outcome]) -> str:
    """Write ``table.md`` and ``cases.json``; return the table."""
    text = table(outcomes)
    atomic_write_text(output / "table.md", text)
    atomic_write_text(output / "cases.json", json.dumps([asdict(o) for o in outcomes], indent=1) + "\n")
    return text


def table(outcomes: Sequence[Outcome]) -> str:
    """Return the law's three counts, a row a kind, and a line a pair that breaks the law."""
    kinds = dict.fromkeys(o.kind for o in outcomes)
    rows = [_row(kind, [o for o in outcomes if o.kind == kind]) for kind in kinds]
    breaks = [_line(o) for o in outcomes if o.breaks_the_law]
    lines = [
        *_law(outcomes),
        "",
        f"| {' | '.join(COLUMNS)} |",
        "|---|" + "---:|" * (len(COLUMNS) - 1),
        *rows,
        _row("**all**", outcomes),
        "",
        *breaks,
        "",
    ]
    return "\n".join(lines)


def _law(outcomes: Sequence[Outcome]) -> list[str]:
    right = [o for o in outcomes if o.state == "right"]
    off = [o for o in outcomes if o.state == "off"]
    not_right = [o for o in outcomes if o.state != "right"]
    return [
        f"* right pairs called wrong: {sum(o.is_blamed for o in right)} of {len(right)} (0 asked)",
        f"* pairs that are off called ok: {sum(o.is_passed for o in off)} of {len(off)} (1 % asked)",
        f"* advice wrong: {sum(o.is_misled for o in not_right)} of {len(not_right)} (1 % asked)",
    ]


def _row(kind: str, own: Sequence[Outcome]) -> str:
    def count(holds: Callable[[Outcome], bool]) -> str:
        return str(sum(map(holds, own)))

    states = ", ".join(count(lambda o, s=s: o.state == s) for s in ("right", "off", "between"))  # type: ignore[misc]
    verdicts = [count(lambda o, v=v: o.verdict == v) for v in ("ok", "suspect", "wrong", "refused")]  # type: ignore[misc]
    law = [count(lambda o: o.is_passed), count(lambda o: o.is_blamed)]
    spoilt = [o for o in own if o.state != "right"]
    advice = [str(sum(o.advice == a for o in spoilt)) for a in ("right", "wrong", "none")]
    seconds = f"{np.median([o.seconds for o in own]):.2f}"
    return f"| {kind} | {len(own)} | {' | '.join([states, *verdicts, *law, *advice, seconds])} |"


def _line(o: Outcome) -> str:
    what = "passed" if o.is_passed else "blamed" if o.is_blamed else "misled"
    size = f"{o.worst:.3g} tolerances, {o.times:.3g} times the right misfit"
    return f"* {what}: {o.name} ({o.source}; {o.variant or 'as it is'}; {size}): {o.said or 'nothing'}"


__all__ = ["table", "write_results"]
