"""Numbers as people read them: rounded to what is known, in um and urad where that is the size of things."""

from __future__ import annotations

import math
from collections.abc import Mapping

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
