"""What the engine assumes of an effect before it has seen a reading: how large it may be, and which settings are tried."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import Effect, Observed, Place, Settings

LIMITED: Final = 40
"""Places of a machine that are asked."""
LISTED: Final = 6
"""Values of a setting that are listed; of more the ends are."""


def placed(
    effect: Effect, machines: Sequence[Machine], logged: Observed
) -> Iterator[tuple[Machine, Place, Settings]]:
    """Places and settings at which an effect would be tried."""
    for machine in machines:
        for place in list(effect.places(machine))[:LIMITED]:
            yield from ((machine, place, one) for one in effect.settings(machine, place, logged))


def sizes(effect: Effect, machines: Sequence[Machine], logged: Observed) -> str:
    """Largest sizes that are expected of its coefficients, by unit."""
    found: dict[str, set[float]] = {}
    for machine, place, settings in placed(effect, machines, logged):
        for one in effect.coefficients(machine, place, settings):
            found.setdefault(one.unit, set()).add(one.scale)
    return " or ".join(f"{_ends(own)}{'' if unit == '1' else f' {unit}'}" for unit, own in found.items())


def tried(effect: Effect, machines: Sequence[Machine], logged: Observed) -> str:
    """Settings that are tried, by name."""
    found: dict[str, set[float]] = {}
    for _, _, settings in placed(effect, machines, logged):
        for name, value in settings.items():
            if "." not in name:  # the ends of a curve are those of its recording
                found.setdefault(name, set()).add(float(value))
    return "; ".join(f"{name} {_listed(own)}".rstrip() for name, own in sorted(found.items()))


def _ends(values: set[float]) -> str:
    low, high = min(values), max(values)
    return f"{high:.3g}" if f"{low:.3g}" == f"{high:.3g}" else f"{low:.3g} to {high:.3g}"


def _listed(values: set[float]) -> str:
    """Nothing where a setting is there or not."""
    if values == {1.0}:
        return ""
    told = list(dict.fromkeys(f"{value:.5g}" for value in sorted(values)))
    return ", ".join(told) if len(told) <= LISTED else f"{told[0]} to {told[-1]} ({len(told)} values)"
