"""What is put into each golden case: machine of the examination, seed, plan, imperfections or decoys.

Add a case: an entry here or, of many effects, in ``rich.py``, ``make.py`` with its name, the test with ``--update-golden``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import groupby

from challenge.simulator.base import Plan


@dataclass(frozen=True)
class PutIn:
    """An imperfection of the simulator; ``size`` counts in what a shop would call usual."""

    kind: str
    place: tuple[str, ...]
    size: float


@dataclass(frozen=True)
class Case:
    """A golden case. ``noise`` and ``tolerance``: true over stated; ``tails``: as ``challenge.nulls``.

    withheld: columns that were not logged, by name or by what stands before the dot. split: a file for each session.
    """

    name: str
    machine: str
    seed: int
    why: str
    put_in: tuple[PutIn, ...] = ()
    plan: Plan = field(default_factory=Plan)
    noise: float = 1.0
    tolerance: float = 1.0
    tails: str = ""
    withheld: tuple[str, ...] = ()
    split: bool = False

    @property
    def told(self) -> str:
        """What was put in, in words."""
        said = [_words(kind, tuple(same)) for kind, same in groupby(self.put_in, key=lambda p: p.kind)]
        said += [f"noise {self.noise:g} times the stated"] if self.noise != 1.0 else []
        said += [f"tolerances {self.tolerance:g} times the stated"] if self.tolerance != 1.0 else []
        said += [f"noise with {_TAILS[self.tails]}"] if self.tails else []
        said += [f"without {', '.join(self.withheld)}"] if self.withheld else []
        return "; ".join(said) or "nothing"


def _words(kind: str, same: tuple[PutIn, ...]) -> str:
    """What one kind does at its places."""
    places = ", ".join(" and ".join(p.place) for p in same)
    return f"{kind} at {places}{':' if len(same) > 1 else ','} {', '.join(f'{p.size:g}' for p in same)} times the usual"


_TAILS = {"t": "heavy tails (Student's t, 4 degrees of freedom)", "outliers": "2 % far rows"}


def _plan(poses: int, *, sessions: int = 1, held_out: float = 0.0, moving: bool = False) -> Plan:
    """Each pose twice, from both sides, under several loads in a warming room."""
    return Plan(poses=poses, sessions=sessions, held_out=held_out, moving=moving)


def _at(kind: str, place: str, size: float) -> PutIn:
    return PutIn(kind, tuple(place.split("+")), size)


_OTHER_LEGS = ("leg1", "leg2", "leg4", "leg5", "leg6")

CASES = (
    Case("telescope-clean", "telescope", 1, "clean, with validation rows", plan=_plan(20, held_out=0.2)),
    Case("targets-clean", "telescope-targets", 1, "clean, many readings a row", plan=_plan(14, held_out=0.2)),
    Case(
        "telescope-tolerances",
        "telescope",
        33,
        "a drawing that promises too much is no missing physics",
        plan=_plan(18),
        tolerance=3.5,
    ),
    Case("stewart-noise", "stewart", 31, "a misstated sigma is none either", plan=_plan(18), noise=2.2),
    Case("arm-quiet", "arm", 32, "a sigma stated too large", plan=_plan(18, sessions=2), noise=0.5),
    Case(
        "arm-targets-tails",
        "arm-targets",
        36,
        "heavy tails are no physics",
        plan=_plan(18, sessions=2),
        tails="t",
    ),
    Case(
        "nanopositioner-fringes",
        "nanopositioner",
        40,
        "rows that counted a fringe too many",
        (_at("fringe-miscount", "rows", 1.0),),
        _plan(24),
    ),
    Case(
        "arm-outliers",
        "arm",
        62,
        "far rows near the limit beyond which they are outliers: rows are told, and no physics",
        (_at("outliers", "rows", 0.3),),
        _plan(24),
    ),
    Case(
        "targets-outliers",
        "telescope-targets",
        39,
        "outliers that are many for so few rows: no physics",
        (_at("outliers", "rows", 0.3),),
        _plan(18),
    ),
    Case(
        "stewart-backlash",
        "stewart",
        2,
        "backlash, or friction",
        (_at("backlash", "rho2", 1.0),),
        _plan(20),
    ),
    Case(
        "telescope-backlash",
        "telescope",
        1010,
        "backlash that is small, or what looks like it",
        (_at("backlash", "rho6", 0.41),),
        _plan(18),
    ),
    Case(
        "nanopositioner-backlash",
        "nanopositioner",
        1004,
        "backlash that is certain",
        (_at("backlash", "q2", 0.87),),
        _plan(24, held_out=0.2),
    ),
    Case(
        "telescope-platform",
        "telescope",
        2,
        "geometry swallows the effect",
        (_at("platform-deformation", "platform", 1.0),),
        _plan(20),
    ),
    Case(
        "arm-heat",
        "arm",
        2,
        "heat, its lag uncertain",
        (_at("thermal-expansion", "link2", 1.0),),
        _plan(24),
    ),
    Case(
        "nanopositioner-creep",
        "nanopositioner",
        2,
        "creep of a piezo, which geometry swallows in part",
        (_at("piezo-creep", "q1", 1.0),),
        _plan(24),
    ),
    Case(
        "polisher-runout",
        "polisher",
        2,
        "run-out of a pin, or what looks like it at its cross: undecided",
        (_at("joint-runout", "u1a", 1.0),),
        _plan(18),
    ),
    Case(
        "arm-latency",
        "arm",
        1018,
        "read on the move",
        (_at("latency", "sensor", 0.34),),
        _plan(18, moving=True),
    ),
    Case(
        "arm-frame",
        "arm",
        1014,
        "a tool that moved between sessions, or drifts: undecided",
        (_at("frame-shift", "tool", 0.44),),
        _plan(18, sessions=2),
    ),
    Case(
        "arm-targets-compliance",
        "arm-targets",
        1011,
        "a joint that gives way",
        (_at("joint-compliance", "q2", 0.34),),
        _plan(18, sessions=2, held_out=0.2),
    ),
    Case(
        "stewart-two",
        "stewart",
        41,
        "two effects, both found",
        (_at("backlash", "rho3", 1.0), _at("thermal-expansion", "leg5", 1.5)),
        _plan(20),
    ),
    Case(
        "stewart-swallowed",
        "stewart",
        43,
        "two effects, which geometry swallows in part: both are told",
        (_at("sensor-scale", "sensor", 0.7), _at("leg-compliance", "leg2", 1.0)),
        _plan(20, held_out=0.2),
    ),
    Case(
        "telescope-outside",
        "telescope",
        1012,
        "outside the library: its leg is told, and at most a name that is close",
        (_at("flexure-buckles", "leg5", 0.78),),
        _plan(18),
    ),
    Case(
        "nanopositioner-outside",
        "nanopositioner",
        1017,
        "outside the library: only the alarms tell",
        (_at("clamp-slips", "q2", 0.6),),
        _plan(24, sessions=2, held_out=0.2),
    ),
    Case(
        "arm-outside",
        "arm",
        1016,
        "outside the library: misfit without structure",
        (_at("rocking-base", "base", 0.36),),
        _plan(18),
    ),
    Case(
        "arm-targets-outside",
        "arm-targets",
        1009,
        "outside the library, and one name fits it well",
        (_at("slipping-clamp", "link4", 0.31),),
        _plan(18),
    ),
    Case(
        "stewart-small",
        "stewart",
        42,
        "a drift too small to tell",
        (_at("mount-drift", "base", 0.5),),
        _plan(18),
    ),
    Case(
        "stewart-short",
        "stewart",
        2001,
        "heat of a leg, near the threshold",
        (_at("thermal-expansion", "leg2", 0.29),),
        _plan(18),
    ),
    Case(
        "targets-small",
        "telescope-targets",
        1001,
        "heat of the platform, too small to tell",
        (_at("thermal-expansion", "platform", 0.74),),
        _plan(18, held_out=0.2),
    ),
    Case(
        "arm-two",
        "arm",
        47,
        "two effects, one of them far larger",
        (_at("joint-compliance", "q2", 0.5), _at("zero-shift", "q4", 1.5)),
        _plan(20, sessions=2, held_out=0.2),
    ),
    Case(
        "nanopositioner-two",
        "nanopositioner",
        48,
        "two effects, both found",
        (_at("piezo-creep", "q1", 1.0), _at("backlash", "q2", 1.5)),
        _plan(24, held_out=0.2),
    ),
    Case(
        "telescope-two",
        "telescope",
        49,
        "two effects, one of which geometry swallows",
        (_at("platform-deformation", "platform", 1.0), _at("backlash", "rho2", 1.0)),
        _plan(20),
    ),
    Case(
        "stewart-sessions",
        "stewart",
        51,
        "a frame that moved between sessions: which, or a drift, is undecided",
        (_at("frame-shift", "base", 0.3),),
        _plan(18, sessions=2, held_out=0.2),
    ),
    Case(
        "stewart-files",
        "stewart",
        51,
        "the same in two files without clock and session: each file is a session",
        (_at("frame-shift", "base", 0.3),),
        _plan(18, sessions=2, held_out=0.2),
        withheld=("session", "time"),
        split=True,
    ),
    Case(
        "telescope-no-thermometer",
        "telescope",
        52,
        "heat that no thermometer saw",
        (_at("thermal-expansion", "leg3", 1.0),),
        _plan(18, held_out=0.2),
        withheld=("temperature",),
    ),
    Case(
        "telescope-constant",
        "telescope",
        55,
        "a conflict with tolerances alone, too little for a name",
        (_at("wrong-constant", "leg2.b.x", 0.8),),
        _plan(18, held_out=0.2),
    ),
    Case(
        "arm-gear",
        "arm",
        54,
        "a gear's error, which the wobble of an axis looks like",
        (_at("transmission-error", "q2", 1.0),),
        _plan(20, held_out=0.2),
    ),
    Case(
        "polisher-leg",
        "polisher",
        56,
        "a leg that gives way under load",
        (_at("leg-compliance", "leg2", 1.5),),
        _plan(10, held_out=0.2),
    ),
    Case(
        "stewart-floor",
        "stewart",
        46,
        "outside the library: a mount sways in time",
        (_at("swaying-floor", "base", 1.0),),
        _plan(18, held_out=0.2),
    ),
    Case(
        "stewart-screw",
        "stewart",
        53,
        "an alarm without a name",
        (_at("screw-periodic", "rho4", 1.0),),
        _plan(20, held_out=0.2),
    ),
    Case(
        "stewart-one-thermometer",
        "stewart",
        71,
        "one leg's thermometer serves all of them",
        (_at("thermal-expansion", "leg3", 1.0),),
        _plan(18),
        withheld=tuple(f"temperature.{part}" for part in (*_OTHER_LEGS, "base", "platform")),
    ),
    Case(
        "stewart-lens",
        "stewart",
        702,
        "two effects, and a scale or something like a lens: undecided",
        (_at("sensor-scale", "sensor", 1.5), _at("backlash", "rho6", 0.8)),
        _plan(18, held_out=0.2),
    ),
)
