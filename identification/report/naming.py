"""How effects, places, rows and coefficients are called in print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from truepose.identification.diagnosis.result import Alternative, Finding, Quantity
from truepose.identification.report.numbers import measure, percent, significant
from truepose.models.effects.base import Effect, effects
from truepose.wording import shortened

FEW = 3
"""Most coefficients that are told one by one."""
ROWS, FILES = 10, 2
"""Most rows of a file, and most files, that are named."""


def effect_class(slug: str) -> type[Effect] | None:
    """The catalogue's entry, None for a slug it does not have."""
    return effects.get(slug, "report") if slug in set(effects) else None


def title(slug: str) -> str:
    """The catalogue's title of an effect in small letters."""
    entry = effect_class(slug)
    said = entry.title if entry is not None else ""
    return (said if said[1:2].isupper() else said[:1].lower() + said[1:]) or slug


def effect_title(slug: str) -> str:
    """An effect in words with its slug: ``platform that bends (platform-deformation)``."""
    said = title(slug)
    return said if said == slug else f"{said} ({slug})"


def with_article(slug: str) -> str:
    """The title as a sentence has it: ``a compliant joint``, ``an eccentric encoder disc``, ``backlash``."""
    said, entry = title(slug), effect_class(slug)
    if entry is None or not entry.counted:
        return said
    return f"{'an' if said[0] in 'aeiou' else 'a'} {said}"


def place_words(place: Sequence[str]) -> str:
    """``at leg1``; nothing for an effect without a place."""
    return f"at {', '.join(place)}" if place else ""


def named(item: Finding | Alternative) -> str:
    """An effect and its place."""
    return f"{effect_title(item.effect)} {place_words(item.place)}".strip()


def law_words(slug: str) -> str:
    """An effect as a sentence has it, with its slug: ``a compliant joint (joint-compliance)``."""
    name = with_article(slug)
    return name if name == slug else f"{name} ({slug})"


def told(item: Finding | Alternative) -> str:
    """An effect and its place as a sentence has them: ``a platform that bends (platform-deformation) at platform``."""
    return f"{law_words(item.effect)} {place_words(item.place)}".strip()


def several(count: int, one: str) -> str:
    """``1 finding``, ``2 findings``."""
    return f"{count} {one if count == 1 else one + 's'}"


def spanned(values: Sequence[float]) -> str:
    """Probabilities from the lowest to the highest; one where they read alike."""
    low, high = percent(min(values)), percent(max(values))
    return low if low == high else f"{low} to {high}"


def coefficient_words(parameters: Mapping[str, Quantity]) -> str:
    """``c = 4.9e-07 +- 1.7e-08 rad/(N*m)``; of many their number and rms: ``60 coefficients, 0.21 mrad rms``."""
    if len(parameters) <= FEW:
        return ", ".join(
            f"{name} = {q.value:.4g} +- {q.std:.2g}{'' if q.unit == '1' else f' {q.unit}'}"
            for name, q in parameters.items()
        )
    units: dict[str, list[float]] = {}
    for quantity in parameters.values():
        units.setdefault(quantity.unit, []).append(quantity.value)
    return "; ".join(
        f"{several(len(own), 'coefficient')}, {measure(float(np.sqrt(np.mean(np.square(own)))), unit)} rms"
        for unit, own in units.items()
    )


def far_row_words(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """``rows 12, 40 of r.csv do not fit: residuals of up to 30 sigma; look there first``, by file.

    ``rows`` are those of ``fit.json``, farthest first.
    """
    files: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        files.setdefault(str(row["file"]), []).append(row)
    said = []
    for name, own in list(files.items())[:FILES]:
        numbers = shortened([str(row) for row in sorted(row["row"] for row in own)], ROWS)
        largest = significant(max(float(row["sigma"]) for row in own), 2)
        who = f"row {numbers}" if len(own) == 1 else f"rows {numbers}"
        does, up_to = ("does", "") if len(own) == 1 else ("do", "up to ")
        said.append(
            f"{who} of {Path(name).name} {does} not fit: residuals of {up_to}{largest} sigma;"
            " look there before the model is suspected"
        )
    return said


def excluded_words(rows: Sequence[int], most: int = 12) -> str:
    """Return ``1 row excluded as an outlier: row 7``, with at most so many numbers."""
    numbers = shortened([str(row) for row in rows], most)
    if len(rows) == 1:
        return f"1 row excluded as an outlier: row {numbers}"
    return f"{len(rows)} rows excluded as outliers: rows {numbers}"
