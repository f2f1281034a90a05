"""Piezoelectric actuators without a position loop: where they stand depends on where they turned round."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import (
    actuator_at,
    approaches,
    nominal_gain,
    overshoot_of,
    piezo_like,
    singly,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Actuator
from truepose.models.machine.placed import NOT_NEGATIVE, ranges

THRESHOLDS = (0.05, 0.15, 0.3, 0.6)
"""Half widths of the operators as parts of half the range."""


@effects.add("piezo-hysteresis")
class PiezoHysteresis(Effect):
    """A Prandtl-Ishlinskii operator of four thresholds, less the straight line of a full loop.

    A piezo's gain is stated so that a full loop is right on average; what is left is the loop. Looked for at
    joints of at most 5 mm or 0.2 rad that no screw drives; a user may state it at any joint.
    Setting ``overshoot``: the part of the range by which a joint starts behind its goal to arrive from a
    stated side, without it far enough.
    """

    slug = "piezo-hysteresis"
    setting_ranges = ranges({"overshoot": NOT_NEGATIVE})
    title = "Hysteresis of a piezo actuator"
    formula = (
        "dq = -sum w_i (s_i - l_i), s_i the stop operator of half width 5, 15, 30, 60 % of half the range, l_i the "
        "line that fits it best over a full loop, w_i >= 0"
    )
    size = "loops of 2 % of the travel for small moves to 10 to 15 % for large ones, open loop"
    look_alikes = ("friction-hysteresis", "backlash", "piezo-creep", "actuator-scale")
    experiment = (
        "nested loops of this joint alone, large then smaller and back; close the position loop and repeat"
    )
    source = "Physik Instrumente's piezo tutorial (size); Janocha and Kuhnen 2000 (operator, recalled)"

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(a.reading for a in machine.mechanism.actuators if a.range)

    def screened(self, machine: Machine, place: Place) -> bool:
        return piezo_like(actuator_at(machine, place[0]))

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(f"w{k}", "1", 0.3, lower=0.0) for k in range(1, len(THRESHOLDS) + 1))

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        loops = [site.driver(name) for name in self.drivers(site.machine, site.place, site.settings)]
        total = sum((w * loop for w, loop in zip(site.c.values(), loops, strict=True)), ca.SX(0))
        return {actuator.displacement: -nominal_gain(site.machine, actuator) * total}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        actuator = actuator_at(machine, place[0])
        return tuple(_loop(actuator, t) + overshoot_of(actuator, settings) for t in THRESHOLDS)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return approaches(machine, place, recording)

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return (
            f"The piezo of {place[0]} has hysteresis: where it stands depends on where it last turned round."
        )


def _loop(actuator: Actuator, threshold: float) -> str:
    low, high = actuator.range or (-0.5, 0.5)
    return f"loop.{actuator.reading}~{threshold * (high - low) / 2:.6g}~{low:.6g}~{high:.6g}"
