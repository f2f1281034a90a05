"""Ranges in which a calibration recording saw joints and drivers, as a machine file states them.

Outside of them effects without a name are held at the range's end and laws extrapolate, so that the model is less sure there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.models.file.driver import PAYLOAD
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import coupling_matrix
from truepose.models.machine.placed import PlacedEffect

Range = tuple[float, float]
_SLACK = 1e-6
"""Share of an end, and at least so many mm, rad or units of a driver, by which a value may pass it: units were converted, and
controllers compute in single precision."""


def read_ranges(section: Any, where: str) -> dict[str, Range]:
    """Return the lowest and highest value of each source of a ``seen:`` section. Raises InputError."""
    try:
        return {str(name): _range(item) for name, item in section.items()}
    except (AttributeError, TypeError, ValueError) as exc:
        raise InputError(
            f"{where}: found ranges that cannot be read ({exc}), expected the lowest and highest value of each source"
        ) from None


def _range(item: Any) -> Range:
    low, high = (float(value) for value in item)
    if not -np.inf < low <= high < np.inf:
        raise ValueError(f"{low} to {high} is no range")
    return low, high


def ranges_of_file(machine: Machine) -> Mapping[str, Range]:
    """Return the ranges that the machine's file states, none where it states none. Raises InputError."""
    if machine.file is None or machine.file.covariance is None:
        return {}
    return read_ranges(machine.file.covariance.get("seen", {}), f"{machine.file.path}: covariance.seen")


def drivers_of(machine: Machine, effect: PlacedEffect) -> tuple[str, ...]:
    """Return the drivers that an effect depends on: those that it reads, and what weighs on it."""
    return (*((PAYLOAD, *machine.force_columns) if effect.needs_load else ()), *effect.drivers)


def values_of(model: SymbolicModel, q: Array, z: Array) -> Array:
    """Return the joints' own motions and then the drivers (n, nq + nz) of readings (n, nq) and drivers (n, nz)."""
    uncoupling = coupling_matrix(model.machine.mechanism)
    return np.hstack([q if uncoupling is None else q @ uncoupling.T, z])


@dataclass(frozen=True)
class SeenRanges:
    """Ranges ``low`` to ``high`` (k,) of the sources at ``places`` (k,) among a model's joints and then its drivers."""

    names: tuple[str, ...]
    places: tuple[int, ...]
    low: Array
    high: Array

    @classmethod
    def of(cls, model: SymbolicModel, *, of_tool: bool = True) -> SeenRanges:
        """Return the known ranges of all joints, and of drivers that effects read; ``of_tool``: effects that move the tool.

        A model without such effects has none: it neither holds nor extrapolates anything. Raises InputError.
        """
        effects = [effect for effect in model.effects if effect.moves_tool or not of_tool]
        read = {name for e in effects for name in (*model.readings, *drivers_of(model.machine, e))}
        known, names = ranges_of_file(model.machine), (*model.readings, *model.drivers)
        places = [k for k, name in enumerate(names) if name in read and name in known]
        ends = np.array([known[names[k]] for k in places]).reshape(-1, 2)
        return cls(tuple(names[k] for k in places), tuple(places), *ends.T)

    @property
    def ends(self) -> tuple[Array, Array]:
        """Ends (k,) with room for rounding."""
        slack = _SLACK * np.maximum(1.0, np.maximum(np.abs(self.low), np.abs(self.high)))
        return self.low - slack, self.high + slack

    def outside(self, values: Array) -> Mask:
        """Return whether values (n, k) of the sources lie outside, (n, k)."""
        low, high = self.ends
        return np.asarray((values < low) | (values > high))
