"""A rotary axis that tilts as it turns, once per turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot, pi

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import (
    ARCSEC,
    actuator_at,
    drives_joint,
    nominal_axis,
    sine_coefficients,
    singly,
)
from truepose.models.machine import Machine


@effects.add("axis-wobble")
class AxisWobble(Effect):
    """In the frame that stands still the axis tilts by a (u cos q - v sin q) + b (u sin q + v cos q).

    u, v stand across the axis. A tilt of once per turn is one that turns with the joint and one that turns against
    it. The first is fixed in the body that turns and so part of its geometry; only the second can be seen.
    """

    slug = "axis-wobble"
    title = "Wobbling rotary axis"
    formula = "tilt of the axis = (a + i b) exp(-i q) across it, in the frame that stands still (i: 90 deg about it)"
    size = "20 to 50 arcsec (recalled)"
    look_alikes = ("encoder-eccentricity", "transmission-error", "axis-straightness")
    experiment = "turn this joint alone through a whole turn; watch a level, or a mirror, that it carries"
    source = (
        "tilt error motion of an axis of rotation, ISO 230-7 (the standard's subject; its clauses recalled)"
    )

    def places(self, machine: Machine) -> Sequence[Place]:
        turning = [a for a in machine.mechanism.actuators if a.unit == "rad" and drives_joint(machine, a)]
        return singly(a.reading for a in turning)

    def screened(self, machine: Machine, place: Place) -> bool:
        # what turns against the joint goes twice around in its own frame: a quarter of a period takes pi / 4
        limits = actuator_at(machine, place[0]).range
        return limits is None or limits[1] - limits[0] >= pi / 4

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return sine_coefficients("rad", 1e-3)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        u, v = _across(site.machine, actuator.drives)
        # the motion's frame has turned by q already: there the tilt turns against it twice as fast
        twice = 2 * site.displacement(actuator.reading)
        along_u = site.c["a"] * ca.cos(twice) + site.c["b"] * ca.sin(twice)
        along_v = site.c["b"] * ca.cos(twice) - site.c["a"] * ca.sin(twice)
        return {
            site.machine.motion(actuator.reading, f"r{axis}"): float(u[k]) * along_u + float(v[k]) * along_v
            for k, axis in enumerate("xyz")
        }

    def explain(self, machine: Machine, place: Place) -> str:
        return f"The axis of joint {place[0]} wobbles: it tilts once per turn."

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        return f"The axis tilts by {hypot(values['a'], values['b']) * ARCSEC:.0f} arcsec."


def _across(machine: Machine, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit vectors (3,) across a joint's axis that make a right-handed frame with it."""
    joint = next(joint for joint in machine.mechanism.joints if joint.name == name)
    axis = nominal_axis(machine, joint.axis)
    u = np.eye(3)[np.argmin(np.abs(axis))]
    u = u - (u @ axis) * axis
    u /= np.linalg.norm(u)
    return u, np.cross(axis, u)
