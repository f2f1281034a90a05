"""A fleet made up, for what is said and shown of it."""

from __future__ import annotations

from dataclasses import replace

from truepose.identification.leaves.fleet.odd import Oddness, Reason
from truepose.identification.leaves.fleet.page import fleet_document
from truepose.identification.leaves.fleet.record import Change, Changes, Moved, Record
from truepose.identification.leaves.fleet.statistics import (
    ConstantInFleet,
    EffectInFleet,
    FleetStatistics,
    Interval,
    ToleranceInFleet,
)
from truepose.identification.leaves.fleet.table import Fleet, fleet_table
from truepose.shown.html import page

HOSTILE = '<script>alert("1")</script>&'
SEEN = EffectInFleet(
    "serial", "backlash", (), 100, Interval(0.4, 0.3, 0.5), 0.05, 40.0, 12.0,
    Interval(0.1, 0.08, 0.12), 1.5, Interval(1e-4, 8e-5, 1.2e-4), "rad",
)  # fmt: skip
RARE = replace(SEEN, effect="drift", frequency=Interval(0.01, 0.0, 0.03), found=0.6, size=None, amount=None)
STATISTICS = FleetStatistics(
    100,
    (SEEN, RARE),
    (replace(SEEN, place=("q2",)),),
    (ToleranceInFleet("serial", "angle q", 600, Interval(1.6, 1.4, 1.8), 0.0),),
    (ConstantInFleet("serial", "q2.r", 100, Interval(0.5, 0.3, 0.7), 1.0),),
)
FIGURES = {
    "machine": "arm", "check": "ok", "verdict": "missing-physics", "concealed": True, "chi2_before": 40.0,
    "chi2_after": 1.0, "reading": "position", "rms_before": 900.0, "rms_after": 15.0, "unit": "um", "held_out": True,
    "ratio": 0.02, "noise": 1.0, "findings": "backlash at q2",
}  # fmt: skip
DONE = Record(name=HOSTILE, key="", status="done", figures=FIGURES)
FAILED = Record(name="zz/..", key="", status="failed", why=f"zz/r.csv: missing column {HOSTILE!r}")
ODD = Oddness(
    4.2, True, (Reason("present", "backlash@q2", 0.0, "backlash at q2, which 0 of 99 others have"),)
)
CHANGES = Changes(
    new=(HOSTILE,),
    gone=("b",),
    said=(Change(HOSTILE, "verdict", "adequate", "missing-physics"),),
    moved=(Moved(HOSTILE, "q2.r", 0.3, 7.0),),
    compared=12,
    again=1,
    limit=3.0,
)


def fleet() -> Fleet:
    return Fleet(HOSTILE, fleet_table([DONE, FAILED], [ODD]), STATISTICS, CHANGES)


def fleet_html(found: Fleet) -> str:
    """The page of a result."""
    return page(fleet_document(found))
