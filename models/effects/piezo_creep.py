"""Piezoelectric actuators without a position loop go on moving after a step, ever more slowly."""

from __future__ import annotations

from collections.abc import Sequence
from math import log10

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import actuator_at, nominal_gain, piezo_like, singly
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NOT_NEGATIVE, POSITIVE, ranges

T0 = 0.1
WAIT = 2.0
"""s that a machine usually waits before it is read; from 1 to 4 is nearly the same function."""
SINCE = (0.0, *(10.0 ** (k / 2) for k in range(9)))
"""s: whoever calibrates a gain reads at once, or lets it settle for up to some hours."""


@effects.add("piezo-creep")
class PiezoCreep(Effect):
    """Every past move goes on by g times itself for each decade of time since ``t0`` after it.

    A move counts as ended ``dwell`` s before the row it leads to. Setting ``since``: s after a move at which the
    stated gain is right, as whoever calibrated it waited so long (else right away: what creeps until then counts).
    Looked for where ``piezo-hysteresis`` is.
    """

    slug = "piezo-creep"
    setting_ranges = ranges({"since": NOT_NEGATIVE, "t0": POSITIVE, "dwell": NOT_NEGATIVE})
    title = "Creep of a piezo actuator"
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

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return ({"t0": T0}, *({"t0": T0, "dwell": WAIT, "since": since} for since in SINCE))

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return f"The piezo of {place[0]} creeps: after every move it goes on with the logarithm of time."
