"""A base or a tool that creeps away in the course of the campaign."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import SECONDS_PER_HOUR, clock, singly, twist_coefficients
from truepose.models.file.driver import ROW, TIME
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.machine.placed import COLUMN, DURATION, ranges

ROWS = "rows"
"""Setting of a drift in the order of rows: how many follow the first of the longest session."""
FRACTIONS = (0.08, 0.15, 0.3, 0.6, 1.2)
"""Time constants to try, in spans of the campaign: neighbours differ by a factor of two, which data hardly tell apart."""


@effects.add("mount-drift")
class MountDrift(Effect):
    """A small motion of the mount that grows with time since ``start`` (s on the recording's clock).

    ``tau`` 0: at a constant rate, per hour. ``tau`` > 0 (s): settling, 1 - exp(-t / tau) of its end, and still before. Without
    a clock it grows with the order of rows in each session, setting ``rows``: how many follow the first of the longest. The
    motion is then that up to its last row, and ``tau`` counts in rows.
    """

    slug = "mount-drift"
    setting_ranges = ranges({"rows": DURATION, "tau": DURATION, "start": COLUMN})
    title = "Drifting mount"
    counted = True
    formula = "twist (t - start) / 1 h, or twist (1 - exp(-(t - start) / tau)), t in rows where no clock was recorded"
    size = "0.1 to 10 um/h in a quiet laboratory; more while a machine warms up"
    look_alikes = ("thermal-expansion", "frame-shift", "zero-shift", "piezo-creep")
    experiment = "repeat one reference pose throughout the campaign, in a shuffled order of the others"
    source = "repeated reference poses, the usual drift check of laser tracker and photogrammetry campaigns"

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(machine.standing)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        whole = ROWS in settings or settings.get("tau", 0.0)
        return twist_coefficients(mm=1.0, rad=5e-3, per="" if whole else "/h")

    def shifts(self, site: Site) -> Shifts:
        rows, tau = site.settings.get(ROWS, 0.0), site.settings.get("tau", 0.0)
        elapsed = site.driver(ROW) + rows if rows else site.driver(TIME) - site.settings.get("start", 0.0)
        steady = elapsed / (rows or SECONDS_PER_HOUR)
        growth = 1 - ca.exp(-ca.fmax(0, elapsed) / tau) if tau else steady
        return {f"{site.place[0]}.motion.{axis}": site.c[axis] * growth for axis in AXES}

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return (ROW if ROWS in settings else TIME,)

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """A constant rate, and time constants inside the campaign, from its start; in rows where there is no clock."""
        span, order = clock(recording), recording.driver(ROW)
        if span is None and order is not None:
            rows = -float(np.min(np.asarray(order, dtype=float)))
            return [{"tau": tau, ROWS: rows} for tau in _taus(rows)] if rows > 0.0 else []
        if span is None or span[1] <= span[0]:
            return ({"tau": 0.0, "start": 0.0},)
        return [{"tau": tau, "start": span[0]} for tau in _taus(span[1] - span[0])]

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        said = {"base": "The base creeps under the robot", "tool": "The tool creeps in its mount"}
        what = said.get(place[0], f"The frame {place[0]} creeps on what carries it")
        return f"{what} in the course of the campaign."


def _taus(length: float) -> list[float]:
    """No settling, and time constants of a campaign of this length (s, or rows)."""
    return [0.0, *(float(f"{fraction * length:.2g}") for fraction in FRACTIONS)]
