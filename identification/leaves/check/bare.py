"""Find what needs no fit: missing blocks, too few or repeated rows, joints that stand still or leave their range."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.arrays import Array, Index
from truepose.identification.fit.standing_out import FAR
from truepose.identification.leaves.check.pair import Stand
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.weighing import (
    USUAL_REACH,
    reach,
)
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.joint_readings import beyond
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.untestable import GRAVITY, GRAVITY_LINE
from truepose.models.machine.machine import Machine
from truepose.models.units import convert
from truepose.wording import joined, shortened

FEWEST = 6
STEEL, SMALLEST_PART = 7850.0, 300.0
"""Density of steel, kg/m^3, and the longest part (mm) that a small machine is taken to have at least."""
NEARER, FILLED = float(np.sqrt(1000.0)), 0.1
"""Geometric mean of a kilogram and a gram; share of the steel cube around a part that no single part fills."""
MOST, SMALL = 0.5, 1e-4
"""Share from which on something is most of a misfit; a small error of a joint, mm or rad."""
COARSE = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
"""Steps, in the file's unit, that a joint's readings are rounded to where a log has too few digits."""


def bare(machine: Machine, recording: Recording) -> Iterator[Found]:
    """All that needs no fit."""
    yield from _too_few(machine, recording)
    yield from _duplicates(recording)
    yield from _shared_columns(machine)
    yield from _still(machine, recording)
    yield from _no_gravity(machine)
    yield from _too_heavy(machine)


def _too_few(machine: Machine, recording: Recording) -> Iterator[Found]:
    free = sum(p.free for p in machine.parameters)
    used = int(np.sum(~recording.validation))
    readings = used * len(machine.channels)
    if readings < free:
        says = f"{used} rows are {readings} readings for {free} constants with a tolerance: a fit would look better than it is"
        fix = f"measure at least {int(np.ceil(2 * free / max(len(machine.channels), 1)))} poses, or state fewer tolerances"
        yield Found("too-few-rows", ("rows",), says, fix, "suspect")


def _duplicates(recording: Recording) -> Iterator[Found]:
    """Rows that repeat another one to the last digit: no instrument reads so."""
    same = repeats(recording)
    if len(same):
        rows = [str(recording.source_row[k]) for k in same]
        yield Found(
            "duplicated-rows",
            ("rows",),
            f"{len(same)} rows repeat an earlier one to the last digit: rows {shortened(rows, 5)}",
            "take them out: they count twice",
            "suspect",
            mend=lambda pair: pair.each(lambda s: s.rows(_firsts(s.cells.to_numpy(dtype=str)))),
        )


def _shared_columns(machine: Machine) -> Iterator[Found]:
    """Two sensors of a list that read one column: a fit adds up what all of them read."""
    read = [name for sensor in machine.sensors for name in sensor.columns]
    twice = sorted({name for name in read if read.count(name) > 1}, key=read.index)
    if twice:
        says = f"several sensors read {joined(twice)}: each of these readings counts twice"
        fix = "take one of the sensors out of the machine file's list"
        yield Found("duplicated-columns", tuple(twice), says, fix, "suspect")


def repeats(recording: Recording) -> Index:
    """Places of rows that repeat an earlier one in all that was logged; changes since a row itself do not count."""
    read, time = list(recording.observations.values()), recording.time
    if not read:
        return np.zeros(0, dtype=np.intp)
    seen = np.column_stack(
        [recording.q, *read, *recording.drivers.values(), *([] if time is None else [time])]
    )
    told = np.abs(np.column_stack(read)).max(axis=1) > 0
    return np.setdiff1d(np.flatnonzero(told), _firsts(seen))


def _firsts(cells: NDArray[np.generic]) -> Index:
    return np.sort(np.unique(cells, axis=0, return_index=True)[1])


def _still(machine: Machine, recording: Recording) -> Iterator[Found]:
    if len(recording) < FEWEST:
        return
    still = [n for n, v in zip(recording.joints, recording.q.T, strict=True) if np.ptp(v) == 0.0]
    if still:
        verb = "never moves" if len(still) == 1 else "never move"
        says = f"{joined(still)} {verb}: nothing can be said of its constants"
        fix = f"measure poses in which {joined(still)} moves, or take care not to read a result into its constants"
        yield Found("joint-never-moves", tuple(still), says, fix, "suspect")


def out_of_range(machine: Machine, recording: Recording) -> Iterator[Found]:
    """Joints that leave their range, where no slip is certain."""
    for a, q in zip(machine.mechanism.actuators, recording.q.T, strict=True):
        if a.reading_range is None:
            continue
        bad = np.flatnonzero(beyond(q, a.reading_range))
        if not len(bad):
            continue
        unit = machine.column_unit(a.reading)
        found, low, high = (convert(v, a.reading_unit, unit) for v in (float(q[bad[0]]), *a.reading_range))
        where = recording.where(int(bad[0]))
        says = f"{where}: {a.reading} is {found:.6g} {unit}, out of its range [{low:.6g}, {high:.6g}]"
        yield Found(
            "offset", (a.reading,), says, f"compare the zero, the unit and the range of {a.reading}", "wrong"
        )


def _no_gravity(machine: Machine) -> Iterator[Found]:
    if machine.gravity is None and machine.masses:
        yield Found(
            "no-gravity",
            ("gravity",),
            f"{len(machine.masses)} masses are stated and no gravity: what gives way under weight cannot be told",
            f"add '{GRAVITY_LINE}' (in the base frame) to the machine file",
            "suspect",
            mend=lambda pair: pair.with_field(("gravity",), list(GRAVITY)),
        )


def _too_heavy(machine: Machine) -> Iterator[Found]:
    """Yield a finding where one mass is out of proportion to all others, or the machine weighs more than a cube of steel.

    A mass is nearer to the others in grams than in kilograms if it is so many times (``NEARER``) the next one.
    """
    lengths = [abs(p.nominal) for p in machine.mechanism.parameters if p.unit == "mm"]
    travels = [np.ptp(a.range) for a in machine.mechanism.actuators if a.range and a.reading_unit == "mm"]
    longest = max([SMALLEST_PART, *lengths, *travels, *(abs(x) for m in machine.masses for x in m.com)])
    cube = STEEL * (longest / 1000.0) ** 3
    where: tuple[str, ...] = ("masses",)
    heavy = sorted((mass for mass in machine.masses if mass.kg > 0.0), key=lambda mass: -mass.kg)
    total = sum(mass.kg for mass in heavy)
    if len(heavy) > 2 and heavy[0].kg > max(NEARER * heavy[1].kg, FILLED * cube):
        where, kg = ("masses", heavy[0].name), heavy[0].kg
        says = f"{heavy[0].name} weighs {kg:.6g} kg, {kg / heavy[1].kg:.3g} times as much as any other mass"
    elif total > cube:
        kg, part = total, f"the longest part ({longest:.4g} mm)"
        says = f"the masses add up to {kg:.6g} kg; a solid steel cube as long as {part} weighs {cube:.3g} kg"
    else:
        return
    fix = f"state `kg` in kilograms: {'this mass' if len(where) > 1 else 'masses'} in grams would be {kg / 1000.0:.6g} kg"
    yield Found("mass-unit", where, says, fix, "suspect")


def coarse_joints(rig: Rig, stand: Stand) -> Iterator[Found]:
    """Yield joints that are logged in coarse steps while others are not, where rounding makes a misfit of that size.

    A joint that was commanded to whole degrees stands there, and the readings miss otherwise: by less, or along others.
    """
    if stand.bad:
        return
    machine, recording = rig.machine, rig.recording
    actuators = machine.mechanism.actuators
    units = [machine.column_unit(a.reading) for a in actuators]
    columns = zip(actuators, units, recording.q.T, strict=True)
    steps = [_step(convert(q, a.reading_unit, unit)) for a, unit, q in columns]
    for a, unit, step in zip(actuators, units, steps, strict=True):
        alike = [other for b, other in zip(actuators, steps, strict=True) if b.unit == a.unit]
        size = convert(step, unit, a.reading_unit)
        if step and min(alike) == 0.0 and _is_rounded(rig, stand, a.reading, size):
            says = f"all readings of {a.reading} are rounded to {step:g} {unit}, and those of other joints are not"
            fix = f"log {a.reading} with the resolution of its encoder: rounding hides what a fit looks for"
            yield Found("resolution", (a.reading,), says, fix, "suspect")


def _is_rounded(rig: Rig, stand: Stand, joint: str, step: float) -> bool:
    """Whether errors of one joint, row by row, explain most of a misfit that is as large as a ``step`` (mm, rad) makes it."""
    rows = rig.recording.subset(stand.rows)
    predictor, q = Predictor(rig.machine, rows, rig.machine.effects), rows.q.copy()
    q[:, rows.joints.index(joint)] += SMALL
    both = predictor, predictor.over(replace(rows, q=q))
    assembled = ((one, one.assemble(stand.p)[0]) for one in both)
    at, moved = (np.concatenate([b.residual for b in one.blocks(stand.p, x)]) for one, x in assembled)
    along = np.nan_to_num(moved - at) / SMALL
    rounding = step / np.sqrt(12.0) * float(np.sqrt(np.mean(along**2)))
    explained = np.sum(along * stand.residual, axis=1) ** 2 / np.maximum(np.sum(along**2, axis=1), 1e-300)
    share = float(np.sum(explained) / max(np.sum(stand.residual**2), 1e-300))
    return max(1.0, MOST * stand.misfit) < rounding < stand.misfit / MOST and share > MOST


def _step(values: Array) -> float:
    """Return the coarsest step that all values are whole numbers of; 0 where they are finer, or too few to tell."""
    if len(np.unique(values)) < FEWEST:
        return 0.0
    return next((s for s in COARSE if np.allclose(values / s, np.round(values / s), atol=1e-6)), 0.0)


def no_tolerances(rig: Rig, stand: Stand) -> Iterator[Found]:
    """A drawing without tolerances: only frames would be fitted. Proposes such as would explain what is left.

    Certain where nothing states them and readings miss the drawing by more than their noise: physics would be blamed for what
    the workshop made. Where zero is stated somebody meant it.
    """
    machine = rig.machine
    if any(p.free for p in machine.mechanism.parameters) or not machine.mechanism.parameters:
        return
    size = float(f"{max(stand.length or 0.0, 0.01):.1g}")
    angle = float(f"{np.degrees(size / (reach(rig, rig.scene.p) or USUAL_REACH)):.1g}")
    units = machine.units
    stated = {"length": convert(size, "mm", units.length), "angle": convert(angle, "deg", units.angle)}
    stated = {key: float(f"{value:.3g}") for key, value in stated.items()}
    example = f"{{length: {stated['length']:g}, angle: {stated['angle']:g}}}"
    meant = machine.file is None or "tolerances" in machine.file.raw
    certain = not meant and stand.misfit > FAR
    fitted = "only base and tool would be fitted"
    if certain:
        fitted += f", to {stand.misfit:.3g} sigma, and physics blamed for what the workshop made"
    yield Found(
        "no-tolerances",
        ("tolerances",),
        f"no tolerance of the mechanism is stated: {fitted}",
        f"state what the drawing allows, for example 'tolerances: {example}'; 0 where it is exact",
        "wrong" if certain else "suspect",
        mend=lambda pair: pair.with_field(("tolerances",), {**(pair.get(("tolerances",)) or {}), **stated}),
    )
