"""What was fitted of an effect on one line, however many coefficients it has."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from truepose.identification.diagnosis.result import Quantity
from truepose.identification.report.numbers import measure

FEW = 3
"""Most coefficients that are told one by one."""
_WAVE = re.compile(r"^[ab](?P<order>\d+)(?!\d)")


def coefficient_words(parameters: Mapping[str, Quantity]) -> str:
    """``c = 4.9e-07 +- 1.7e-08 rad/(N*m)``; of many their number and rms: ``60 orders, 0.21 mrad rms``; nothing of none."""
    if len(parameters) <= FEW:
        return ", ".join(f"{name} = {_uncertain(q)}" for name, q in parameters.items())
    units: dict[str, list[tuple[str, float]]] = {}
    for name, quantity in parameters.items():
        units.setdefault(quantity.unit, []).append((name, quantity.value))
    return "; ".join(_pooled(unit, named) for unit, named in units.items())


def _uncertain(quantity: Quantity) -> str:
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    return f"{quantity.value:.4g} +- {quantity.std:.2g}{unit}"


def _pooled(unit: str, named: Sequence[tuple[str, float]]) -> str:
    """Of a periodic function its orders and the rms of the wave, of others the rms of the coefficients."""
    orders = {match["order"] for name, _ in named if (match := _WAVE.match(name))}
    values = np.array([value for _, value in named])
    if len(orders) > 1 and all(_WAVE.match(name) for name, _ in named):
        return f"{len(orders)} orders, {measure(float(np.sqrt(np.sum(values**2) / 2.0)), unit)} rms"
    count = f"{len(named)} coefficients" if len(named) > 1 else named[0][0]
    return f"{count}, {measure(float(np.sqrt(np.mean(values**2))), unit)} rms"


__all__ = ["coefficient_words"]
