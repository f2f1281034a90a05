"""A guideway that is not straight: the slide wanders and turns as it travels."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import (
    actuator_at,
    centre_and_half,
    drives_joint,
    nominal_axis,
    rails,
    singly,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import looped
from truepose.models.machine.placed import COUNT, ranges

LETTERS = "xyz"
TOWARDS = "e"
LARGEST_MM, LARGEST_FRACTION, LARGEST_RAD = 0.1, 0.2, 1e-3
DECAY = 1.5
"""Of the shapes of a guideway the fine ones are smaller: the k-th is expected k^-1.5 times the first."""


@effects.add("axis-straightness")
class AxisStraightness(Effect):
    """A guideway that is not straight: the slide wanders and turns as it travels.

    Error motions as functions of the travel t, -1 to 1 over the joint's range.

    Setting ``degree`` n: powers of t up to n; those of displacements start at t^2, as t trades with the
    joint's direction. Setting ``waves`` n: 1 to n half waves from end to end of the range, w1 a bow, w2 an S.

    A slide that carries an arm wanders along x, y and z of its joint and turns about them. The ball joint on
    the slide of a leg takes up all turns, and the leg's length hides what happens beside it: one direction is
    left, e, across the rail towards the leg's upper end (e2, e3; ew1, ew2).
    """

    slug = "axis-straightness"
    setting_ranges = ranges({"degree": COUNT, "waves": COUNT})
    title = "Guideway that is not straight"
    counted = True
    sentence = "The guideway of {0} is bent: its slide leaves the line, and may turn, as it moves."
    # a rail bolted down at many points bends between any two of them: 6 half waves
    forms = (*({"degree": n} for n in (2.0, 3.0, 4.0)), *({"waves": n} for n in (2.0, 3.0, 4.0, 6.0)))
    formula = (
        "slide moves by x2 t^2 + x3 t^3 ... and turns by rx1 t + rx2 t^2 ... (y, z alike), t = travel / half "
        "range; or by xw1, xw2 ... times k half waves sin(k pi (t + 1) / 2) between the ends of the range; "
        "the rail of a leg by e2, e3 ... towards the leg's other end"
    )
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
        for rank, (move, turn) in enumerate(_shapes(settings), start=1):
            size = rank**-DECAY
            out += [Coefficient(f"{d}{move}", "mm", size * length) for d in _directions(machine, place)]
            if _carries_arm(machine, place):
                out += [Coefficient(f"r{axis}{turn}", "rad", size * LARGEST_RAD) for axis in LETTERS]
        return tuple(out)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        centre, half = centre_and_half(actuator)
        t = (site.q[actuator.reading] - centre) / half
        directions = _directions(site.machine, site.place)
        motion = {f"{turn}{axis}": ca.SX(0) for turn in ("", "r") for axis in LETTERS}
        for name, c in site.c.items():
            if name[0] == "r":
                motion[name[:2]] += c * _value(name[2:], t)
                continue
            for axis, part in zip(LETTERS, directions[name[0]], strict=True):
                motion[axis] += float(part) * c * _value(name[1:], t)
        return {site.machine.motion(actuator.reading, axis): shift for axis, shift in motion.items()}


def _shapes(settings: Settings) -> list[tuple[str, str]]:
    """Shape of the displacement and of the turn, coarse ones first."""
    if "waves" in settings:
        return [(f"w{k}", f"w{k}") for k in range(1, round(settings["waves"]) + 1)]
    degree = round(settings.get("degree", 2.0))
    return [(f"{power}", f"{power - 1}") for power in range(2, degree + 1)]


def _value(shape: str, t: ca.SX) -> ca.SX:
    """A shape at the travel t: a power, or half waves between the ends -1 and 1."""
    if shape[0] == "w":
        return ca.sin(int(shape[1:]) * pi / 2 * (t + 1))
    return t ** int(shape)


def _carries_arm(machine: Machine, place: Place) -> bool:
    """Whether turns of a slide reach the tool as they are: it stands in no loop, whose joints would take them up."""
    return actuator_at(machine, place[0]).drives not in looped(machine.mechanism)


def _directions(machine: Machine, place: Place) -> dict[str, Array]:
    """Unit vectors of displacements in the joint's frame: all for an arm, one for a leg, else two across."""
    eye = np.eye(3)
    if _carries_arm(machine, place):
        return dict(zip(LETTERS, eye, strict=True))
    actuator = actuator_at(machine, place[0])
    for rail in rails(machine):
        if rail.reading == actuator.reading and np.any(rail.across):
            return {TOWARDS: rail.across}
    joint = machine.mechanism.joint(actuator.drives)
    axis = nominal_axis(machine, joint.axis)
    out = {}
    for k in sorted(np.argsort(np.abs(axis), kind="stable")[:2]):
        across = eye[k] - axis[k] * axis
        out[LETTERS[k]] = across / np.linalg.norm(across)
    return out
