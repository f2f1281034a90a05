"""What is seen without a fit: missing blocks, too few or repeated rows, joints that stand still or leave their range.

Whether joints give way along the gravity that the file states, or against it: a robot that hangs, said to stand.

A machine fits as it is drawn whichever way is down. But its joints give way along gravity, never against it: if compliances
that are all negative fit far better than any that are positive, gravity pulls the other way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from truepose.arrays import Array, Index, Mask
from truepose.identification.fit.standing_out import FAR, Left, row_words
from truepose.identification.leaves.check.kinds.joints import LEAST
from truepose.identification.leaves.check.kinds.units import ANGLES, LENGTHS
from truepose.identification.leaves.check.pair import USUAL, Mend, Pair, Stand, usable
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.weighing import (
    CERTAIN,
    PHYSICS,
    USUAL_REACH,
    Problem,
    Weighed,
    allowed,
    evidence,
    linearised,
    reach,
    without,
)
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.joint_readings import beyond
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.untestable import GRAVITY, GRAVITY_LINE
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.compliance import JointCompliance
from truepose.models.effects.turning import EncoderEccentricity
from truepose.models.file.driver import APPROACH, PAYLOAD, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Parameter
from truepose.models.sensors.base import Channel, Sensor
from truepose.models.units import convert
from truepose.wording import joined, shortened

# -- What is seen without a fit: missing blocks, too few or repeated rows, joints that stand still or leave their range

_FEWEST = 6
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
    if len(recording) < _FEWEST:
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
    if len(np.unique(values)) < _FEWEST:
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


# -- A stated sigma against what replicates say of it, or, without any, against all that a fit leaves

SIGMA_FAR = 10.0
"""How many times a stated sigma may differ from what readings say before it is worth a word."""
ROUNDING = 1e-9
"""Share of a stated sigma that arithmetic leaves where a fit meets every reading: it says nothing of a sensor."""
_MOST_GROUPS = 100


def sigmas(rig: Rig, stand: Stand, price: float) -> Iterator[Found]:
    """Kinds of reading whose sigma is far from the scatter of replicates, or from all that is left."""
    for kind, (ratio, words) in _scatters(rig, stand, price).items():
        if ratio is None or ratio <= ROUNDING or 1.0 / SIGMA_FAR < ratio < SIGMA_FAR:
            continue
        channel = next(c for c in rig.machine.channels if c.kind == kind)
        size = float(f"{channel.sigma * ratio:.2g}")
        fields = {"position": "xyz", "rotation": "rot", "direction": "angle"}.get(kind, kind)
        unit = rig.machine.units.written(channel.unit)
        yield Found(
            "sigma",
            (f"sensor.sigma.{fields}",),
            f"{words} by {size:.3g} {channel.unit}, sigma is stated as {channel.sigma:.3g} {channel.unit}",
            f"state sigma: {{{fields}: {convert(size, channel.unit, unit):.2g}}}",
            "suspect",
            channel.sigma,
            size,
            channel.unit,
            partial(_mend_sigma, fields, convert(size, channel.unit, unit)),
        )


def _mend_sigma(key: str, value: float, pair: Pair) -> Pair:
    sensor = pair.get(("sensor",))
    heads = [("sensor", k) for k in range(len(sensor))] if isinstance(sensor, list) else [("sensor",)]
    for head in heads:
        if pair.get((*head, "sigma", key)) is not None:
            pair = pair.with_field((*head, "sigma", key), float(f"{value:.3g}"))
    return pair


def _scatters(rig: Rig, stand: Stand, price: float) -> dict[str, tuple[float | None, str]]:
    """By kind of reading: scatter over sigma of replicates; without any, what is left of the fit if that is too little."""
    kinds = list(dict.fromkeys(c.kind for c in rig.machine.channels))
    rows = _replicates(rig.recording)
    out: dict[str, tuple[float | None, str]] = {}
    if len(rows) >= 2 and not any(s.differs_from_row or s.compares for s in rig.machine.sensors):
        labels = np.repeat(np.arange(len(rows)), [len(r) for r in rows])
        here = rig.predictor.over(rig.recording.subset(np.concatenate(rows)))
        residual, good = rig.residual(here, stand.p, stand.scene)
        for kind in kinds:
            at = [k for k, c in enumerate(rig.machine.channels) if c.kind == kind]
            out[kind] = (_within(residual[:, at], labels, good), "replicates scatter")
    left = stand.residual
    for kind in kinds:
        if kind not in out and price < 1.0 / SIGMA_FAR and len(left):
            out[kind] = (price, "everything that is left varies")
    return out


def _replicates(recording: Recording) -> list[Index]:
    """Places of rows that were measured alike, groups of two and more; a row copied from another one is none.

    Alike: at one reading of all joints, in one session, reached from the same sides, under the same load.
    """
    use = np.setdiff1d(np.flatnonzero(~recording.validation), repeats(recording))
    like = [v for name, v in recording.drivers.items() if Driver.of(name).kind in (APPROACH, PAYLOAD)]
    told = np.column_stack([recording.q, recording.session, *like])[use] + 0.0
    _, label, count = np.unique(told, axis=0, return_inverse=True, return_counts=True)
    label = label.reshape(-1)
    return [use[label == k] for k in np.flatnonzero(count >= 2)[:_MOST_GROUPS]]


def _within(residual: Array, labels: NDArray[np.int64], good: Mask) -> float | None:
    """The middle of the groups' scatter; None where too few readings repeat."""
    sizes, spare = [], 0
    for k in np.unique(labels):
        own = residual[(labels == k) & good]
        own = own[np.isfinite(own).all(axis=1)]
        if len(own) >= 2:
            spare += (len(own) - 1) * own.shape[1]
            square = np.sum((own - own.mean(axis=0)) ** 2)
            sizes.append(float(np.sqrt(square / ((len(own) - 1) * own.shape[1]))))
    return float(np.median(sizes)) if spare >= _FEWEST else None


# -- Whether joints give way along the gravity that the file states, or against it: a robot that hangs, said to stand


def reversed_gravity(rig: Rig, weighed: Weighed, misfit: float) -> Iterator[Found]:
    """Yield a finding where joints give way against the stated gravity; ``misfit``: rms that is left without compliances.

    Certain alone is worth a word, and only where the other sign leaves nothing that needs a further cause.
    """
    machine = rig.machine
    joints = _compliances(machine, rig.recording)
    # other loads do not turn with gravity, and an effect of the file may have taken them into account
    others = machine.springs or machine.forces or any(e.needs_load for e in machine.effects)
    if weighed.stand.bad or not joints or others:
        return
    if not _is_certain(rig, weighed, misfit, 1.0):  # no compliance could make it so
        return
    stated, other = _left_by_sagging(rig, weighed, joints)
    if other > FAR or not _is_certain(rig, weighed, stated, other):
        return
    gravity = list(machine.gravity or ())
    mended = [0.0 - v for v in gravity]
    yield Found(
        "gravity-reversed",
        ("gravity",),
        f"joints give way against the stated gravity {_words(gravity)}: compliances leave {stated:.3g} sigma with it, and "
        f"{other:.3g} sigma with its other sign",
        f"look how the machine is mounted: 'gravity: {_words(mended)}' (in the base frame) if it hangs",
        "suspect",
        mend=lambda pair: pair.with_field(("gravity",), mended),
    )


def _words(vector: Sequence[float]) -> str:
    return f"[{', '.join(f'{v + 0.0:.6g}' for v in vector)}]"


def _compliances(machine: Machine, recording: Recording) -> list[PlacedEffect]:
    """Return compliances of each joint: one where masses are stated, else one for each body that may be heavy."""
    effect = JointCompliance()
    every = [
        PlacedEffect.at(effect, machine, at, settings)
        for at in effect.places(machine)
        if effect.screened(machine, at)
        for settings in effect.settings(machine, at, recording)
    ]
    return [one for one in every if one.needs_load and not one.bent]


def _eccentric(machine: Machine) -> list[PlacedEffect]:
    """Return encoders that may be eccentric, where the file has no such effect yet."""
    effect, known = EncoderEccentricity(), {e.at_place for e in machine.effects}
    every = [PlacedEffect.at(effect, machine, at) for at in effect.places(machine)]
    return [one for one in every if one.at_place not in known]


def _is_certain(rig: Rig, weighed: Weighed, stated: float, other: float) -> bool:
    """Whether the other sign is certain, by what both leave beyond the noise of the instrument, in sigmas.

    What noise alone makes of the rms of so many readings is nothing left.
    """
    least = np.sqrt(2.0 / max(weighed.stand.residual.size, 1))
    beyond = [float(np.sqrt(max(size**2 - 1.0, least))) for size in (stated, other)]
    scene = weighed.hypothesis.scene
    gained = evidence(rig, scene, beyond[1], USUAL) - evidence(rig, scene, beyond[0], 1.0)
    return bool(gained > np.log(CERTAIN / (1.0 - CERTAIN)))


def _left_by_sagging(rig: Rig, weighed: Weighed, joints: Sequence[PlacedEffect]) -> tuple[float, float]:
    """Return the rms of readings and of departures that compliances leave, in sigmas: all of them positive, and all negative.

    Readings are linear about where a hypothesis settled: by constants, by compliances, and by the eccentricity of encoders,
    which bends for what looks like a compliance of either sign.
    """
    machine, stand, known = rig.machine, weighed.stand, len(rig.names)
    eccentric = _eccentric(machine)
    here = Predictor(machine, stand.scene.rows.subset(stand.rows), (*machine.effects, *eccentric, *joints))
    p = np.concatenate([weighed.settled.p, np.zeros(len(here.model.names) - known)])
    jacobian, residual = linearised(rig, here, p, stand)
    first = known + sum(len(e.coefficients) for e in eccentric)

    def left(sign: float, noise: float) -> float:
        problem = Problem(rig, stand, noise, weighed.free)
        places = problem.moving
        unit = np.ones(jacobian.shape[2])
        unit[places] = problem.scale
        held = np.zeros((len(places), len(unit)))
        held[np.arange(len(places)), places] = problem.held
        moved = np.vstack([jacobian.reshape(-1, len(unit)) * unit / noise, held])
        off = np.where(problem.known, problem.off(weighed.settled.p), 0.0)
        right = -np.concatenate([residual.reshape(-1) / noise, off])
        both = without(moved[:, [*places, *range(known, first)]], np.column_stack([moved[:, first:], right]))
        size = np.maximum(np.linalg.norm(both[:, :-1], axis=0), 1e-300)
        _, rest = nnls(sign * both[:, :-1] / size, both[:, -1])
        return float(noise * rest / np.sqrt(max(residual.size, 1)))

    stated, other = (left(sign, max(left(sign, 1.0), 1.0)) for sign in (1.0, -1.0))
    return stated, other


# -- What a check says of rows that stand out of the rest, and of what is left of all rows


def left_of(rig: Rig, weighed: Weighed) -> Left:
    """Return what a hypothesis leaves of every row."""
    scene = weighed.hypothesis.scene
    places = usable(rig.machine, scene)
    here = rig.predictor.over(scene.rows.subset(places))
    residual, good = rig.residual(here, weighed.settled.p, scene)
    residual = residual * rig.scale(scene)
    fine = good & np.isfinite(residual).all(axis=1)
    return Left.of(residual[fine], places[fine], allowed(rig, weighed.stand))


def length_of(rig: Rig, left: Left) -> float | None:
    """Return the rms of the 3-D error over all rows, mm; None where no length is read."""
    if not rig.long.any() or not len(left.residual):
        return None
    sigma = np.array([c.sigma for c in rig.machine.channels])
    points = {c.point for c in rig.machine.channels if c.unit == "mm"}
    mm = (left.residual * sigma)[:, rig.long]
    return float(np.sqrt(np.mean(np.sum(mm**2, axis=1)) / max(len(points), 1)))


def standing_out(rig: Rig, left: Left) -> Iterator[Found]:
    """Yield the rows that stand out of the rest."""
    says = row_words(rig.machine, rig.recording, left)
    if says:
        fix = "compare these rows with their source; mend them, or take them out"
        yield Found("rows-stand-out", ("rows",), says, fix, "suspect")


# -- Encoders on the load side against the joints that they read: another unit, the other way, another joint, another zero

_KEPT = 0.8
_FAR = 5.0
"""How many tolerances a zero may be off before it is worth a word."""
SURE = 3.0
"""How many times better a meaning of a column must fit to be certain."""
_CLEAR = 3.0
"""How many times the scatter of a joint's own errors a zero must be off to be told from them."""


@dataclass(frozen=True)
class _Column:
    """A column that reads a joint: its readings (n,), the way (n,) of the joint, mm or rad, and which rows have a reading."""

    machine: Machine
    recording: Recording
    sensor: Sensor
    channel: Channel

    @property
    def joint(self) -> str:
        return self.sensor.joints[self.channel.name]

    @property
    def read(self) -> Array:
        return self.recording.observations[self.channel.name]

    @property
    def way(self) -> Array:
        k = self.machine.mechanism.readings.index(self.joint)
        gain = self.machine.mechanism.actuators[k].gain
        return (self.machine.geometry[gain].nominal if gain else 1.0) * self.recording.q[:, k]

    def left(self, read: Array) -> tuple[float, float]:
        """Rms about the middle by which readings (n,) differ from the way, over the rows that differ least, and the middle; no
        whole turns of angles."""
        known = np.isfinite(self.read)
        off = (read - self.way)[known]
        if self.channel.unit == "rad":
            about = float(np.angle(np.mean(np.exp(1j * off))))
            off = about + (off - about + np.pi) % (2.0 * np.pi) - np.pi
        middle = float(np.median(off))
        each = np.sort(np.abs(off - middle))[: max(int(_KEPT * len(off)), 1)]
        return float(np.sqrt(np.mean(each**2))), middle


def encoders(machine: Machine, recording: Recording) -> Iterator[Found]:
    """Slips of columns that read a joint itself; what gear, play and load do to a joint is none."""
    for place, sensor in enumerate(machine.sensors):
        for channel, zero in zip(sensor.channels, sensor.parameters, strict=True) if sensor.joints else ():
            column = _Column(machine, recording, sensor, channel)
            way = column.way[np.isfinite(column.read)]
            if not len(way) or np.ptp(way) == 0.0:
                continue
            before, middle = column.left(column.read)
            if before > PHYSICS * float(np.std(way)):
                yield _slip(column, before)
            else:
                yield from _encoder_zero(column, place, zero, middle, before)


def _slip(column: _Column, before: float) -> Found:
    """What a column that does not follow its joint is likely to be."""
    name, unit = column.channel.name, column.channel.unit
    every = [(column.left(read)[0], slip) for read, slip in _meanings(column)]
    left, slip = min(every, key=lambda one: one[0], default=(np.inf, None))
    shown = column.machine.units.written(unit)
    size = convert(before, unit, shown)
    if slip is None or SURE * left > before:
        says = (
            f"{name} does not follow {column.joint}: they differ by {size:.3g} {shown} rms, and no slip that was tried "
            "explains it"
        )
        fix = f"compare the columns {name} and {column.joint}, their units and their rows with their source"
        return Found("unexplained", (name,), says, fix, "wrong", size, unit=shown)
    kind, says, fix, mend = slip
    return Found(kind, (name,), says, fix, "wrong", size, convert(left, unit, shown), shown, mend)


def _meanings(column: _Column) -> Iterator[tuple[Array, tuple[str, str, str, Mend]]]:
    """Yield what a column may be: its readings (n,) if so, the kind of slip, its words, the fix, and how to mend the files."""
    name, unit, read, sensor = column.channel.name, column.channel.unit, column.read, column.sensor
    said = column.recording.said.get(name, column.machine.units.written(unit))
    for other in ANGLES if unit == "rad" else LENGTHS:
        factor = convert(1.0, other, said)
        if abs(factor - 1.0) > 1e-9:
            fix = f"write the unit in the header: {name} [{other}]"
            kind = "unit-angle" if unit == "rad" else "unit-length"
            mend = partial(Pair.in_unit, units={name: other})
            yield factor * read, (kind, f"{name} in {other}", fix, mend)
    says = f"{name} counts the other way than {column.joint}"
    yield -read, ("sign", says, f"change the sign of column {name}", partial(Pair.negated, names=[name]))
    for beside in sensor.joints:
        if beside != name and sensor.columns[beside] == unit:
            fix = f"exchange the headers of columns {name} and {beside}"
            # once: the finding of the other column says the same
            names = {name: beside, beside: name} if name < beside else {}
            mend, says = partial(Pair.renamed, names=names), f"{name} and {beside} exchanged"
            yield column.recording.observations[beside], ("permutation", says, fix, mend)


def _encoder_zero(
    column: _Column, place: int, zero: Parameter, middle: float, scatter: float
) -> Iterator[Found]:
    """A zero that is elsewhere than its tolerance says."""
    machine, sensor, channel = column.machine, column.sensor, column.channel
    off = middle - zero.nominal
    if channel.unit == "rad":
        off = (off + np.pi) % (2.0 * np.pi) - np.pi
    if not abs(off) > max(_FAR * zero.tolerance, _CLEAR * scatter, _FAR * channel.sigma):
        return
    joint, unit = sensor.joints[channel.name], machine.units.written(channel.unit)
    at, stated = (convert(v, channel.unit, unit) for v in (zero.nominal + off, zero.nominal))
    key = "angle" if channel.unit == "rad" else "length"
    certain = channel.unit == "rad" and zero.tolerance == 0.0 and abs(off) > LEAST
    several = machine.file is not None and isinstance(machine.file.raw.get("sensor"), list)
    head: tuple[str | int, ...] = ("sensor", place) if several else ("sensor",)
    exact = "exactly " if zero.tolerance == 0.0 else ""
    yield Found(
        "offset",
        (channel.name,),
        f"{channel.name} reads {at:.4g} {unit} where {joint} reads 0; the machine file has {exact}{stated:.4g} {unit} there",
        f"state 'zero: {{{joint}: {at:.4g}}}' and 'tolerance: {{{key}: .inf}}' of this sensor if nobody measured it",
        "wrong" if certain else "suspect",
        mend=lambda pair: pair.with_field((*head, "zero", joint), float(f"{at:.6g}")).with_field(
            (*head, "tolerance", key), float("inf")
        ),
    )
