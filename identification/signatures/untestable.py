"""What could not be tested, and why; and what a machine likely has that a recording cannot show, with what would show it.

Nothing is fitted: only what the machine file states and which columns were logged decides. ``catalogue`` tells of every
effect why it could not be tested; the few that most machines have are told with the line or column to add.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.constants import g

from truepose.arrays import Array
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import Effect, PlacedEffect, effects
from truepose.models.effects.empirical import travel_of
from truepose.models.effects.sights import is_thermometer
from truepose.models.file import driver as drivers
from truepose.models.file.driver import Driver
from truepose.models.machine.machine import Machine

GRAVITY = (0.0, 0.0, -g)
"""What weight pulls with where the base stands upright, m/s^2."""
GRAVITY_LINE = f"gravity: [0, 0, -{g}]"
HEAT, PLAY, DRIFT, FLEXURE = "thermal-expansion", "backlash", "mount-drift", "axis-flexure"
STEPS, LEAST_TRAVEL = 20.0, 1e-3
"""Smallest variation that anything may be a function of: steps of a thermometer's last digit, share of a joint's range."""
SET = 3.0
"""Steps between all neighbouring values of a thermometer from which on they are levels that were set: 20, 26 and 32 degC."""
RARE = frozenset({"screw-windup"})
"""Effects of weight that few machines have."""


@dataclass(frozen=True)
class Untestable:
    """An effect whose driver the recording lacks, and which."""

    effect: str
    why: str


@dataclass(frozen=True)
class Missing:
    """Effects that could not be tested, why, and what would make them testable: a line of the machine file or a column.

    ``what``: the combination of them that could not be, where one alone can be tested.
    """

    effects: tuple[str, ...]
    why: str
    add: str
    what: str = ""


def missing_inputs(machine: Machine, recording: Recording) -> tuple[Missing, ...]:
    """What is missing, likeliest effects first; empty where nothing is."""
    return (*missing_length(machine), *_of_weight(machine, recording), *_of_columns(machine, recording))


def with_assumed_gravity(machine: Machine) -> Machine:
    """The machine standing upright, where nobody said which way gravity pulls."""
    return machine if machine.gravity is not None else replace(machine, gravity=GRAVITY)


def missing_length(machine: Machine) -> list[Missing]:
    """Return the common scale of all lengths, where nothing measures a length."""
    slides = [a.reading for a in machine.mechanism.actuators if a.unit == "mm"]
    has_lengths = slides or any(p.unit == "mm" and p.tolerance > 0.0 for p in machine.parameters)
    if not has_lengths or any(sensor.measures_length for sensor in machine.sensors):
        return []
    what = ("actuator-scale", f" of {', '.join(slides)} and") if slides else ("wrong-constant", " of")
    why = f"no sensor measures a length, so a common scale{what[1]} all lengths changes no reading"
    sockets = any(sensor.type == "socket" for sensor in machine.sensors)
    add = f"{'state the distance between sockets (`spacing`), or ' if sockets else ''}measure one length"
    return [Missing((what[0],), why, add, what="a common scale")]


def _of_weight(machine: Machine, recording: Recording) -> list[Missing]:
    """Effects of weight, where the file says too little of it."""
    file = machine.file.path.name if machine.file else "the machine file"
    heavy = with_assumed_gravity(machine)
    kinds = [effect for effect in every_effect() if effect.needs_load and effect.slug not in RARE]
    without = [e.slug for e in kinds if not _weighed(e, machine, recording)]
    by_gravity = [e.slug for e in kinds if e.slug in without and _weighed(e, heavy, recording)]
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


def _weighed(effect: Effect, machine: Machine, recording: Recording) -> bool:
    """Return whether an effect of weight has a form for it there: a computed load, or a measured one."""
    every = ((at, s) for at in places_of(effect, machine) for s in effect.settings(machine, at, recording))
    return any(effect.reads_load(s) or effect.drivers(machine, at, s) for at, s in every)


def _fits(slug: str, machine: Machine) -> bool:
    """Whether the mechanism has what the effect is of: legs are no links."""
    closed = bool(machine.mechanism.passive)
    own = {"leg-compliance": closed, "link-bending": not closed}.get(slug, True)
    return own and of_such_machines(slug, machine)


def of_such_machines(slug: str, machine: Machine) -> bool:
    """Whether an effect is of machines of this kind at all: what bends telescopes is asked of those that point at something."""
    return slug != FLEXURE or any(sensor.type == "direction" for sensor in machine.sensors)


def _of_columns(machine: Machine, recording: Recording) -> list[Missing]:
    """Effects whose drivers nobody logged."""
    out = []
    heated, joints, mounts = (
        [place[0] for place in places_of(effects.get(slug, "untestable")(), machine)]
        for slug in (HEAT, PLAY, DRIFT)
    )
    if heated and not any(is_thermometer(machine, name) for name in recording.drivers):
        add = f"log `{drivers.TEMPERATURE}.air` or `{drivers.TEMPERATURE}.{heated[0]}`"
        out.append(Missing((HEAT,), "no temperature column", f"{add}; a thermometer elsewhere does, too"))
    if joints and all(recording.driver(f"{drivers.APPROACH}.{joint}") is None for joint in joints):
        add = (
            f"log `{drivers.APPROACH}.{joints[0]}`, ... (+1 or -1: the direction of the joint's last motion)"
        )
        out.append(Missing((PLAY,), f"no {drivers.APPROACH} column, and the rows are declared shuffled", add))
    if mounts and recording.driver(drivers.TIME) is None and recording.driver(drivers.ROW) is None:
        why = f"no {drivers.TIME} column, and the rows are declared shuffled"
        out.append(Missing((DRIFT,), why, f"log `{drivers.TIME}` (s)"))
    return out


def still_sources(machine: Machine, recording: Recording) -> frozenset[str]:
    """Return the joints and thermometers that hardly vary in the calibration rows: nothing can be a function of them.

    A joint moves by less than ``LEAST_TRAVEL`` of its range, or a thermometer by less than ``STEPS`` of its last digit.
    """
    rows = ~recording.validation
    joints = zip(recording.joints, recording.moved[rows].T, strict=True)
    still = {name for name, v in joints if np.ptp(v) < LEAST_TRAVEL * np.ptp(travel_of(machine, name))}
    measured = {name: v[rows] for name, v in recording.drivers.items() if Driver.of(name).thermal}
    return frozenset(still | {name for name, v in measured.items() if np.ptp(v) < STEPS * _resolution(v)})


def _resolution(values: Array) -> float:
    """Return the step of the last decimal digit that any of the values uses; 0 where all are levels that were set."""
    gaps = np.diff(np.unique(values))
    digits = (k for k in range(9) if np.allclose(values, np.round(values, k), rtol=0.0, atol=1e-9))
    step = next((10.0**-k for k in digits), 0.0)
    return 0.0 if gaps.size and np.min(gaps) >= SET * step - 1e-9 else step


def why_untestable(
    placed: PlacedEffect, recording: Recording, still: frozenset[str] = frozenset()
) -> str | None:
    """What the recording lacks for a candidate: a driver's column, or a driver that varies. None where nothing."""
    read = [Driver.of(name).now for name in placed.drivers]
    constant = next((d for d in read if d.thermal and d.served_by(recording.drivers) in still), None)
    if constant is not None:
        return f"{constant.served_by(recording.drivers)} hardly varies"
    for name in placed.drivers:
        values = recording.driver(name)
        if values is None:
            return _unknown(Driver.of(name), recording)
        if name != drivers.PAYLOAD and not np.any(values[~recording.validation]):
            return f"{name} never differs from zero"
    return None


def _unknown(driver: Driver, recording: Recording) -> str:
    """Why a recording has no values of a driver."""
    remembered = (*drivers.OF_THE_ORDER, *drivers.OF_THE_WAY, *drivers.OF_THE_CLOCK)
    untimed = driver.kind in drivers.OF_THE_CLOCK and recording.time is None
    if driver.place not in recording.joints or driver.kind not in remembered or untimed:
        return f"no {driver.column} column"
    told = f"no {driver.column} column, and " if driver.kind == drivers.APPROACH else ""
    return f"{told}the rows are declared shuffled"


def unloaded(machine: Machine) -> str:
    """Why no effect of weight can be tested, and the line that would change it."""
    if machine.gravity is None:
        return f"no `gravity:` in the machine file; add `{GRAVITY_LINE}` (m/s^2, in the base's frame)"
    if not machine.masses:
        return "no `masses:` in the machine file; state what links and tool weigh"
    return "its own elastic legs carry the weight"


def every_effect() -> list[Effect]:
    """All of the catalogue."""
    return [effects.get(slug, "catalogue")() for slug in effects]


def places_of(effect: Effect, machine: Machine) -> list[tuple[str, ...]]:
    """Where a machine may have an effect."""
    return [tuple(place) for place in effect.places(machine) if effect.screened(machine, tuple(place))]
