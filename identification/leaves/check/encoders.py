"""Encoders on the load side against the joints that they read: another unit, the other way, another joint, another zero."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from truepose.identification.leaves.check.kinds.joints import LEAST
from truepose.identification.leaves.check.kinds.units import ANGLES, LENGTHS
from truepose.identification.leaves.check.pair import Mend, Pair
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.weighing import PHYSICS
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine
from truepose.models.machine.parameters import Parameter
from truepose.models.sensors.base import Channel, Sensor
from truepose.models.units import convert

Array = NDArray[np.float64]
_KEPT = 0.8
_FAR = 5.0
"""How many tolerances a zero may be off before it is worth a word."""
SURE = 3.0
"""How many times better a meaning of a column must fit to be certain."""
_CLEAR = 3.0
"""How many times the scatter of a joint's own errors a zero must be off to be told from them."""


@dataclass(frozen=True)
class _Meant:
    """What a column may be: its readings (n,) if so, in words, and how to mend the files."""

    kind: str
    readings: Array
    says: str
    fix: str
    mend: Mend


def encoders(machine: Machine, recording: Recording) -> Iterator[Found]:
    """Slips of columns that read a joint itself; what gear, play and load do to a joint is none."""
    ways = _ways(machine, recording)
    for place, sensor in enumerate(machine.sensors):
        for channel, zero in zip(sensor.channels, sensor.parameters, strict=True) if sensor.joints else ():
            way = ways[sensor.joints[channel.name]]
            read = recording.observations[channel.name]
            known = np.isfinite(read)
            if not known.any() or np.ptp(way[known]) == 0.0:
                continue
            before, middle = _left(read[known] - way[known], channel.unit)
            if before > PHYSICS * float(np.std(way[known])):
                yield _slip(machine, recording, sensor, channel, known, before)
            else:
                yield from _zero(machine, place, sensor, channel, zero, middle, before)


def _ways(machine: Machine, recording: Recording) -> dict[str, Array]:
    """(n,) way of every joint by its reading alone, mm or rad."""
    actuators = machine.mechanism.actuators
    gains = [machine.geometry[a.gain].nominal if a.gain else 1.0 for a in actuators]
    return {a.reading: gains[k] * recording.q[:, k] for k, a in enumerate(actuators)}


def _left(off: Array, unit: str) -> tuple[float, float]:
    """Rms about the middle of what differs (k,), over the rows that differ least, and the middle; no whole turns of angles."""
    if unit == "rad":
        about = float(np.angle(np.mean(np.exp(1j * off))))
        off = about + (off - about + np.pi) % (2.0 * np.pi) - np.pi
    middle = float(np.median(off))
    each = np.sort(np.abs(off - middle))[: max(int(_KEPT * len(off)), 1)]
    return float(np.sqrt(np.mean(each**2))), middle


def _slip(
    machine: Machine,
    recording: Recording,
    sensor: Sensor,
    channel: Channel,
    known: NDArray[np.bool_],
    before: float,
) -> Found:
    """What a column that does not follow its joint is likely to be."""
    joint, name, unit = sensor.joints[channel.name], channel.name, channel.unit
    way = _ways(machine, recording)[joint][known]
    every = list(_meanings(machine, recording, sensor, channel))
    left = [_left(m.readings[known] - way, unit)[0] for m in every]
    best = int(np.argmin(left)) if left else -1
    shown = machine.units.written(unit)
    size = convert(before, unit, shown)
    if best < 0 or SURE * left[best] > before:
        return Found(
            "unexplained",
            (name,),
            f"{name} does not follow {joint}: they differ by {size:.3g} {shown} rms, and no slip that was tried explains it",
            f"compare the columns {name} and {joint}, their units and their rows with their source",
            "wrong",
            size,
            unit=shown,
        )
    m, after = every[best], convert(left[best], unit, shown)
    return Found(m.kind, (name,), m.says, m.fix, "wrong", size, after, shown, m.mend)


def _meanings(machine: Machine, recording: Recording, sensor: Sensor, channel: Channel) -> Iterator[_Meant]:
    joint, name, unit = sensor.joints[channel.name], channel.name, channel.unit
    read = recording.observations[name]
    said = recording.said.get(name, machine.units.written(unit))
    for other in ANGLES if unit == "rad" else LENGTHS:
        factor = convert(1.0, other, said)
        if abs(factor - 1.0) > 1e-9:
            fix = f"write the unit in the header: {name} [{other}]"
            kind = "unit-angle" if unit == "rad" else "unit-length"
            mend = partial(Pair.in_unit, names=[name], unit=other)
            yield _Meant(kind, factor * read, f"{name} in {other}", fix, mend)
    fix = f"change the sign of column {name}"
    says = f"{name} counts the other way than {joint}"
    yield _Meant("sign", -read, says, fix, partial(Pair.negated, names=[name]))
    for beside in sensor.joints:
        if beside != name and sensor.columns[beside] == unit:
            fix = f"exchange the headers of columns {name} and {beside}"
            says = f"{name} and {beside} exchanged"
            # once: the finding of the other column says the same
            names = {name: beside, beside: name} if name < beside else {}
            mend = partial(Pair.renamed, names=names)
            yield _Meant("permutation", recording.observations[beside], says, fix, mend)


def _zero(
    machine: Machine,
    place: int,
    sensor: Sensor,
    channel: Channel,
    zero: Parameter,
    middle: float,
    scatter: float,
) -> Iterator[Found]:
    """A zero that is elsewhere than its tolerance says."""
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
