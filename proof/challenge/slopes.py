"""How exact readings follow the specimen's constants and joints: finite differences of the simulator itself.

Nothing of the product's models is used: what a size of an imperfection means does not depend on what is examined.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from challenge.measures import difference
from challenge.simulator.base import Campaign, SimulatedMachine, Specimen
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Parameter

Array = NDArray[np.float64]
STEP = 0.01
"""Of a tolerance: readings are exact to 1e-11 mm, and bend by less than 1e-4 of the step's change."""
STEPS = {"mm": 1e-2, "rad": 1e-5}
"""Where the drawing states no tolerance, and for joints."""
FRAME = "frame"
"""Part of a parameter of the frames, base and tool."""


@dataclass(frozen=True)
class Constant:
    """A constant that the drawing leaves open. step: the size that slopes are told by, its tolerance where there is one;
    nudge: what differences are taken with (both mm, rad); weight: what a step costs (0 without a tolerance); off: true less
    nominal value, in steps; frame: whether it belongs to base or tool."""

    name: str
    step: float
    nudge: float
    weight: float
    off: float
    frame: bool


def constants(drawing: Machine, specimen: Specimen) -> tuple[Constant, ...]:
    """Those of the drawing's constants with a tolerance that the specimen has, too."""
    known = specimen.parameters
    return tuple(_constant(p, known[p.name]) for p in drawing.parameters if p.free and p.name in known)


def _constant(p: Parameter, true: float) -> Constant:
    bound = bool(np.isfinite(p.tolerance))
    nudge = STEP * p.tolerance if bound else STEPS.get(p.unit, STEPS["mm"])
    return Constant(p.name, p.scale, nudge, float(bound), (true - p.nominal) / p.scale, p.part == FRAME)


def by_constants(
    machine: SimulatedMachine, specimen: Specimen, campaign: Campaign, free: Sequence[Constant]
) -> Array:
    """(n, k, f) derivative of the readings by each constant, in its step."""

    def read(name: str, nudge: float) -> Array:
        moved = {**specimen.parameters, name: specimen.parameters[name] + nudge}
        return machine.measure(replace(specimen, parameters=moved), (), campaign)

    columns = [_slope(machine, partial(read, c.name), c.nudge) * c.step for c in free]
    return np.stack(columns, axis=-1) if free else np.zeros((len(campaign), len(machine.columns), 0))


def by_joints(machine: SimulatedMachine, specimen: Specimen, campaign: Campaign) -> Array:
    """(n, k, nq) derivative of each row's reading by its own joints, mm and rad (see ``since_first``)."""
    first, steps = since_first(campaign), [STEPS["rad" if turns else "mm"] for turns in machine.revolute]

    def read(joint: int, nudge: float) -> Array:
        q = first.q.copy()
        q[1:, joint] += nudge
        return machine.measure(specimen, (), replace(first, q=q))[1:]

    columns = [_slope(machine, partial(read, joint), step) for joint, step in enumerate(steps)]
    return np.stack(columns, axis=-1)


def since_first(campaign: Campaign) -> Campaign:
    """The campaign after one more reading of its first row, from which all changes count: n + 1 rows."""
    at = np.concatenate([[0], np.arange(len(campaign))])
    rows: dict[str, Any] = {
        f.name: value[at]
        for f in fields(campaign)
        if isinstance(value := getattr(campaign, f.name), np.ndarray)
    }
    rows["temperatures"] = {place: values[at] for place, values in campaign.temperatures.items()}
    compares = bool(np.any(campaign.origin != np.arange(len(campaign))))
    rows["origin"] = np.zeros(len(at), dtype=np.int64) if compares else np.arange(len(at), dtype=np.int64)
    return replace(campaign, **rows)


def _slope(machine: SimulatedMachine, read: Callable[[float], Array], nudge: float) -> Array:
    """(n, k) central difference; rotation vectors are told apart as rotations."""
    out: Array = difference(read(nudge), read(-nudge), machine.columns) / (2 * nudge)
    return out


__all__ = ["Constant", "by_constants", "by_joints", "constants", "since_first"]
