"""Joints and legs that give way under the load they carry."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from truepose.errors import InputError
from truepose.models.effects.base import (
    Coefficient,
    DriverKind,
    Effect,
    Observed,
    Place,
    Settings,
    Shifts,
    Site,
    effects,
)
from truepose.models.effects.common import (
    LOADS,
    actuator_at,
    carried,
    drives_joint,
    joint_unit,
    limb_at,
    singly,
    singly_and_together,
    travel_from_home,
)
from truepose.models.effects.flexed_legs import flexure_forces
from truepose.models.file.driver import CURRENT, MEASURED_LOADS, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NOT_NEGATIVE, ORDER, POSITIVE, SWITCH, ranges

PER_AMPERE = 10.0
"""N m (N) that an ampere of a geared motor holds, to a power of ten. Chosen."""
KNEE, SHARP = "knee", "sharp"
"""Settings: the load, N*m or N, up to which a joint gives way more than beyond it, and whether it does so at once."""
FLEXURES = "flexures"
"""Setting: what pushes legs back is their flexures, by the actuators' travel."""
PUSHED = 1000.0
"""mm^2: a leg of 1e-3 mm/N with flexures of 1e6 N mm/rad."""
BEND, BENT_AT = "bend", 100.0
"""Setting of files by earlier versions: a power of the load, and N*m (N) at which it is told. Beyond what was seen it turns
back, so that no diagnosis offers it."""
SMOOTH, CORNER = 2.0, 16.0
"""Powers by which the one gives way to the other: within the knee's own size, or within a tenth of it."""


@effects.add("joint-compliance")
class JointCompliance(Effect):
    """Joints that give way under the weight they carry.

    dq = c * load, what gravity exerts at the joint, with springs and measured forces: minus the derivative of the energy.

    A gear that stiffens under load has a setting ``knee`` T (N m, N): it gives way by e tau more as long as its teeth and
    rollers come to bear, and by e T once they do: by and by, or with ``sharp`` 1 at once.

    Without stated masses only products c * kg can be found. Setting ``carries`` k then names the load case:
    a mass at the origin of one body beyond the joint (the last one unless told).

    Setting ``torque`` (or ``current``) 1 or -1: the column ``torque.JOINT`` in place of the computed load, which then needs no
    masses. 1: it is the load that pulls at the joint; -1: what the drive holds against it.
    """

    slug = "joint-compliance"
    setting_ranges = ranges(
        {
            "torque": ORDER,
            "current": ORDER,
            BEND: NOT_NEGATIVE,
            KNEE: POSITIVE,
            SHARP: SWITCH,
            "carries": NOT_NEGATIVE,
        }
    )
    title = "Compliant joint"
    counted = True
    formula = (
        "dq = c tau, tau the torque (sliding joint: force) that gravity (springs, measured forces) exerts at the joint; "
        "with a knee T: c tau + e tau / (1 + |tau / T|^p)^(1/p), p 2 or (sharp) 16; or tau as "
        "measured, torque.JOINT or current.JOINT"
    )
    size = "industrial arms 1e5 to 6e6 N*m/rad: c of 1.6e-7 to 1e-5 rad/(N*m); small arms give way more"
    look_alikes = ("link-bending", "gravity-sag", "backlash", "transmission-error")
    experiment = "measure the same poses with and without a known payload"
    source = (
        "Dumas et al. 2011, Joint stiffness identification of six-revolute industrial serial robots; makers of gears state "
        "a stiffness up to a torque and another one beyond it"
    )
    needs_load = True
    settings_add = True
    continuous = (KNEE,)

    def places(self, machine: Machine) -> Sequence[Place]:
        drivers = {Driver.of(name) for name in machine.drivers}
        measured = {driver.place for driver in drivers if driver.kind in MEASURED_LOADS}
        joints = [a.reading for a in machine.mechanism.actuators if drives_joint(machine, a)]
        return singly(name for name in joints if machine.load_cases or name in measured)

    def screened(self, machine: Machine, place: Place) -> bool:
        # a slide that is a limb's length gives way as the limb does: leg-compliance looks there
        ports = {limb.length for limb in machine.mechanism.limbs}
        return actuator_at(machine, place[0]).displacement not in ports

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """With unknown masses, one candidate for each body beyond the joint that may carry them; either sign of each column."""
        measured: list[Settings] = []
        for kind in MEASURED_LOADS:
            name = _column(machine, place, kind)
            if name in machine.drivers and recording.driver(name) is not None:
                measured += [{kind: 1.0}, {kind: -1.0}]
        if machine.loaded:
            knees = [{KNEE: load} for load in LOADS]
            return ({}, *knees, *({**knee, SHARP: 1.0} for knee in knees), *measured)
        return [*({"carries": float(k)} for k in _pulling(machine, place)), *measured]

    def adds(self, settings: Settings) -> bool:
        """A measured load is the whole load, and a knee the whole gear: no other stands beside it."""
        return self.reads_load(settings) and KNEE not in settings

    def reads_load(self, settings: Settings) -> bool:
        return _measured(settings) is None

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        kind = _measured(settings)
        return () if kind is None else (_column(machine, place, kind),)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        turns, kind = joint_unit(machine, place) == "rad", _measured(settings)
        unit, scale = ("rad/(N*m)", 1e-4) if turns else ("mm/N", 1e-2)
        if kind is not None:
            per, size = machine.driver_unit(_column(machine, place, kind)), scale
            size *= PER_AMPERE if kind == CURRENT else 1.0
            own = joint_unit(machine, place)
            unit = f"{own}/({per})" if "*" in per else f"{own}/{per}"
            return (Coefficient("c", unit, scale=size, lower=0.0),)
        if BEND in settings:
            return (Coefficient("d", unit, scale=scale),)
        if KNEE in settings:
            return tuple(Coefficient(name, unit, scale=scale, lower=0.0) for name in ("c", "e"))
        if _case(machine, place, settings):
            return (Coefficient("c_kg", f"{unit}*kg", scale=20.0 * scale, lower=0.0),)
        return (Coefficient("c", unit, scale=scale, lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        port = actuator_at(site.machine, site.place[0]).displacement
        c, *soft = site.c.values()
        kind = _measured(site.settings)
        if kind is not None:
            return {port: site.settings[kind] * c * site.driver(_column(site.machine, site.place, kind))}
        if SHARP in site.settings and KNEE not in site.settings:
            raise InputError(f"{self.slug} at {site.place[0]}: found {SHARP} without {KNEE}, expected both")
        load = site.load(port, _case(site.machine, site.place, site.settings))
        if BEND in site.settings:
            load *= ca.fabs(load / BENT_AT) ** (site.settings[BEND] - 1.0)
        return {port: c * load + sum((e * _held(load, site.settings) for e in soft), ca.SX(0))}

    def weight(self, settings: Settings) -> float:
        if _measured(settings) is not None:
            return 0.5  # of two signs
        return 0.5 / len(LOADS) if KNEE in settings else 1.0

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        kind = _measured(settings)
        if kind is not None:
            holds = (
                "the load that pulls at it" if settings[kind] > 0 else "what the drive holds against the load"
            )
            column = f"{_column(machine, place, kind)}, which by its sign is {holds}"
            return f"Joint {place[0]} gives way in proportion to {column}."
        if KNEE in settings:
            knee = f"{settings[KNEE]:.3g} {'N*m' if joint_unit(machine, place) == 'rad' else 'N'}"
            return f"Joint {place[0]} gives way under {carried(machine)}: more up to {knee}, less beyond."
        unknown = "" if machine.loaded else " (masses are not stated: compliance times carried mass is found)"
        return f"Joint {place[0]} gives way under {carried(machine)}, in proportion to the load{unknown}."


def _held(load: ca.SX, settings: Settings) -> ca.SX:
    """The load as far as it is below the knee."""
    power = CORNER if settings.get(SHARP) else SMOOTH
    square = (load / settings[KNEE]) ** 2
    return load / (1.0 + square ** (power / 2)) ** (1 / power)


def _measured(settings: Settings) -> str | None:
    """``torque`` or ``current`` where settings read one of them in the computed load's place."""
    return next((kind for kind in MEASURED_LOADS if kind in settings), None)


def _column(machine: Machine, place: Place, kind: str) -> str:
    """The column of a joint's torque or current."""
    return Driver(kind, actuator_at(machine, place[0]).reading).name


def _pulling(machine: Machine, place: Place) -> list[int]:
    """Load cases that pull at the joint: bodies beyond the one that it moves, whose origin lies on its own axis."""
    mechanism, drives = machine.mechanism, actuator_at(machine, place[0]).drives
    moved = mechanism.joint(drives).child
    beyond: set[str] = set()
    for joint in mechanism.tree:  # parents come first
        if joint.parent == moved or joint.parent in beyond:
            beyond.add(joint.child)
    on_tool = {"tool"} if mechanism.flange in {moved, *beyond} else set()
    return [k for k, case in enumerate(machine.load_cases) if case.removesuffix("|") in beyond | on_tool]


def _case(machine: Machine, place: Place, settings: Settings) -> str:
    """The load case: all stated masses, or else 1 kg at the origin of one body."""
    if machine.loaded or not machine.load_cases:
        return ""
    last = len(machine.load_cases) - 1
    chosen = settings.get("carries", float(max(_pulling(machine, place), default=last)))
    if chosen not in range(last + 1):
        raise InputError(f"{JointCompliance.slug}: found carries = {chosen:g}, expected 0 to {last}")
    return machine.load_cases[round(chosen)]


def _pushing(machine: Machine) -> ca.DM:
    """The legs' tensions by the actuators' travel, of flexures of unit stiffness."""
    forces = flexure_forces(machine)
    if forces is None:
        raise InputError(
            f"{machine.name}: found leg-compliance with {FLEXURES}, expected six rods of fixed lengths on slides that "
            "end in flexures (`flexure: {length: ...}`)"
        )
    return ca.DM(forces)


@effects.add("leg-compliance")
class LegCompliance(Effect):
    """Legs that stretch and shorten under the forces they carry.

    dl = c F, F the leg's force from the closed loops' statics, tension positive; one leg or all alike.

    Setting ``flexures`` 1, of all legs together: F is what their flexures push back with, in proportion to what the actuators
    have travelled (``flexed_legs``), and the coefficient is the compliance times the flexures' stiffness, which nobody needs to
    know.
    """

    slug = "leg-compliance"
    setting_ranges = ranges({FLEXURES: SWITCH})
    title = "Compliant leg"
    counted = True
    formula = "dl = c F, F > 0 in tension; of flexures F = K drho, of unit stiffness"
    size = "0.01 to 1 um/N"
    look_alikes = ("platform-deformation", "actuator-scale", "gravity-sag", "wrong-constant")
    experiment = "repeat poses with and without a payload; targets beside the leg ends exclude the platform"
    source = "a bar of stiffness EA/l in series with its joints"
    needs_load = True

    def places(self, machine: Machine) -> Sequence[Place]:
        legs = [limb.name for limb in machine.mechanism.limbs]
        if machine.loaded:
            return singly_and_together(legs)
        return [tuple(legs)] if flexure_forces(machine) is not None else []

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Under what is stated to pull; all legs also under what their flexures make."""
        pushed = len(place) > 1 and flexure_forces(machine) is not None
        return [*([{}] if machine.loaded else []), *([{FLEXURES: 1.0}] if pushed else [])]

    def reads_load(self, settings: Settings) -> bool:
        return not settings.get(FLEXURES)

    def driver_kind(self, machine: Machine, place: Place, settings: Settings) -> DriverKind:
        """Return the legs' load, whoever makes it."""
        return "load"

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if settings.get(FLEXURES):
            return (Coefficient("c", "mm^2", scale=PUSHED, lower=0.0),)
        return (Coefficient("c", "mm/N", scale=1e-2, lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        limbs = [limb_at(site.machine, name) for name in site.place]
        if site.settings.get(FLEXURES):
            travel = ca.vertcat(*(travel_from_home(site, limb.reading) for limb in limbs))
            forces = ca.vertsplit(_pushing(site.machine) @ travel)
            return {limb.length: site.c["c"] * force for limb, force in zip(limbs, forces, strict=True)}
        return {limb.length: site.c["c"] * site.load(limb.length) for limb in limbs}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        if len(place) > 1:
            how = "their flexures push them back" if settings.get(FLEXURES) else "they grow in tension"
            return f"The legs {', '.join(place)} are equally compliant: {how}."
        return f"The leg {place[0]} is compliant: it grows in tension, shortens in compression."
