"""Errors that come back with every turn of a joint: encoder discs off their axis, axes that tilt."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot, pi

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import (
    ARCSEC,
    actuator_at,
    drives_joint,
    nominal_axis,
    own_offset,
    sine_coefficients,
    sine_pair,
    singly,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.machine.placed import COUNT, ORDER, ranges
from truepose.models.machine.states import across


@effects.add("encoder-eccentricity")
class EncoderEccentricity(Effect):
    """An encoder disc that sits off its axis.

    Once per turn with one read head, twice per turn with an oval disc or two opposite heads.

    The disc is that of the joint's reading, or that of an encoder on its load side: the place is then its column,
    ``angle.q1``, and the error is that of the column.
    """

    slug = "encoder-eccentricity"
    setting_ranges = ranges({"order": ORDER})
    driven_by = "position-periodic"
    title = "Eccentric encoder disc"
    counted = True
    forms = ({"order": 1.0}, {"order": 2.0})
    formula = "dq = a sin(k q) + b cos(k q), k = 1 (disc off its axis) or 2 (oval disc, two read heads)"
    size = "amplitude e / R: 10 um at R = 50 mm gives 2e-4 rad (41 arcsec)"
    look_alikes = ("transmission-error", "axis-wobble", "actuator-scale")
    experiment = "read a second head opposite the first, or turn the disc by half a turn and repeat"
    source = "geometry of a disc of radius R mounted off its axis by e"
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        turning = [a.reading for a in machine.mechanism.actuators if a.unit == "rad"]
        return singly([*turning, *(c for c, joint in _on_load_side(machine).items() if joint in turning)])

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return sine_coefficients("rad", 3e-3)

    def shifts(self, site: Site) -> Shifts:
        (place,) = site.place
        joint = _on_load_side(site.machine).get(place)
        actuator = actuator_at(site.machine, joint or place)
        angle = site.moved(joint) if joint else site.read(actuator.reading)
        phase = site.settings.get("order", 1.0) * angle
        return {f"{place}.reading" if joint else actuator.displacement: sine_pair(site, phase)}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        whose = (
            f"on the load side, {place[0]}," if place[0] in _on_load_side(machine) else f"of joint {place[0]}"
        )
        return f"The encoder disc {whose} is off its axis: it errs by a sine of the angle."


def _on_load_side(machine: Machine) -> dict[str, str]:
    """The joint of each column that an encoder on a load side has."""
    return {column: joint for sensor in machine.sensors for column, joint in sensor.joints.items()}


LARGEST = 1e-3
DECAY = 1.5
"""The k-th order is expected k^-1.5 times the first."""
ORDERS = (2, 3)


@effects.add("axis-wobble")
class AxisWobble(Effect):
    """A rotary axis that tilts as it turns, once per turn or oftener.

    In the frame that stands still the axis tilts by a (u cos q - v sin q) + b (u sin q + v cos q).

    u, v stand across the axis. A tilt of once per turn is one that turns with the joint and one that turns against
    it. The first is fixed in the body that turns and so part of its geometry; only the second can be seen.
    Setting ``orders`` n: tilts of 2 to n times a turn as well, as rings that are oval or lobed make them; of
    these both can be seen, a2 b2 against the joint and c2 d2 with it.
    The axis tilts about the bearing, which stands before an offset along the axis (r of a serial chain).
    """

    slug = "axis-wobble"
    setting_ranges = ranges({"orders": COUNT})
    driven_by = "position-periodic"
    title = "Wobbling rotary axis"
    counted = True
    sentence = "The axis of joint {0} wobbles: it tilts to and fro as it turns."
    forms = ({}, *({"orders": float(n)} for n in ORDERS))
    formula = (
        "tilt of the axis = (a + i b) exp(-i q) across it, in the frame that stands still (i: 90 deg about it); "
        "with (a2 + i b2) exp(-2 i q) + (c2 + i d2) exp(2 i q) and so on"
    )
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
        return tuple(
            Coefficient(name if order == 1 else f"{name}{order}", "rad", LARGEST * order**-DECAY)
            for order in range(1, _orders(settings) + 1)
            for name in ("ab" if order == 1 else "abcd")
        )

    def weight(self, settings: Settings) -> float:
        return 1.0 / _orders(settings)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        joint = site.machine.mechanism.joint(actuator.drives)
        u, v = across(nominal_axis(site.machine, joint.axis))
        q = site.displacement(actuator.reading)
        along_u, along_v = ca.SX(0), ca.SX(0)
        # the motion's frame has turned by q already: there the tilt turns that much further against it
        for order in range(1, _orders(site.settings) + 1):
            tail = "" if order == 1 else f"{order}"
            for one, two, phase in (("a", "b", -(order + 1) * q), ("c", "d", (order - 1) * q)):
                if one + tail in site.c:
                    x, y = site.c[one + tail], site.c[two + tail]
                    along_u += x * ca.cos(phase) - y * ca.sin(phase)
                    along_v += x * ca.sin(phase) + y * ca.cos(phase)
        tilt = ca.SX(ca.DM(u)) * along_u + ca.SX(ca.DM(v)) * along_v
        offset = sum((site.values[name] for name in own_offset(joint)), ca.SX(0))
        moved = ca.cross(tilt, ca.vertcat(0, 0, offset))
        motion = ca.vertsplit(ca.vertcat(moved, tilt))
        return {
            site.machine.motion(actuator.reading, axis): shift
            for axis, shift in zip(AXES, motion, strict=True)
            if not shift.is_zero()
        }

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        more = " once a turn" if len(values) > 2 else ""
        return f"The axis tilts by {hypot(values['a'], values['b']) * ARCSEC:.0f} arcsec{more}."


def _orders(settings: Settings) -> int:
    return round(settings.get("orders", 1.0))
