"""Joints whose centre of rotation wanders as they turn: axes of a cross that do not meet, pins that are not round."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot

import casadi as ca
import numpy as np

from truepose.errors import InputError
from truepose.models import lie
from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import limb_at, singly
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Direction, Joint
from truepose.models.machine.placed import NOT_NEGATIVE, ORDER, ranges
from truepose.models.machine.states import across, hinges, joint_ends

LOBES = (*range(-8, 0), *range(2, 9))
"""Orders of a pin: circles a turn, with (> 0) or against it. Once with it is fixed in the body that turns: geometry."""
PIN_MM = 0.05
_TURNS = {"rx": lie.rot_x, "ry": lie.rot_y, "rz": lie.rot_z}
_SHIFTS = ("tx", "ty", "tz")


@effects.add("joint-runout")
class JointRunout(Effect):
    """Joints whose centre of rotation wanders as they turn: axes of a cross that do not meet, pins that are not round.

    The second axis of a cross passes the first at a distance e, along the leg at home; or a pin is not round.

    Offsets that are fixed in either body, or along an axis, are geometry; this one turns with the cross alone. Of a
    universal joint the first axis is x of its frame; of a spherical one, taken for a cross with a swivel, setting
    ``first`` says x (0) or y (1). At a rod's end (``leg1.a``) the cross may stand at any angle about the leg: its
    e w w' is a symmetric 2 x 2 matrix (uu, uv, vv) in the plane across, w the direction of the first axis.

    Setting ``order`` n, at passive revolute joints and universal ones: the pin's centre goes n times round a circle
    for each turn of the joint, against it for n < 0; any path is a sum of such circles. Setting ``pin`` says
    which axis of a universal joint, 1 (x) or 2 (y of the cross).
    """

    slug = "joint-runout"
    setting_ranges = ranges({"order": ORDER, "first": NOT_NEGATIVE, "pin": NOT_NEGATIVE})
    driven_by = "position-periodic"
    title = "Joint whose centre wanders as it turns"
    counted = True
    formula = (
        "centre of the joint shifts by e (c - c_home), c the unit vector of the leg across the first axis; a leg on "
        "rods: dl = -(uu n_u^2 + 2 uv n_u n_v + vv n_v^2) / 2, n_u and n_v its direction across that of home; "
        "a pin: (a + i b) exp(i n t) across it, t the joint's angle (i: 90 deg about the pin)"
    )
    size = "5 to 50 um (recalled)"
    look_alikes = ("flexure-shift", "wrong-constant", "leg-compliance")
    experiment = "take the joint out, put it back turned by a quarter turn about the leg, and repeat"
    source = (
        "loop of a cross with offset axes; modified Cardan joints break the spherical model of hexapods "
        "(preprints 202512.0728, abstract); radial error motion of an axis of rotation by orders, ISO 230-7 (recalled)"
    )
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        if machine.mechanism.loops != "exact":
            return []
        ends = (*joint_ends(machine), *(joint.name for joint in hinges(machine)))
        return singly(end for end in ends if _acts(machine, end))

    def screened(self, machine: Machine, place: Place) -> bool:
        # flexures have no cross
        return place[0] not in machine.mechanism.rod_ends or machine.mechanism.flexure_length is None

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if "order" in settings or place[0] in _hinges(machine):
            return tuple(Coefficient(name, "mm", PIN_MM) for name in "ab")
        names = ("uu", "uv", "vv") if place[0] in machine.mechanism.rod_ends else ("e",)
        return tuple(Coefficient(name, "mm", 0.2) for name in names)

    def shifts(self, site: Site) -> Shifts:
        name = site.place[0]
        if name in _hinges(site.machine) or "order" in site.settings:
            return _of_pin(site)
        home = site.machine.mechanism.home_directions
        if name not in home:
            raise InputError(
                f"{self.slug}: found joint {name!r}, expected one of {', '.join(home) or 'none'}"
            )
        now, then = site.direction(name), np.array(home[name])
        if name in site.machine.mechanism.rod_ends:
            across = np.linalg.svd(then.reshape(1, 3))[2][1:]  # (2, 3)
            u, v = ca.vertsplit(ca.SX(ca.DM(across)) @ now)
            grows = -(site.c["uu"] * u**2 + 2 * site.c["uv"] * u * v + site.c["vv"] * v**2) / 2
            return {limb_at(site.machine, site.machine.mechanism.rod_ends[name].name).length: grows}
        joint = site.machine.mechanism.joint(name)
        first = round(site.settings.get("first", 0.0))
        shift = _turned(joint, site) @ (_across(now, first) - _across(ca.SX(ca.DM(then)), first))
        return {
            step.parameter: site.c["e"] * shift["xyz".index(step.kind[1])] for step in joint.placement[:3]
        }

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        if place[0] in machine.mechanism.rod_ends:
            return ({},)
        kind = machine.mechanism.joint(place[0]).kind
        if kind == "revolute":
            return [{"order": float(n)} for n in LOBES]
        if kind == "universal":
            return [{}, *({"order": float(n), "pin": pin} for pin in (1.0, 2.0) for n in LOBES)]
        then = machine.mechanism.home_directions[place[0]]
        return [{"first": float(k)} for k in range(2) if abs(then[k]) < 0.9]

    def weight(self, settings: Settings) -> float:
        return 1.0 / abs(settings.get("order", 1.0))  # fine lobes are shallower

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        if place[0] in _hinges(machine):
            return f"The pin of joint {place[0]} is not round, or runs out: its centre wanders as it turns."
        return f"The axes of the cross in joint {place[0]} do not meet: its centre wanders as it turns."

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        if "a" not in values:
            return ""
        return f"The pin's centre circles with a radius of {1e3 * hypot(values['a'], values['b']):.0f} um."


def _of_pin(site: Site) -> Shifts:
    """What a pin that is not round adds to the placement of its joint."""
    name, n = site.place[0], site.settings.get("order", LOBES[0])
    joint = site.machine.mechanism.joint(name)
    axis, angle, cross = _pin(site, joint)
    u, v = (ca.SX(ca.DM(w)) for w in across(axis))
    cosine, sine = ca.cos(n * angle), ca.sin(n * angle)
    a, b = site.c["a"], site.c["b"]
    centre = u * (a * cosine - b * sine) + v * (a * sine + b * cosine)
    shift = _turned(joint, site) @ cross @ centre
    return {step.parameter: shift["xyz".index(step.kind[1])] for step in joint.placement[:3]}


def _pin(site: Site, joint: Joint) -> tuple[tuple[float, float, float], ca.SX, ca.SX]:
    """Axis and angle (rad) of a pin, and (3, 3) from the part that holds it to the joint's frame."""
    if joint.kind == "revolute":
        hinge = _hinges(site.machine)[joint.name]
        return hinge, site.turn(joint.name), ca.SX.eye(3)
    x, y, z = ca.vertsplit(site.direction(joint.name))
    first = ca.atan2(-y, z)
    if round(site.settings.get("pin", 1.0)) == 1:
        return (1.0, 0.0, 0.0), first, ca.SX.eye(3)
    return (0.0, 1.0, 0.0), ca.asin(x), lie.rot_x(first)[:3, :3]


def _hinges(machine: Machine) -> dict[str, tuple[float, float, float]]:
    """Axes of passive revolute joints."""
    return {j.name: j.axis for j in hinges(machine) if not isinstance(j.axis, Direction)}


def _acts(machine: Machine, end: str) -> bool:
    """Whether the effect can be put there: a rod of a limb, or a joint with a placement of its own."""
    if end in machine.mechanism.rod_ends:
        return machine.mechanism.rod_ends[end].name in {limb.name for limb in machine.mechanism.limbs}
    return tuple(step.kind for step in machine.mechanism.joint(end).placement[:3]) == _SHIFTS


def _across(direction: ca.SX, first: int) -> ca.SX:
    """(3,) unit vector of a direction's part across axis 0 (x) or 1 (y)."""
    part = ca.vertcat(*(ca.SX(0) if k == first else direction[k] for k in range(3)))
    return part / ca.norm_2(part)


def _turned(joint: Joint, site: Site) -> ca.SX:
    """(3, 3) from the joint's frame to its parent's."""
    out = ca.SX.eye(3)
    for step in joint.placement:
        if step.kind in _TURNS:
            out = out @ _TURNS[step.kind](site.values[step.parameter])[:3, :3]
    return out
