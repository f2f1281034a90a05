"""What a machine is likely to have and a recording cannot show, and the line or column that would make it testable.

Nothing is fitted: only what the machine file states and which columns were logged decides. ``catalogue`` tells of every
effect why it could not be tested; here stand the few that most machines have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from scipy.constants import g

from truepose.identification.recording.recording import Recording
from truepose.models.driver import APPROACH, TEMPERATURE, TIME
from truepose.models.effects.base import Effect, effects
from truepose.models.machine import Machine

GRAVITY = (0.0, 0.0, -g)
"""What weight pulls with where the base stands upright, m/s^2."""
GRAVITY_LINE = f"gravity: [0, 0, -{g}]"
HEAT, PLAY, DRIFT = "thermal-expansion", "backlash", "mount-drift"
RARE = frozenset({"screw-windup"})
"""Effects of weight that few machines have."""


@dataclass(frozen=True)
class Missing:
    """Effects that could not be tested, why, and what would make them testable: a line of the machine file or a column."""

    effects: tuple[str, ...]
    why: str
    add: str


def missing_inputs(machine: Machine, recording: Recording) -> tuple[Missing, ...]:
    """What is missing, likeliest effects first; empty where nothing is."""
    return (*_of_weight(machine), *_of_columns(machine, recording))


def _of_weight(machine: Machine) -> list[Missing]:
    """Effects of weight, where the file says too little of it."""
    file = machine.file.path.name if machine.file else "the machine file"
    heavy = replace(machine, gravity=machine.gravity or GRAVITY)
    kinds = [effect for effect in _catalogue() if effect.needs_load and effect.slug not in RARE]
    without = [e.slug for e in kinds if not _places(e, machine)]
    by_gravity = [e.slug for e in kinds if e.slug in without and _places(e, heavy)]
    by_masses = [slug for slug in without if slug not in by_gravity and _fits(slug, machine)]
    out = []
    if machine.gravity is None and by_gravity:
        out.append(Missing(tuple(by_gravity), f"no `gravity:` in {file}", f"add `{GRAVITY_LINE}`"))
    if not machine.masses and by_masses:
        weights = "`masses:` (kg, com and in: of links, platform, tool)"
        both = machine.gravity is None and not by_gravity
        lacks = "`gravity:` and no `masses:`" if both else "`masses:`"
        add = f"add `{GRAVITY_LINE}` and {weights}" if both else f"add {weights}"
        out.append(Missing(tuple(by_masses), f"no {lacks} in {file}", add))
    return out


def _fits(slug: str, machine: Machine) -> bool:
    """Whether the mechanism has what the effect is of: legs are no links."""
    closed = bool(machine.mechanism.passive)
    return {"leg-compliance": closed, "link-bending": not closed}.get(slug, True)


def _of_columns(machine: Machine, recording: Recording) -> list[Missing]:
    """Effects whose drivers nobody logged."""
    out = []
    heated = [place[0] for place in _places(effects.get(HEAT, "untestable")(), machine) if place]
    if heated and not any(recording.driver(f"{TEMPERATURE}.{place}") is not None for place in heated):
        out.append(
            Missing(
                (HEAT,), "no temperature column", f"log `{TEMPERATURE}.air` or `{TEMPERATURE}.{heated[0]}`"
            )
        )
    joints = [place[0] for place in _places(effects.get(PLAY, "untestable")(), machine) if place]
    if joints and all(recording.driver(f"{APPROACH}.{joint}") is None for joint in joints):
        add = f"log `{APPROACH}.{joints[0]}`, ... (+1 or -1: the direction of the joint's last motion)"
        out.append(Missing((PLAY,), f"no {APPROACH} column", add))
    if recording.driver(TIME) is None and _places(effects.get(DRIFT, "untestable")(), machine):
        out.append(Missing((DRIFT,), f"no {TIME} column", f"log `{TIME}` (s)"))
    return out


def _catalogue() -> list[Effect]:
    return [effects.get(slug, "untestable")() for slug in effects]


def _places(effect: Effect, machine: Machine) -> Sequence[tuple[str, ...]]:
    places = [tuple(place) for place in effect.places(machine)]
    return [place for place in places if effect.screened(machine, place)]


__all__ = ["GRAVITY", "Missing", "missing_inputs"]
