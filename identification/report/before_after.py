"""What a diagnosis did to the readings' misfit: before and after in the sensor's unit."""

from __future__ import annotations

import math
from collections.abc import Mapping

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.report.numbers import NONE, finer, known, significant, unit_symbol

KINDS = 3
"""Most kinds of reading that are told."""
HELD_OUT = "on held-out rows"


def before_after_words(diagnosis: Diagnosis) -> list[str]:
    """A line for each kind of reading: ``position: 0.438 mm before, 0.115 mm after on held-out rows``."""
    before, after = diagnosis.fits["before"], diagnosis.fits["after"]
    units = diagnosis.nominal.residual_units
    held = before.validation_rms is not None and after.validation_rms is not None
    first = before.validation_rms if held else before.rms
    last = after.validation_rms if held else after.rms
    where = HELD_OUT if held else "on the fitted rows"
    changed = bool(diagnosis.terms)
    said = [
        _one(kind, (first or {})[kind], value, units[kind], changed) for kind, value in (last or {}).items()
    ]
    proof = diagnosis.proof
    in_turn = "" if held or proof is None or not changed else _in_turn(proof.ratio)
    return [f"{text} {where}{in_turn}" for text in said[:KINDS]]


def rms_words(rms: Mapping[str, float], units: Mapping[str, str], where: str) -> list[str]:
    """The same of a fit alone: ``position: 0.115 mm rms on held-out rows``."""
    return [
        f"{_one(kind, value, value, units[kind], False)} {where}" for kind, value in list(rms.items())[:KINDS]
    ]


def _one(kind: str, before: float, after: float, unit: str, changed: bool) -> str:
    sizes = [abs(v) for v in ((before, after) if changed else (after,)) if math.isfinite(v)]
    factor, name = sensor_unit(max(sizes, default=0.0), unit)
    told = [
        f"{significant(value * factor)} {unit_symbol(name)}".rstrip() if known(value) else NONE
        for value in (before, after)
    ]
    return f"{kind}: {told[0]} before, {told[1]} after" if changed else f"{kind}: {told[1]} rms"


def sensor_unit(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which both of two figures are told: mm from 0.1 mm on."""
    return (1.0, unit) if unit == "mm" and size >= 0.1 else finer(size, unit) if size else (1.0, unit)


def _in_turn(ratio: float) -> str:
    return (
        f"; held out in turn, rms falls to {significant(ratio)} of it" if known(ratio) and ratio < 1.0 else ""
    )


__all__ = ["HELD_OUT", "before_after_words", "rms_words", "sensor_unit"]
