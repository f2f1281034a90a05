"""Joints that give way under the weight they carry."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from truepose.errors import InputError
from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import (
    actuator_at,
    carried,
    drives_joint,
    is_measured,
    joint_unit,
    measured_coefficient,
    measured_driver,
    measured_kind,
    measured_settings,
    measured_words,
    singly,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NOT_NEGATIVE, ORDER, ranges

BENT_AT = 100.0
"""N m (N): the load at which a bent characteristic is told."""


@effects.add("joint-compliance")
class JointCompliance(Effect):
    """dq = c * load, what gravity exerts at the joint, with springs and measured forces: minus the derivative of the energy.

    A gear that stiffens under load (or gives way more) has a further term, setting ``bend`` 2 or 3: d tau |tau| or
    d tau^3, both odd, in units of c at 100 N m (N).

    Without stated masses only products c * kg can be found. Setting ``carries`` k then names the load case:
    a mass at the origin of one body beyond the joint (the last one unless told).

    Setting ``torque`` (or ``current``) 1 or -1: the column ``torque.JOINT`` in place of the computed load, which then needs no
    masses. 1: it is the load that pulls at the joint; -1: what the drive holds against it.
    """

    slug = "joint-compliance"
    setting_ranges = ranges(
        {"torque": ORDER, "current": ORDER, "bend": NOT_NEGATIVE, "carries": NOT_NEGATIVE}
    )
    title = "Compliant joint"
    counted = True
    formula = (
        "dq = c tau, tau the torque (sliding joint: force) that gravity (springs, measured forces) exerts at the joint; "
        "bent: + d tau |tau| / 100 N*m, or d tau^3 / (100 N*m)^2; or tau as measured, torque.JOINT or current.JOINT"
    )
    size = "industrial arms 1e5 to 6e6 N*m/rad: c of 1.6e-7 to 1e-5 rad/(N*m); small arms give way more"
    look_alikes = ("link-bending", "gravity-sag", "backlash", "transmission-error")
    experiment = "measure the same poses with and without a known payload"
    source = "Dumas et al. 2011, Joint stiffness identification of six-revolute industrial serial robots"
    needs_load = True
    settings_add = True
    bends = ("bend",)

    def places(self, machine: Machine) -> Sequence[Place]:
        computed = bool(machine.load_cases)
        joints = [a.reading for a in machine.mechanism.actuators if drives_joint(machine, a)]
        return singly(name for name in joints if computed or is_measured(machine, name))

    def screened(self, machine: Machine, place: Place) -> bool:
        # a slide that is a limb's length gives way as the limb does: leg-compliance looks there
        ports = {limb.length for limb in machine.mechanism.limbs}
        return actuator_at(machine, place[0]).displacement not in ports

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """With unknown masses, one candidate for each body beyond the joint that may carry them."""
        measured = measured_settings(machine, actuator_at(machine, place[0]).reading, recording)
        if machine.loaded:
            return ({}, {"bend": 2.0}, {"bend": 3.0}, *measured)
        return [*({"carries": float(k)} for k in _pulling(machine, place)), *measured]

    def adds(self, settings: Settings) -> bool:
        """A measured load is the whole load: no other stands beside it."""
        return measured_kind(settings) is None

    def reads_load(self, settings: Settings) -> bool:
        return measured_kind(settings) is None

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        driver = measured_driver(settings, actuator_at(machine, place[0]).reading)
        return () if driver is None else (driver,)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        unit, scale = ("rad/(N*m)", 1e-4) if joint_unit(machine, place) == "rad" else ("mm/N", 1e-2)
        if measured_kind(settings) is not None:
            reading = actuator_at(machine, place[0]).reading
            return (measured_coefficient(machine, settings, reading, joint_unit(machine, place), scale),)
        if "bend" in settings:
            return (Coefficient("d", unit, scale=scale),)
        if _case(machine, place, settings):
            return (Coefficient("c_kg", f"{unit}*kg", scale=20.0 * scale, lower=0.0),)
        return (Coefficient("c", unit, scale=scale, lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        port = actuator_at(site.machine, site.place[0]).displacement
        (c,) = site.c.values()
        kind = measured_kind(site.settings)
        if kind is not None:
            (driver,) = self.drivers(site.machine, site.place, site.settings)
            return {port: site.settings[kind] * c * site.driver(driver)}
        load = site.load(port, _case(site.machine, site.place, site.settings))
        share = load / BENT_AT
        bent = {2.0: ca.fabs(share), 3.0: share**2}.get(site.settings.get("bend", 0.0), 1)
        return {port: c * load * bent}

    def weight(self, settings: Settings) -> float:
        if measured_kind(settings) is not None:
            return 0.5  # of two signs
        return 0.2 if "bend" in settings else 1.0

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        if measured_kind(settings) is not None:
            column = measured_words(settings, actuator_at(machine, place[0]).reading)
            return f"Joint {place[0]} gives way in proportion to {column}."
        unknown = "" if machine.loaded else " (masses are not stated: compliance times carried mass is found)"
        return f"Joint {place[0]} gives way under {carried(machine)}, in proportion to the load{unknown}."


def _pulling(machine: Machine, place: Place) -> list[int]:
    """Load cases that pull at the joint: bodies beyond the one that it moves, whose origin lies on its own axis."""
    mechanism, drives = machine.mechanism, actuator_at(machine, place[0]).drives
    moved = next(joint.child for joint in mechanism.tree if joint.name == drives)
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
