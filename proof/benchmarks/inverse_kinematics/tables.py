"""Rows as Markdown: time a pose, how many times longer than the generated C, share solved."""

from __future__ import annotations

from collections.abc import Sequence

from .outcome import Kind, Row


def timings(rows: Sequence[Row]) -> str:
    """A table of times; ratios are to the generated C of the same flags, else to its first row."""
    if not rows:
        return "Nothing here to time."
    kinds = [kind for kind in (Kind.OURS, Kind.BATCH) if any(row.kind is kind for row in rows)]
    lines = [
        [
            f"{row.solver}, {row.flags}" if row.flags else row.solver,
            duration(row.seconds),
            *(_ratio(row, [other for other in rows if other.kind is kind]) for kind in kinds),
            share(row.solved),
            row.note,
        ]
        for row in rows
    ]
    return markdown(
        ("solver", "time a pose", *(f"time / {kind.value}" for kind in kinds), "solved", ""), lines
    )


def counts(rows: Sequence[tuple[str, float]]) -> str:
    """A table of instructions a solve; ratios are to the first row."""
    lines = [[solver, f"{count:.0f}", f"{count / rows[0][1]:.2f}"] for solver, count in rows]
    return markdown(("solver", "instructions a solve", "instructions / ours"), lines)


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = (head, ["---"] * len(head), *rows)
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def duration(seconds: float) -> str:
    """Three figures with the unit that suits."""
    for scale, unit in ((1e9, "ns"), (1e6, "us")):
        if seconds * scale < 1000:
            return f"{seconds * scale:.3g} {unit}"
    return f"{seconds * 1e3:.3g} ms"


def share(value: float | None) -> str:
    """Per cent; 100 % means all."""
    if value is None:
        return ""
    return "100 %" if value == 1.0 else f"{min(100 * value, 99.999):.3f} %"


def _ratio(row: Row, ours: Sequence[Row]) -> str:
    same = [other for other in ours if other.flags == row.flags]
    return f"{row.seconds / (same or ours)[0].seconds:.2f}"
