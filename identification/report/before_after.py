"""What a diagnosis did to the readings' misfit: before and after in the sensor's unit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.summary import FitSummary
from truepose.identification.report.numbers import NONE, finer, known, significant, unit_symbol

KINDS = 3
"""Most kinds of reading that are told."""
HELD_OUT = "on held-out rows"


def before_after_words(diagnosis: Diagnosis) -> list[str]:
    """Return a line for each kind of reading: ``position: 0.438 mm with the ordinary fit, 0.51 mm held to the drawing, 0.115 mm
    after on held-out rows``."""
    fits = [diagnosis.fits[name] for name in ("free", "before", "after")]
    units = diagnosis.nominal.residual_units
    held = all(fit.validation_rms is not None for fit in fits)
    rms = [(fit.validation_rms if held else fit.rms) or {} for fit in fits]
    where = HELD_OUT if held else "on the fitted rows"
    changed = bool(diagnosis.terms)
    said = [
        _one(kind, [one[kind] for one in (rms if changed else rms[-1:])], units[kind]) for kind in rms[-1]
    ]
    proof = diagnosis.proof
    in_turn = "" if held or proof is None or not changed else _in_turn(proof.ratio)
    return [f"{text} {where}{in_turn}" for text in said[:KINDS]]


def better_baseline(diagnosis: Diagnosis) -> FitSummary:
    """Return the ordinary fit where it misses rows that were not fitted by less than the fit held to the drawing."""
    free, before = diagnosis.fits["free"], diagnosis.fits["before"]
    own, other = free.validation_rms, before.validation_rms
    kind = next(iter(other or {}), None)
    return free if own and other and kind is not None and own[kind] < other[kind] else before


def rms_words(rms: Mapping[str, float], units: Mapping[str, str], where: str) -> list[str]:
    """The same of a fit alone: ``position: 0.115 mm rms on held-out rows``."""
    return [f"{_one(kind, [value], units[kind])} {where}" for kind, value in list(rms.items())[:KINDS]]


def _one(kind: str, values: Sequence[float], unit: str) -> str:
    """Return the rms of one fit, or of the ordinary fit, the one held to the drawing, and the last."""
    factor, name = sensor_unit(max((abs(v) for v in values if math.isfinite(v)), default=0.0), unit)
    shown = [
        f"{significant(value * factor)} {unit_symbol(name)}".rstrip() if known(value) else NONE
        for value in values
    ]
    if len(shown) == 1:
        return f"{kind}: {shown[0]} rms"
    return f"{kind}: {shown[0]} with the ordinary fit, {shown[1]} held to the drawing, {shown[2]} after"


def sensor_unit(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which both of two figures are told: mm from 0.1 mm on."""
    return (1.0, unit) if unit == "mm" and size >= 0.1 else finer(size, unit) if size else (1.0, unit)


def _in_turn(ratio: float) -> str:
    falls = f"; held out in turn, rms falls to {significant(ratio)} of plain calibration's"
    return falls if known(ratio) and ratio < 1.0 else ""


__all__ = ["HELD_OUT", "before_after_words", "better_baseline", "rms_words", "sensor_unit"]
