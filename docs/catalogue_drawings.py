"""One small drawing for every effect of the catalogue, ``figures/effects/SLUG.svg``.

A curve of one variable is computed from the effect's own formula (``catalogue_curves.py``); what geometry shows better is
sketched (``catalogue_sketches.py``). A new effect gets its drawing in one of the two; ``catalogue_page.py`` writes them all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from catalogue_canvas import Canvas
from catalogue_curves import CURVES
from catalogue_sketches import SKETCHES

FOLDER: Final = Path(__file__).resolve().parent / "figures/effects"
DRAWINGS: Final[Mapping[str, Callable[[Canvas], None]]] = {**CURVES, **SKETCHES}


def drawing(slug: str, title: str) -> str:
    """The SVG of an effect."""
    paper = Canvas()
    DRAWINGS[slug](paper)
    return paper.svg(title)


def path_of(slug: str) -> Path:
    """Where the drawing of an effect stands."""
    return FOLDER / f"{slug}.svg"


__all__ = ["DRAWINGS", "FOLDER", "drawing", "path_of"]
