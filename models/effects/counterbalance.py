"""Springs and cylinders that hold a joint's weight, and what their pull does to its gear."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, joint_unit, singly
from truepose.models.file.driver import DriverKind
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import ANY, NOT_NEGATIVE, ranges

LARGEST = 1e-3
RATIOS, ANGLES = (0.3, 0.6), 12
"""Short arm over long arm, and angles that are tried, evenly over a turn; what is found is refined between them."""


@effects.add("counterbalance")
class Counterbalance(Effect):
    """A counterbalance whose pull twists the joint that it relieves.

    A gas spring or cylinder of constant force between a point on the link before the joint and one on the link behind it
    pushes or pulls, and its moment twists the gear. Settings: ``angle`` (rad) of the joint where both points lie on one side
    in line with the axis, ``ratio`` of the shorter arm to the longer one. A spring that is drawn out in proportion pulls as the
    sine of the angle alone, ``ratio`` 0, which is the same function as ``encoder-eccentricity``.
    """

    slug = "counterbalance"
    setting_ranges = ranges({"angle": ANY, "ratio": NOT_NEGATIVE})
    title = "Counterbalance that twists its joint"
    sentence = "The counterbalance at {0} twists the joint: its moment changes with the joint's angle."
    formula = "dq = c sin(q - angle) / sqrt(1 + ratio^2 - 2 ratio cos(q - angle))"
    size = "the moment of tens to thousands of N*m over a joint's stiffness: 1e-5 to 1e-3 rad"
    look_alikes = ("encoder-eccentricity", "joint-compliance", "transmission-error")
    experiment = "vent the cylinder, or unhook the spring, and repeat the same poses"
    source = "law of cosines for a strut between two links; pull of gas springs as good as constant over their stroke"
    commonness = 0.3  # mostly the second joint of larger arms has one
    continuous = ("angle", "ratio")

    def places(self, machine: Machine) -> Sequence[Place]:
        turning = (a for a in machine.mechanism.actuators if a.unit == "rad")
        return singly(a.reading for a in turning)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return [{"angle": 2 * pi * k / ANGLES, "ratio": ratio} for ratio in RATIOS for k in range(ANGLES)]

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("c", joint_unit(machine, place), LARGEST),)

    def driver_kind(self, machine: Machine, place: Place, settings: Settings) -> DriverKind:
        """Its pull depends on where the joint stands."""
        return "position"

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        ratio = site.settings.get("ratio", RATIOS[0])
        turn = site.moved(actuator.reading) - site.settings.get("angle", 0.0)
        length = ca.sqrt(1.0 + ratio**2 - 2.0 * ratio * ca.cos(turn))
        return {actuator.displacement: site.c["c"] * ca.sin(turn) / length}
