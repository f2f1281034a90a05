"""From the folder of an examination to its table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from challenge.examine import RUN, UNDRAWN
from challenge.score import read_score
from challenge.score_table import Table, markdown, table
from challenge.table_document import document
from truepose.files import atomic_directory, atomic_write_text
from truepose.identification.report.json_text import json_text


def tabled(folder: Path, cases: Sequence[str], drawn: Path | None = None) -> Table:
    """Score the cases that were sat; writes table.md and table.json. Keys are in ``drawn``, by default in the folder."""
    source = drawn or folder
    scores = [
        read_score(source, folder, case) for case in cases if (folder / "results" / case / RUN).is_file()
    ]
    missing = [source / "cases" / f"{case}.{UNDRAWN}" for case in cases]
    undrawn = [
        f"{p.name.split('.')[0]}: {p.read_text(encoding='utf-8').strip()}" for p in missing if p.is_file()
    ]
    found = table(scores, undrawn)
    with atomic_directory(folder) as partial:
        atomic_write_text(partial / "table.md", markdown(found))
        atomic_write_text(partial / "table.json", json_text(document(found)))
    return found


__all__ = ["tabled"]
