"""Machines as real ones are: 5 to 12 effects at once, some at all their places under a like size (families)."""

from __future__ import annotations

from challenge.simulator.base import Plan
from golden_diagnoses.cases import Case, PutIn


def _at(kind: str, places: str, *sizes: float) -> tuple[PutIn, ...]:
    """One kind at one place or several, with a size for each."""
    return tuple(PutIn(kind, (place,), size) for place, size in zip(places.split(), sizes, strict=True))


RICH = (
    Case(
        "arm-joints-yield",
        "arm",
        801,
        "a family: every joint gives way; other effects beside it",
        (
            *_at("joint-compliance", "q2 q3 q4 q5", 0.5, 0.6, 0.9, 0.7),
            *_at("backlash", "q1", 2.0),
            *_at("thermal-expansion", "link2", 2.0),
            *_at("gravity-sag", "base", 1.0),
        ),
        Plan(poses=20, held_out=0.0),
    ),
    Case(
        "arm-play",
        "arm",
        803,
        "backlash at all joints, and more",
        (
            *_at("backlash", "q1 q2 q3 q4 q5 q6", 1.0, 1.5, 0.8, 2.0, 1.2, 2.5),
            *_at("joint-compliance", "q3", 0.6),
            *_at("gravity-sag", "base", 1.0),
        ),
        Plan(poses=24, held_out=0.0),
    ),
    Case(
        "arm-gears",
        "arm",
        812,
        "every gear has its waves; a joint that gives way and play beside them",
        (
            *_at("transmission-error", "q1 q2 q3 q4 q5 q6", 1.5, 2.0, 1.2, 2.0, 1.6, 2.0),
            *_at("joint-compliance", "q2", 1.0),
            *_at("backlash", "q1", 1.0),
        ),
        Plan(poses=24, held_out=0.0),
    ),
    Case(
        "stewart-screws",
        "stewart",
        804,
        "a family: every screw has its waves; play and heat of single legs beside it",
        (
            *_at("screw-periodic", "rho1 rho2 rho3 rho4 rho5 rho6", 1.0, 1.6, 1.2, 0.8, 2.0, 1.3),
            *_at("backlash", "rho2", 1.0),
            *_at("thermal-expansion", "leg5", 2.0),
        ),
        Plan(poses=20, held_out=0.0),
    ),
    Case(
        "telescope-legs",
        "telescope",
        806,
        "a family: every leg gives way; play of two screws beside it",
        (
            *_at("leg-compliance", "leg1 leg2 leg3 leg4 leg5 leg6", 1.0, 1.4, 0.8, 1.7, 1.2, 1.0),
            *_at("backlash", "rho1", 1.5),
            *_at("backlash", "rho4", 0.8),
            *_at("thermal-expansion", "leg2", 2.0),
        ),
        Plan(poses=20, held_out=0.0),
    ),
    Case(
        "nanopositioner-rich",
        "nanopositioner",
        807,
        "five effects of a small machine: both piezos lag, one creeps, the slide has play, a disc is off its centre",
        (
            *_at("piezo-hysteresis", "q1 q3", 1.0, 0.7),
            *_at("piezo-creep", "q3", 1.5),
            *_at("backlash", "q2", 1.0),
            *_at("encoder-eccentricity", "q6", 2.0),
        ),
        Plan(poses=16, held_out=0.0),
    ),
    Case(
        "stewart-heat",
        "stewart",
        810,
        "a family: all parts warm together; play and a leg that gives way beside it",
        (
            *_at(
                "thermal-expansion",
                "leg1 leg2 leg3 leg4 leg5 leg6 base platform",
                1.0,
                1.6,
                1.2,
                0.8,
                2.0,
                1.3,
                2.0,
                1.5,
            ),
            *_at("backlash", "rho4", 1.0),
            *_at("leg-compliance", "leg1", 1.5),
        ),
        Plan(poses=18, held_out=0.0),
    ),
    Case(
        "telescope-sessions",
        "telescope",
        811,
        "a family: all zeros shift between sessions, and a mount; a drift and play beside it",
        (
            *_at("zero-shift", "rho1 rho2 rho3 rho4 rho5 rho6", 1.0, 1.6, 0.8, 2.0, 1.2, 0.7),
            *_at("frame-shift", "base", 1.0),
            *_at("mount-drift", "tool", 2.0),
            *_at("backlash", "rho5", 1.0),
        ),
        Plan(poses=18, held_out=0.0, sessions=2),
    ),
    Case(
        "polisher-worn",
        "polisher",
        808,
        "play at all six drives and more; outliers, a sigma and tolerances that are misstated",
        (
            *_at("backlash", "q1 q2 q3", 1.0, 1.5, 0.8),
            *_at("backlash-of-wrist", "q4 q5 q6", 1.2, 2.0, 0.9),
            *_at("transmission-error", "q5", 2.0),
            *_at("leg-compliance", "leg2", 1.5),
            *_at("outliers", "rows", 0.5),
        ),
        Plan(poses=18, held_out=0.0),
        noise=0.8,
        tolerance=1.4,
    ),
    Case(
        "mujoco-worn",
        "mujoco-ur5e",
        809,
        "two simulators: MuJoCo's springs, play and friction, and waves of gears and a disc computed here",
        (
            *_at("joint-compliance", "q2 q3 q4", 1.0, 0.7, 1.5),
            *_at("backlash", "q1 q2 q4", 1.0, 0.7, 1.5),
            *_at("friction-hysteresis", "q3", 2.0),
            *_at("transmission-error", "q1 q3 q5", 1.0, 1.5, 2.0),
            *_at("encoder-eccentricity", "q1", 1.5),
        ),
        Plan(poses=24, held_out=0.0),
    ),
)
"""Those of a machine ``mujoco-...`` need MuJoCo to be made."""
