"""Links that bend under the weight they carry, as cantilevers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from truepose.errors import InputError
from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import carried, drives_joint, own_offset, singly
from truepose.models.file.driver import PAYLOAD
from truepose.models.machine.assembly import (
    Number,
    axis_of,
    frame_of,
    in_base,
    load_scale,
    of_mass,
    placed_frame,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES, Joint, looped
from truepose.models.machine.placed import NOT_NEGATIVE, ranges

SHORTEST = 1.0
"""mm: shorter links, whose axes meet, give way as their bearings do."""
OVERHANG = "overhang"
"""Setting of a slide whose beam reaches from its guide."""
ROUNDING = 1e-6
"""mm: no length."""
LARGEST = 1e-4
"""rad/(N m) that a joint gives way across its axis: as much as about it (``joint-compliance``)."""
POISSON = 0.3
"""Of steel and aluminium: G = E / (2 (1 + nu)); a round section's polar moment is twice its second moment."""


@effects.add("link-bending")
class LinkBending(Effect):
    """Links that bend under the weight they carry, as cantilevers.

    A link clamped at its joint bends about both axes across it by c = 1 / (E I), from there to the next joint.

    An offset along the joint's own axis (r of a serial chain) is part of the link, as in thermal expansion.
    At its end act the force and the moment of all that lies beyond; its own masses act where their centres are
    along it. Setting ``twist`` 1: it also twists about its own length as a round tube does, G J = E I / (1 + nu);
    without, it is stiff against that. Tension and other sections are left out. Links of an open chain only.

    A link without length, where a revolute joint's axis meets the next one, turns about both axes across its joint by c times
    gravity's moment: bearings and housing. Setting ``overhang`` 1: a slide carries the link as a ram, clamped where the
    slide's guide ends, so that its length grows with the reading.
    """

    slug = "link-bending"
    setting_ranges = ranges({"overhang": NOT_NEGATIVE, "twist": NOT_NEGATIVE})
    title = "Link that bends"
    counted = True
    formula = (
        "deflection c (F L^3 / 3 + M L^2 / 2) and slope c (F L^2 / 2 + M L) at the link's end, c = 1 / (E I), "
        "F and M of the weight beyond; a mass of its own at a: c F a^2 (3 L - a) / 6 and c F a^2 / 2; "
        "with twist: c (1 + nu) T L about the link, T the moment about it, nu = 0.3; "
        "a link without length: c M across its joint; a ram: L from the slide's guide on"
    )
    size = "10 to 30 % of an arm's total compliance (recalled); 1 / (E I) of 1e-12 to 1e-9 1/(N*mm^2)"
    look_alikes = ("joint-compliance", "gravity-sag", "screw-windup")
    experiment = "two targets on the link, at its joint and at its end, with and without a payload"
    source = "Euler-Bernoulli cantilever; Klimchik et al. on stiffness of arms and their links (recalled)"
    needs_load = True
    commonness = 0.3  # of an industrial arm's compliance 10 to 30 % are its links', the rest its joints'

    def places(self, machine: Machine) -> Sequence[Place]:
        # what a spring pulls at points elsewhere than down, and no link's share of it is known
        return singly(_links(machine)) if machine.loaded and not machine.springs else []

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        link = _link(machine, place)
        ram: list[Settings] = [{OVERHANG: 1.0}] if link.slides else []
        if link.short:
            return ram or ({},)
        return ({}, {"twist": 1.0}, *ram)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if _link(machine, place).short and OVERHANG not in settings:
            return (Coefficient("c", "rad/(N*m)", scale=LARGEST, lower=0.0),)
        return (Coefficient("c", "1/(N*mm^2)", scale=1e-9, lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        link = _link(site.machine, site.place)
        if link.short and OVERHANG not in site.settings:
            return _yielding(site, link)
        end, turn, move = _bent(site, link)
        c = site.c["c"]
        # the whole link turns at its joint instead: its end, and all beyond, goes where the bent link takes it
        motion = ca.vertcat(move - ca.cross(turn, end), turn)
        return {f"{link.joint.name}.motion.{axis}": c * motion[k] for k, axis in enumerate(AXES)}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        if _link(machine, place).short:
            return f"{place[0]} gives way across its joint under {carried(machine)}: bearings and housing."
        return f"The link {place[0]} bends under {carried(machine)}, like a cantilever."


@dataclass(frozen=True)
class _Link:
    """A body with what is fixed to it, up to the next driven joint or (None) to the tool."""

    joint: Joint
    rigid: tuple[Joint, ...]
    after: Joint | None
    short: bool = False

    @property
    def slides(self) -> bool:
        """Whether a slide carries it."""
        return self.joint.kind == "prismatic"

    def frames(self, site_values: dict[str, ca.SX]) -> dict[str, ca.SX]:
        """Frame (4, 4) of each of its bodies in that of the first."""
        frames = {self.joint.child: ca.SX.eye(4)}
        for joint in self.rigid:
            frames[joint.child] = placed_frame(joint, frames, site_values)
        return frames

    def root(self, values: Mapping[str, ca.SX]) -> ca.SX:
        """(3,) where it starts: before an offset along its joint's axis."""
        return ca.vertcat(0, 0, -_offset(self.joint, values))

    def end(self, values: dict[str, ca.SX]) -> ca.SX:
        """(3,) where it ends, mm: where the next one starts."""
        frames = self.frames(values)
        if self.after is None:
            return (frames[self.last] @ frame_of(values, "tool"))[:3, 3]
        there = placed_frame(self.after, frames, values)
        return there[:3, 3] - _offset(self.after, values) * there[:3, 2]

    @property
    def last(self) -> str:
        """The body at its far end."""
        return self.rigid[-1].child if self.rigid else self.joint.child


def _link(machine: Machine, place: Place) -> _Link:
    """The link at a place. Raises InputError where there is none."""
    links = _links(machine)
    if place[0] not in links:
        known = ", ".join(links) or "a machine with open links"
        raise InputError(f"{LinkBending.slug}: found link {place[0]!r}, expected one of {known}")
    return links[place[0]]


def _yielding(site: Site, link: _Link) -> dict[str, ca.SX]:
    """Turns about the axes across a joint, by the moments that the load exerts about them (N m)."""
    ports = [f"{link.joint.name}.motion.{axis}" for axis in AXES[3:]]
    moment = ca.vertcat(*(site.load(port) for port in ports))
    axis = axis_of(link.joint, site.values)
    across = site.c["c"] * (moment - ca.dot(moment, axis) * axis)
    return {port: across[k] for k, port in enumerate(ports)}


def _links(machine: Machine) -> dict[str, _Link]:
    """Links on the way from base to flange, outside loops, by the body that moves with the joint."""
    mechanism, inside = machine.mechanism, looped(machine.mechanism)
    way = mechanism.way(mechanism.flange)
    driven = {a.drives for a in mechanism.actuators if drives_joint(machine, a)}
    driven |= {follower.joint for follower in mechanism.followers}
    nominal = {name: ca.SX(value) for name, value in machine.nominal_values.items()}
    out = {}
    for k, joint in enumerate(way):
        beyond = way[k + 1 :]
        if joint.name not in driven or inside & {j.name for j in (joint, *beyond)}:
            continue
        stop = next((i for i, j in enumerate(beyond) if j.kind != "fixed"), len(beyond))
        link = _Link(joint, tuple(beyond[:stop]), beyond[stop] if stop < len(beyond) else None)
        length = float(ca.norm_2(ca.evalf(link.end(nominal) - link.root(nominal))))
        out[joint.child] = replace(link, short=length <= SHORTEST)
    return out


def _offset(joint: Joint, values: Mapping[str, ca.SX]) -> ca.SX:
    return sum((values[name] for name in own_offset(joint)), ca.SX(0))


def _bent(site: Site, link: _Link) -> tuple[ca.SX, ca.SX, ca.SX]:
    """End of the link, and its slope and deflection for E I = 1 N mm^2; all (3,), in the frame of its joint's child."""
    values, frames = dict(site.values), link.frames(dict(site.values))
    end, root = link.end(values), link.root(values)
    length = ca.norm_2(end - root)
    if OVERHANG in site.settings:
        root -= site.displacement(_reading(site.machine, link.joint)) * axis_of(link.joint, values)
        length = ca.sqrt(ca.sumsqr(end - root) + ROUNDING**2)  # smooth where the ram is drawn in
    along = (end - root) / length
    force, moment = _loads(site, link.joint.name)
    moment -= ca.cross(root, force)  # from here on about the root
    turn, move = ca.SX.zeros(3), ca.SX.zeros(3)
    twisting = (1.0 + POISSON) * site.settings.get("twist", 0.0)
    own = _own(site, link, frames)
    down = _down(site, link.joint.name) if own else ca.SX.zeros(3)
    for kg, at in own:
        weight, lever = kg * down, at - root
        a = ca.fmax(ca.dot(lever, along), 0.0)
        across = weight - ca.dot(weight, along) * along
        inner = ca.fmin(a, length)
        turn += inner**2 / 2 * ca.cross(along, across)
        move += inner**2 * (3 * length - inner) / 6 * across
        outer = lever - inner * along
        torque = ca.cross(outer, weight)
        bending = torque - ca.dot(torque, along) * along
        turn += inner * (bending + twisting * ca.dot(torque, along) * along)
        move += inner * (length - inner / 2) * ca.cross(bending, along)
        force, moment = force - weight, moment - ca.cross(lever, weight)
    moment -= ca.cross(end - root, force)
    across, bending = (v - ca.dot(v, along) * along for v in (force, moment))
    turn += length**2 / 2 * ca.cross(along, across)
    turn += length * (bending + twisting * ca.dot(moment, along) * along)
    move += length**3 / 3 * across + length**2 / 2 * ca.cross(bending, along)
    return end, turn, move


def _reading(machine: Machine, joint: Joint) -> str:
    """The reading that drives a joint."""
    return next(a.reading for a in machine.mechanism.actuators if a.drives == joint.name)


def _down(site: Site, joint: str) -> ca.SX:
    """(3,) gravity, m/s^2, in the frame of a joint's child."""
    weight, _ = _loads(site, joint, site.machine.weight_case)
    return float(np.linalg.norm(site.machine.gravity or (0.0,))) * weight / ca.norm_2(weight)


def _loads(site: Site, joint: str, case: str = "") -> tuple[ca.SX, ca.SX]:
    """Force (N) and moment (N mm) on all that the joint carries, at its child's origin and in its frame."""
    ports = [f"{joint}.motion.{axis}" for axis in AXES]
    values = [site.load(port, case) * load_scale(site.machine, port) for port in ports]
    return ca.vertcat(*values[:3]), ca.vertcat(*values[3:])


def _own(site: Site, link: _Link, frames: dict[str, ca.SX]) -> list[tuple[Number, ca.SX]]:
    """Masses (kg) fixed to the link itself with their centres (3,); what is on the tool, or a payload, lies beyond."""
    out = []
    for mass in site.machine.masses:
        if (
            site.machine.weighs
            and mass.body in frames
            and (mass.kg or mass.parameters)
            and mass.name != PAYLOAD
        ):
            kg, com = of_mass(mass, site.values)
            out.append((kg, in_base(frames[mass.body], com)))
    return out
