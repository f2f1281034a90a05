"""Mounts that stand firm up to a moment and tilt over an edge beyond it."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import carried
from truepose.models.effects.sagging import SOFTEST, GravitySag
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NOT_NEGATIVE, ranges

EDGES = tuple(float(f"{10.0 ** (k / 6):.3g}") for k in range(19))
"""N*m that are tried, from 1 to 1000; what is found is refined between them."""
ROUND = 0.05
"""Share of the edge over which a foot begins to lift."""


@effects.add("rocking-mount")
class RockingMount(Effect):
    """A base or clamp that rocks: it tilts once the moment on it is larger than what holds it down.

    A foot that lifts or a clamp that opens lets the mount turn by c times what the moment M is beyond its ``edge`` (N*m),
    about the moment's own axis. With no edge it is ``gravity-sag``.
    """

    slug = "rocking-mount"
    setting_ranges = ranges({"edge": NOT_NEGATIVE})
    title = "Mount that rocks over an edge"
    counted = True
    formula = "rotation of the mount = c M (1 - edge / |M|) where |M| > edge, else 0"
    size = "a foot that lifts by 10 to 100 um over half a metre: 2e-5 to 2e-4 rad"
    look_alikes = ("gravity-sag", "joint-compliance", "mount-drift")
    experiment = "put a level on the mount and step the payload at full reach: it tilts from some load on"
    source = "contact that opens: a unilateral support in series with the arm"
    needs_load = True
    commonness = 0.2
    continuous = ("edge",)

    def places(self, machine: Machine) -> Sequence[Place]:
        return GravitySag().places(machine)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return [{"edge": edge} for edge in EDGES]

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        softest = SOFTEST.get(place[0], SOFTEST["tool"])
        return (Coefficient("c", "rad/(N*m)", scale=softest, lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        ports = [f"{site.place[0]}.motion.{axis}" for axis in ("rx", "ry", "rz")]
        moment = {port: site.load(port) for port in ports}
        edge = site.settings.get("edge", EDGES[0])
        width = ROUND * edge
        size = ca.sqrt(sum((m**2 for m in moment.values()), ca.SX(width**2)))
        beyond = size - edge
        opened = (beyond + ca.sqrt(beyond**2 + width**2)) / 2
        return {port: site.c["c"] * m * opened / size for port, m in moment.items()}

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return (
            f"The mount of the {place[0]} rocks: it tilts once the moment of {carried(machine)} is larger than "
            f"{settings['edge']:.3g} N*m."
        )
