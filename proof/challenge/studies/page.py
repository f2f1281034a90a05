"""The published table of an examination: into its marked place in challenge/results/examination.md.

    python -m challenge.studies.page DIR [PAGE]

DIR is the folder of an examination (``python -m challenge -o DIR``).
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "results" / "examination.md"
BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"


def filled(page: str, table: str) -> str:
    """The page with the table between its marks, headings one level lower. Raises ValueError without the marks."""
    head, begin, rest = page.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"found no marks, expected {BEGIN} and {END}")
    lower = re.sub(r"^#", "##", table.strip(), flags=re.MULTILINE)
    return f"{head}{BEGIN}\n\n{lower}\n\n{END}{tail}"


def main(folder: str, page: str = str(PAGE)) -> None:
    """Fill it in."""
    at, table = Path(page), (Path(folder) / "table.md").read_text(encoding="utf-8")
    at.write_text(filled(at.read_text(encoding="utf-8"), table), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
