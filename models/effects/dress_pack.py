"""Hoses and cables that run over two joints and pull at both."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at
from truepose.models.file.driver import DriverKind
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NOT_NEGATIVE, ranges

LARGEST = 1e-3
BOTH, FIRST, SECOND = 0.0, 1.0, 2.0
"""Setting ``gives``: which of the joints give way to the hose."""


@effects.add("dress-pack")
class DressPack(Effect):
    """A hose or cable pack over two joints that pulls at them as they turn.

    It is fixed to the body before the first joint and to the one behind the second, and pulls like a spring between two points.
    The energy of such a spring is bilinear in the sines and cosines of both angles, whatever its points are; each joint turns
    by its derivative. Setting ``gives``: 0 both joints give way alike, 1 the first alone, 2 the second alone.
    """

    slug = "dress-pack"
    setting_ranges = ranges({"gives": NOT_NEGATIVE})
    title = "Hose that pulls at two joints"
    sentence = "A hose or cable pack over {0} and {1} pulls at them, as a spring between the bodies before and behind."
    formula = (
        "dq = dV / dq, V = sum of m_fg f(q) g(r), f and g each of 1, cos, sin; q, r the angles of both joints"
    )
    size = "some N*m over a joint's stiffness: 1e-5 to 1e-3 rad"
    look_alikes = ("axis-coupling", "joint-compliance", "actuator-scale")
    experiment = "unclip the hose and repeat the same poses"
    source = "energy of a linear spring between points on two bodies that turn about two axes"
    commonness = 0.5  # only wrists and forearms carry hoses

    def places(self, machine: Machine) -> Sequence[Place]:
        """Turning joints next to each other."""
        turning = [a.reading for a in machine.mechanism.actuators if a.unit == "rad"]
        order = machine.mechanism.readings
        return [pair for pair in pairwise(order) if set(pair) <= set(turning)]

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return [{"gives": which} for which in (BOTH, FIRST, SECOND)]

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(name, "rad", LARGEST) for name in _terms(settings))

    def driver_kind(self, machine: Machine, place: Place, settings: Settings) -> DriverKind:
        """Both joints drive it."""
        return "coupling"

    def shifts(self, site: Site) -> Shifts:
        joints = [actuator_at(site.machine, name) for name in site.place]
        angles = [ca.SX.sym("q"), ca.SX.sym("r")]
        waves = [{"0": ca.SX(1), "c": ca.cos(q), "s": ca.sin(q)} for q in angles]
        energy = sum(c * waves[0][name[1]] * waves[1][name[2]] for name, c in site.c.items())
        here = [site.moved(actuator.reading) for actuator in joints]
        which, out = site.settings.get("gives", BOTH), dict[str, ca.SX]()
        for k, actuator in enumerate(joints):
            if which in (BOTH, k + 1.0):
                slope = ca.gradient(energy, angles[k])
                out[actuator.displacement] = ca.substitute([slope], angles, here)[0]
        return out


def _terms(settings: Settings) -> list[str]:
    """Terms of the energy that move a joint which gives way."""
    names = [f"m{f}{g}" for f, g in product("0cs", repeat=2)]
    which = settings.get("gives", BOTH)
    return [n for n in names if (n[1] != "0" and which != SECOND) or (n[2] != "0" and which != FIRST)]
