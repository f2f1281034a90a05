"""Piezoelectric actuators without a position loop: hysteresis and creep."""

from __future__ import annotations

from collections.abc import Sequence
from math import log10

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import (
    actuator_at,
    approaches,
    nominal_gain,
    overshoot_of,
    singly,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Actuator
from truepose.models.machine.placed import NOT_NEGATIVE, POSITIVE, ranges

PIEZO_RANGE = {"mm": 5.0, "rad": 0.2}
"""Longest whole range of an actuator that may be a piezo."""
THRESHOLDS = (0.05, 0.15, 0.3, 0.6)
"""Half widths of the operators as parts of half the range."""


@effects.add("piezo-hysteresis")
class PiezoHysteresis(Effect):
    """Piezoelectric actuators without a position loop: where they stand depends on where they turned round.

    A Prandtl-Ishlinskii operator of four thresholds, less the straight line of a full loop.

    A piezo's gain is stated so that a full loop is right on average; what is left is the loop. Looked for at
    joints of at most 5 mm or 0.2 rad that no screw drives; a user may state it at any joint.
    Setting ``overshoot``: the part of the range by which a joint starts behind its goal to arrive from a
    stated side, without it far enough.
    """

    slug = "piezo-hysteresis"
    setting_ranges = ranges({"overshoot": NOT_NEGATIVE})
    title = "Hysteresis of a piezo actuator"
    sentence = "The piezo of {0} has hysteresis: where it stands depends on where it last turned round."
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


def _loop(actuator: Actuator, threshold: float) -> str:
    low, high = actuator.range or (-0.5, 0.5)
    return f"loop.{actuator.reading}~{threshold * (high - low) / 2:.6g}~{low:.6g}~{high:.6g}"


T0 = 0.1
WAIT = 2.0
"""s that a machine usually waits before it is read; from 1 to 4 is nearly the same function."""
SINCE = (0.0, *(10.0 ** (k / 2) for k in range(9)))
"""s: whoever calibrates a gain reads at once, or lets it settle for up to some hours."""


@effects.add("piezo-creep")
class PiezoCreep(Effect):
    """Piezoelectric actuators without a position loop go on moving after a step, ever more slowly.

    Every past move goes on by g times itself for each decade of time since ``t0`` after it.

    A move counts as ended ``dwell`` s before the row it leads to. Setting ``since``: s after a move at which the
    stated gain is right, as whoever calibrated it waited so long (else right away: what creeps until then counts).
    Looked for where ``piezo-hysteresis`` is.
    """

    slug = "piezo-creep"
    setting_ranges = ranges({"since": NOT_NEGATIVE, "t0": POSITIVE, "dwell": NOT_NEGATIVE})
    title = "Creep of a piezo actuator"
    sentence = "The piezo of {0} creeps: after every move it goes on with the logarithm of time."
    forms = ({"t0": T0}, *({"t0": T0, "dwell": WAIT, "since": since} for since in SINCE))
    formula = (
        "dq = g sum over past moves of step log10(1 + age / t0), t0 = 0.1 s; where the gain is right later, "
        "step log10((t0 + age) / (t0 + since))"
    )
    size = "g = 0.01 to 0.02: 1 to 2 % of a move for each decade of time"
    look_alikes = ("piezo-hysteresis", "friction-hysteresis", "mount-drift", "actuator-scale")
    experiment = "one large step, then read the same pose after 1, 10, 100 and 1000 s"
    source = (
        "Physik Instrumente's piezo tutorial: dL(t) = dL (1 + g lg(t / 0.1 s)), of the order of 1 % to 2 %"
    )

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.mechanism.readings)

    def screened(self, machine: Machine, place: Place) -> bool:
        return piezo_like(actuator_at(machine, place[0]))

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("g", "1", 0.05, lower=0.0),)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        (driver,) = self.drivers(site.machine, site.place, site.settings)
        known = log10(1 + site.settings.get("since", 0.0) / site.settings.get("t0", T0))
        past = site.driver(driver) - known * site.q[actuator.reading]
        return {actuator.displacement: site.c["g"] * nominal_gain(site.machine, actuator) * past}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        dwell = settings.get("dwell", 0.0)
        name = f"creep.{actuator_at(machine, place[0]).reading}~{settings.get('t0', T0):g}"
        return (f"{name}~{dwell:g}" if dwell else name,)


def piezo_like(actuator: Actuator) -> bool:
    """Whether an actuator may be a piezo: no screw, and a small range."""
    if actuator.range is None or actuator.screw_pitch:
        return False
    low, high = actuator.range
    return actuator.reading_unit != "turn" and high - low <= PIEZO_RANGE[actuator.unit]
