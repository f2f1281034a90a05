"""Compare encoders on the load side with the joints that they read: another unit, the other way, another joint or zero."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.check.kinds.joints import LEAST
from truepose.identification.leaves.check.kinds.units import ANGLES, LENGTHS
from truepose.identification.leaves.check.pair import Mend, Pair
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.weighing import (
    PHYSICS,
)
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Parameter
from truepose.models.sensors.base import Channel, Sensor
from truepose.models.units import convert

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
