"""Thermometers of other places, which stand in for a part's own: with an offset that nobody knows, a gain and a lag."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from truepose.arrays import Array
from truepose.models.effects.base import Settings
from truepose.models.file.driver import AIR, TEMPERATURE, TIME, Driver
from truepose.models.machine.machine import Machine
from truepose.models.units import compatible

FROM = "from."
"""Setting ``from.COLUMN``: the thermometer that is read, and the temperature (degC) from which it counts."""
ALIKE = 0.99
"""Correlation from which two thermometers say the same: all but a fiftieth of their variance. Chosen."""


def others(machine: Machine, own: Sequence[str], seen: Mapping[str, Array]) -> list[str]:
    """Thermometers among the drivers ``seen`` (n,) that vary and say something else than ``own`` columns and each other."""
    known = [seen[name] for name in own if name in seen]
    out = list[str]()
    for name in sorted(seen, key=lambda name: name == AIR):  # the air last: it may stand for any of them
        varies = _is_thermometer(machine, name) and np.ptp(seen[name]) > 0.0
        if varies and not any(_alike(seen[name], other) for other in known):
            known.append(seen[name])
            out.append(name)
    return out


def own_columns(place: Sequence[str], seen: Mapping[str, Array]) -> list[str]:
    """The column of each part's temperature, that of the air where it has none."""
    return [Driver(TEMPERATURE, part).served_by(seen) for part in place]


def from_settings(name: str, seen: Mapping[str, Array]) -> Settings:
    """The setting of a thermometer elsewhere: it counts from its mean, because its absolute value says nothing of the part."""
    return {f"{FROM}{name}": float(f"{np.mean(seen[name]):.5g}")}


def borrowed(settings: Settings) -> tuple[str, float] | None:
    """The thermometer elsewhere that settings name, and where it counts from; None where they name none."""
    return next(((k.removeprefix(FROM), v) for k, v in settings.items() if k.startswith(FROM)), None)


def span(seen: Mapping[str, Array]) -> float:
    """Seconds from the first row to the last; 0 without a clock."""
    return float(np.ptp(seen[TIME])) if TIME in seen else 0.0


def any_thermometer(machine: Machine, names: Sequence[str]) -> bool:
    """Whether a thermometer is among the columns, wherever it is."""
    return any(_is_thermometer(machine, name) for name in names)


def _is_thermometer(machine: Machine, name: str) -> bool:
    return machine.drives(name) == TEMPERATURE and compatible(machine.driver_unit(name), "degC")


def _alike(a: Array, b: Array) -> bool:
    """Whether they are a line of each other."""
    if np.ptp(b) == 0.0:
        return False
    return bool(abs(np.corrcoef(a, b)[0, 1]) > ALIKE)


__all__ = ["FROM", "any_thermometer", "borrowed", "from_settings", "others", "own_columns", "span"]
