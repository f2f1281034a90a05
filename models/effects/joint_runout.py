"""Universal joints whose axes do not meet: the centre of rotation wanders with the cross."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from truepose.errors import InputError
from truepose.models import lie
from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import limb_at, singly
from truepose.models.machine import Machine
from truepose.models.mechanism import Joint
from truepose.models.states import joint_ends

_TURNS = {"rx": lie.rot_x, "ry": lie.rot_y, "rz": lie.rot_z}
_SHIFTS = ("tx", "ty", "tz")


@effects.add("joint-runout")
class JointRunout(Effect):
    """The second axis of a cross passes the first at a distance e, along the leg at home.

    Offsets that are fixed in either body, or along an axis, are geometry; this one turns with the cross alone. Of a
    universal joint the first axis is x of its frame; of a spherical one, taken for a cross with a swivel, setting
    ``first`` says x (0) or y (1). At a rod's end (``leg1.a``) the cross may stand at any angle about the leg: its
    e w w' is a symmetric 2 x 2 matrix (uu, uv, vv) in the plane across, w the direction of the first axis.
    """

    slug = "joint-runout"
    title = "Universal joint whose axes do not meet"
    formula = (
        "centre of the joint shifts by e (c - c_home), c the unit vector of the leg across the first axis; a leg on "
        "rods: dl = -(uu n_u^2 + 2 uv n_u n_v + vv n_v^2) / 2, n_u and n_v its direction across that of home"
    )
    size = "5 to 50 um (recalled)"
    look_alikes = ("flexure-shift", "wrong-constant", "leg-compliance")
    experiment = "take the joint out, put it back turned by a quarter turn about the leg, and repeat"
    source = (
        "loop of a cross with offset axes; modified Cardan joints break the spherical model of hexapods "
        "(preprints 202512.0728, abstract)"
    )

    def places(self, machine: Machine) -> Sequence[Place]:
        if machine.mechanism.loops != "exact":
            return []
        return singly(end for end in joint_ends(machine) if _acts(machine, end))

    def screened(self, machine: Machine, place: Place) -> bool:
        # flexures have no cross
        return place[0] not in _rod_ends(machine) or machine.mechanism.flexure_length is None

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        names = ("uu", "uv", "vv") if place[0] in _rod_ends(machine) else ("e",)
        return tuple(Coefficient(name, "mm", 0.2) for name in names)

    def shifts(self, site: Site) -> Shifts:
        name = site.place[0]
        home = site.machine.mechanism.home_directions
        if name not in home:
            raise InputError(
                f"{self.slug}: found joint {name!r}, expected one of {', '.join(home) or 'none'}"
            )
        now, then = site.direction(name), np.array(home[name])
        if name in _rod_ends(site.machine):
            across = np.linalg.svd(then.reshape(1, 3))[2][1:]  # (2, 3)
            u, v = ca.vertsplit(ca.SX(ca.DM(across)) @ now)
            grows = -(site.c["uu"] * u**2 + 2 * site.c["uv"] * u * v + site.c["vv"] * v**2) / 2
            return {limb_at(site.machine, name.rpartition(".")[0]).length: grows}
        joint = _joint(site.machine, name)
        first = round(site.settings.get("first", 0.0))
        shift = _turned(joint, site) @ (_across(now, first) - _across(ca.SX(ca.DM(then)), first))
        return {
            step.parameter: site.c["e"] * shift["xyz".index(step.kind[1])] for step in joint.placement[:3]
        }

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        if place[0] in _rod_ends(machine) or _joint(machine, place[0]).kind == "universal":
            return ({},)
        then = machine.mechanism.home_directions[place[0]]
        return [{"first": float(k)} for k in range(2) if abs(then[k]) < 0.9]

    def explain(self, machine: Machine, place: Place) -> str:
        return f"The axes of the cross in joint {place[0]} do not meet: its centre wanders as it turns."


def _rod_ends(machine: Machine) -> set[str]:
    return {f"{rod.name}.{end}" for rod in machine.mechanism.rods for end in "ab"}


def _acts(machine: Machine, end: str) -> bool:
    """Whether the effect can be put there: a rod of a limb, or a joint with a placement of its own."""
    if end in _rod_ends(machine):
        return end.rpartition(".")[0] in {limb.name for limb in machine.mechanism.limbs}
    return tuple(step.kind for step in _joint(machine, end).placement[:3]) == _SHIFTS


def _joint(machine: Machine, name: str) -> Joint:
    return next(joint for joint in machine.mechanism.joints if joint.name == name)


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
