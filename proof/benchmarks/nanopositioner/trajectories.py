"""The paper's validation motions: a controller believes identified constants, the simulator has the true ones.

Each function gives the true change of the cavity along the motion, um; a perfect controller leaves none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .geometry import Constants, lengths
from .reflection import Held, ReflectionControl
from .study import machine
from .tables import Tabled

Array = NDArray[np.float64]
RADIUS = 0.100
"""mm; the paper does not say how large its circle is."""
STEPS = 721


@dataclass(frozen=True)
class Trace:
    """A motion as commanded and what the cavity did: abscissa (n,), readings q (n, 6), change (n,) um."""

    along: Array
    q: Array
    change: Array
    held: Held

    @property
    def swing(self) -> float:
        """Largest less smallest change, um."""
        return float(np.ptp(self.change))


def circle(p: Array, true: Tabled, radius: float = RADIUS) -> Trace:
    """Figures 10, 12 and 14: the mirror moved on a circle in what the controller believes to be its plane."""
    control = ReflectionControl(machine(), p)
    angle = np.linspace(0.0, 2 * np.pi, STEPS)
    shifts = radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(STEPS)])
    held = control.shift(control.facing(np.zeros(6)), shifts)
    return _trace(np.degrees(angle), held, true)


def rotary(true: Tabled) -> Trace:
    """Figure 9: the rotary positioner alone turns through its range, nothing else moves."""
    control = ReflectionControl(machine())
    angle = np.radians(np.linspace(0.0, 90.0, STEPS))
    q = np.zeros((STEPS, 6))
    q[:, 5] = angle
    found = control.solver.inverse(control.solver.forward(q)[0], np.zeros(6), restarts=0)
    return _trace(np.degrees(angle), Held(angle, found, STEPS, ()), true)


def turn(p: Array, true: Tabled, axis: int = 2, end: float = -90.0) -> Trace:
    """Figure 11: the mirror turned about an axis of the fibre through the reflection point, to ``end`` deg.

    Where a joint would have to leave its range it stays at its end, as a stage does.
    """
    control = ReflectionControl(machine(), p)
    angle = np.radians(np.linspace(0.0, end, STEPS))
    return _trace(np.degrees(angle), control.turn(control.facing(np.zeros(6)), axis, angle), true)


def misaligned(p: Array, true: Tabled, error: float, travel: float = 0.150) -> Trace:
    """Figure 15: a translation along Y_f by +- ``travel`` mm after adding ``error`` deg to the identified beta_et."""
    believed = p.copy()
    believed[[parameter.name for parameter in machine().parameters].index("mirror.rx")] += np.radians(error)
    control = ReflectionControl(machine(), believed)
    along = np.linspace(-travel, travel, STEPS)
    q0 = control.facing(np.zeros(6))
    pose, _ = control.solver.forward(q0)
    plane = control.mirror(pose)[0, :3, :3]
    shifts = along[:, None] * (plane.T @ control.fibre[:3, 1])
    return _trace(1e3 * along, control.shift(q0, shifts), true)


def _trace(along: Array, held: Held, true: Tabled) -> Trace:
    ranges = np.array([a.range for a in machine().mechanism.actuators], dtype=float)
    q = np.clip(held.q, ranges[:, 0], ranges[:, 1])
    length = 1e3 * lengths(Constants.tabled(true), q)
    return Trace(along, q, length - length[0], held)
