"""A base or a tool mount that yields to the moment of the weight it carries."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import carried, points_only, singly
from truepose.models.file.driver import PAYLOAD
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NO_SETTINGS

LARGEST = {"base": 1e-5, "tool": 1e-4}
"""rad/(N m): a base on a stand or a table; a flange that carries a newton metre and turns by a tenth of a milliradian."""
TUBES = 10.0
"""How likely a telescope's tube droops, in terms of other mounts: all do by some arcsec, while few axes have an encoder or
a scale that errs as much, which from one side of an alt-az mount is the same."""


@effects.add("gravity-sag")
class GravitySag(Effect):
    """The mount turns by c times the moment of gravity (and measured forces) about its origin, equally about every axis."""

    slug = "gravity-sag"
    setting_ranges = NO_SETTINGS
    title = "Mount that sags"
    counted = True
    formula = "rotation of the mount = c M, M the moment of gravity about it"
    size = (
        "1e-9 to 1e-6 rad/(N*m) for a base on the floor, ten times more on a stand; a tool's mount carries less and may "
        "give way a hundred times more"
    )
    look_alikes = ("joint-compliance", "link-bending", "mount-drift")
    experiment = "put a level on the mount, reach out and in, and step the payload"
    source = "an elastic foundation in series with the arm"
    needs_load = True
    commonness = 0.3  # mounts are bolted down; joints turn in gears

    def places(self, machine: Machine) -> Sequence[Place]:
        if not machine.loaded:
            return []
        heavy = {"tool" if m.name == PAYLOAD else m.body for m in machine.masses}
        loaded = heavy | {force.body for force in machine.forces}
        return singly(name for name in machine.standing if name == "base" or name in loaded)

    def likely(self, machine: Machine, place: Place) -> float:
        """Tubes of telescopes droop."""
        return TUBES if place == ("tool",) and points_only(machine) else 1.0

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("c", "rad/(N*m)", scale=LARGEST.get(place[0], LARGEST["tool"]), lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        ports = [f"{site.place[0]}.motion.{axis}" for axis in ("rx", "ry", "rz")]
        return {port: site.c["c"] * site.load(port) for port in ports}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return f"The mount of the {place[0]} yields: it turns with the moment of {carried(machine)}."
