"""Plain names of what was fitted: ``friction at q3, width 0.03: h`` for ``friction-hysteresis@q3,width=0.03:h``."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.identification.report.level_words import title
from truepose.models.machine.placed import Coefficient, PlacedEffect


def plain_names(terms: Sequence[PlacedEffect]) -> dict[str, str]:
    """The plain name of every coefficient of these terms, by its label."""
    return {label: f"{plain_term(term)}: {c.name}" for term in terms for label, c in _pairs(term)}


def plain_term(term: PlacedEffect) -> str:
    """A term in words: what, where, and its settings."""
    settings = ", ".join(f"{name} {value:g}" for name, value in term.settings_map.items())
    where = f" at {', '.join(term.place)}" if term.place else ""
    return f"{title(term.effect.slug)}{where}{f', {settings}' if settings else ''}"


def _pairs(term: PlacedEffect) -> list[tuple[str, Coefficient]]:
    return list(zip(term.parameter_names, term.coefficients, strict=True))
