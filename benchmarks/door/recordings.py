"""Right pairs that are not drawn: recordings of others and their halves, bundled machines, practice cases."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pandas as pd
from mistakes.correct import bundled, practice, real
from mistakes.pairs import found

from .outcome import REAL

Writer = Callable[[Path], None]
HALVES: dict[str, slice] = {"odd": slice(0, None, 2), "even": slice(1, None, 2)}
"""Halves that any recording has; those in time are its first and second."""


def recordings() -> dict[str, tuple[str, Writer]]:
    """Return kind and writer of every pair by name; those that are not on this machine are left out."""
    out: dict[str, tuple[str, Writer]] = {}
    for name, writer in real().items():
        out[name] = REAL, writer
        for half in ("first", "second", *HALVES):
            out[f"{name} {half} half"] = f"{REAL}, halves", partial(_half, writer=writer, half=half)
    out |= {name: ("bundled machines", writer) for name, writer in bundled().items()}
    return out | {name: ("practice cases", writer) for name, writer in practice().items()}


def _half(folder: Path, writer: Writer, half: str) -> None:
    """Write one half of a pair's rows."""
    writer(folder)
    for path in found(folder)[1]:
        table = pd.read_csv(path, comment="#")
        middle = len(table) // 2
        own = HALVES.get(half, slice(0, middle) if half == "first" else slice(middle, None))
        table.iloc[own].to_csv(path, index=False)


__all__ = ["recordings"]
