"""Whether the probabilities of an examination mean what they say: the figure of docs/results/examination.md.

    python -m challenge.studies.reliability DIR [FIGURE]

DIR is the folder of an examination (``python -m challenge -o DIR``); FIGURE by default docs/figures/challenge_reliability.svg.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import benchmarks  # noqa: F401 - finds `figures`
from figures import Series, write_chart

FIGURE = Path(__file__).resolve().parents[3] / "docs" / "figures" / "challenge_reliability.svg"


def draw(table: Path, figure: Path) -> None:
    """How often names were right against the probability that was said, with 95 % Wilson intervals."""
    bins = json.loads(table.read_text(encoding="utf-8"))["reliability"]["names"]
    said, ends = [b["said"] for b in bins], [b["interval"] for b in bins]
    middle, half = [(low + high) / 2 for low, high in ends], [(high - low) / 2 for low, high in ends]
    series = [
        Series("as said", [0.0, 1.0], [0.0, 1.0]),
        Series("share that was right", said, [b["hits"] / b["n"] for b in bins], "points"),
        Series("95 % Wilson interval", said, middle, "none", half),
    ]
    title = "Probabilities of names, and how often they were right"
    write_chart(figure, title, "probability said", "share that was right", series)


def main(folder: str, figure: str = str(FIGURE)) -> None:
    """Draw it."""
    draw(Path(folder) / "table.json", Path(figure))


if __name__ == "__main__":
    main(*sys.argv[1:])
