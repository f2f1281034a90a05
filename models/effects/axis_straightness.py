"""A guideway that is not straight: the slide wanders and turns as it travels."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, centre_and_half, drives_joint, singly
from truepose.models.machine import Machine
from truepose.models.mechanism import Direction

LETTERS = "xyz"
LARGEST_MM, LARGEST_FRACTION, LARGEST_RAD = 0.1, 0.2, 1e-3


@effects.add("axis-straightness")
class AxisStraightness(Effect):
    """Error motions as polynomials of the travel t, -1 to 1 over the joint's range.

    Displacements across the axis start at t^2, as t trades with its direction. Where the slide carries an
    arm, displacement along the axis and turns from t come in: an arm shows them through its levers, the ball
    joint of a leg does not.
    """

    slug = "axis-straightness"
    title = "Guideway that is not straight"
    formula = "slide moves by x2 t^2 + x3 t^3, turns by rx1 t + rx2 t^2 (y, z alike); t = travel / half range"
    size = "turns of 1 to 50 urad; straightness of micrometres to tens of micrometres"
    look_alikes = ("screw-periodic", "axis-coupling", "actuator-scale", "wrong-constant")
    experiment = "move this slide alone; watch targets at two heights, or a straightedge and a level"
    source = "the six error motions of a linear axis, ISO 230-1"

    def places(self, machine: Machine) -> Sequence[Place]:
        slides = [a for a in machine.mechanism.actuators if a.unit == "mm" and drives_joint(machine, a)]
        return singly(a.reading for a in slides)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        _, half = centre_and_half(actuator_at(machine, place[0]))
        length = min(LARGEST_MM, LARGEST_FRACTION * half)
        out = []
        for power in range(2, round(settings.get("degree", 2.0)) + 1):
            out += [Coefficient(f"{axis}{power}", "mm", length) for axis in _directions(machine, place)]
            if _carries_arm(machine):
                out += [Coefficient(f"r{axis}{power - 1}", "rad", LARGEST_RAD) for axis in LETTERS]
        return tuple(out)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        centre, half = centre_and_half(actuator)
        t = (site.q[actuator.reading] - centre) / half
        directions = _directions(site.machine, site.place)
        motion = {f"{turn}{axis}": ca.SX(0) for turn in ("", "r") for axis in LETTERS}
        for name, c in site.c.items():
            kind, power = name[:-1], int(name[-1])
            if kind in directions:
                for axis, part in zip(LETTERS, directions[kind], strict=True):
                    motion[axis] += float(part) * c * t**power
            else:
                motion[kind] += c * t**power
        return {site.machine.motion(actuator.reading, axis): shift for axis, shift in motion.items()}

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return ({"degree": 2.0}, {"degree": 3.0})

    def explain(self, machine: Machine, place: Place) -> str:
        return f"The guideway of {place[0]} is bent: its slide leaves the line, and may turn, as it moves."


def _carries_arm(machine: Machine) -> bool:
    """Whether turns of a slide reach the tool as they are (no loop, no ball joint after it)."""
    return not machine.mechanism.passive


def _directions(machine: Machine, place: Place) -> dict[str, NDArray[np.float64]]:
    """Unit vectors of the displacements in the joint's frame: two across the axis; all for an arm."""
    eye = np.eye(3)
    if _carries_arm(machine):
        return dict(zip(LETTERS, eye, strict=True))
    axis = _axis(machine, place)
    out = {}
    for k in sorted(np.argsort(np.abs(axis), kind="stable")[:2]):
        across = eye[k] - axis[k] * axis
        out[LETTERS[k]] = across / np.linalg.norm(across)
    return out


def _axis(machine: Machine, place: Place) -> NDArray[np.float64]:
    """Nominal unit vector of a slide's axis, in its frame."""
    drives = actuator_at(machine, place[0]).drives
    axis = next(joint.axis for joint in machine.mechanism.joints if joint.name == drives)
    if not isinstance(axis, Direction):
        return np.array(axis, dtype=float)
    nominal = {p.name: p.nominal for p in machine.mechanism.parameters}
    known = [0.0 if name is None else nominal[name] for name in axis.components]
    third = axis.sign * float(np.sqrt(1 - np.dot(known, known)))
    return np.array([third if name is None else nominal[name] for name in axis.components])
