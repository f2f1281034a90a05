"""How numbers, effects, places, rows and coefficients are written in print.

Numbers are rounded to what is known, in um and urad where that is the size of things.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from truepose.identification.diagnosis.result import Alternative, Finding, Quantity
from truepose.models.effects.base import Effect, effects
from truepose.wording import shortened

NONE = "-"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SYMBOLS: Mapping[str, str] = {
    "um": "µm", "urad": "µrad", "nm": "nm", "nrad": "nrad", "1": "", "degC": "°C", "deg": "°",
}  # fmt: skip
_FINER: Mapping[str, tuple[tuple[float, float, str], ...]] = {
    "mm": ((1e-4, 1e6, "nm"), (1.0, 1e3, "um")),
    "rad": ((1e-7, 1e9, "nrad"), (1e-2, 1e6, "urad"), (1.0, 1e3, "mrad")),
}


def known(value: float | None) -> bool:
    """Whether there is a finite number to show."""
    return value is not None and math.isfinite(value)


def significant(value: float | None, digits: int = 3) -> str:
    """A number to some significant digits, large and tiny ones as powers of ten; '-' for none."""
    if value is None or math.isnan(value):
        return NONE
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if value == 0.0:
        return "0"
    if not 1e-3 <= abs(value) < 1e6:
        return _power(f"{value:.{digits - 1}e}")
    whole = math.floor(math.log10(abs(value))) + 1
    return f"{value:.{max(digits - whole, 0)}f}"


def _power(text: str) -> str:
    mantissa, exponent = text.split("e")
    return f"{mantissa}×10{str(int(exponent)).translate(_SUPERSCRIPT)}"


def unit_symbol(unit: str) -> str:
    """A unit as it is written in print."""
    return _SYMBOLS.get(unit, unit.replace("*", "·"))


def finer(value: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which a length or an angle of this size reads well."""
    for limit, factor, name in _FINER.get(unit, ()):
        if abs(value) < limit:
            return factor, name
    return 1.0, unit


def measure(value: float | None, unit: str, digits: int = 3) -> str:
    """A value with its unit, lengths below a millimetre in um, small angles in urad."""
    if value is None or not math.isfinite(value):
        return NONE
    factor, name = finer(value, unit) if value else (1.0, unit)
    return f"{significant(value * factor, digits)} {unit_symbol(name)}".rstrip()


def uncertain(value: float, std: float, unit: str) -> str:
    """``value ± std unit``, rounded to two digits of the uncertainty."""
    if not math.isfinite(value):
        return NONE
    if not math.isfinite(std) or std <= 0.0 or 0.0 < 1e12 * abs(value) < std:
        return f"{measure(value, unit, 4)} (uncertainty unknown)"
    factor, name = finer(max(abs(value), std), unit)
    v, s, tail = value * factor, std * factor, unit_symbol(name)
    exponent = math.floor(math.log10(max(abs(v), s)))
    if -4 <= exponent < 6:
        places = max(1 - math.floor(math.log10(s)), 0)
        return f"{v:.{places}f} ± {s:.{places}f} {tail}".rstrip()
    v, s = v / 10.0**exponent, s / 10.0**exponent
    places = max(1 - math.floor(math.log10(s)), 0)
    return f"({v:.{places}f} ± {s:.{places}f})×10{str(exponent).translate(_SUPERSCRIPT)} {tail}".rstrip()


def percent(probability: float | None) -> str:
    """A probability; never 0 % nor 100 %."""
    if probability is None or math.isnan(probability):
        return NONE
    if probability > 0.999:
        return "over 99.9 %"
    if probability < 0.001:
        return "below 0.1 %"
    return f"{100 * probability:.1f} %" if not 0.095 < probability < 0.9 else f"{100 * probability:.0f} %"


def p_value(p: float | None) -> str:
    """A p-value."""
    if p is None or math.isnan(p):
        return NONE
    return "below 10⁻³⁰⁰" if p < 1e-300 else significant(p, 2)


def times(log_factor: float) -> str:
    """exp(log_factor) as 'so many times'."""
    if not math.isfinite(log_factor):
        return NONE
    if log_factor < math.log(1e5):
        return f"{significant(math.exp(log_factor), 2)} times"
    return f"10{str(round(log_factor / math.log(10))).translate(_SUPERSCRIPT)} times"


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
