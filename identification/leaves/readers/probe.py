"""A probe's table with a clock of its own beside a robot's log: every sample becomes a row with the joints at its time."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.leaves.readers.clock_offset import MOVING, Clock, Motion
from truepose.identification.recording.file import LOGGED, OF_JOINTS
from truepose.identification.recording.joint_readings import sized
from truepose.identification.recording.table import Column, Table, in_known_case
from truepose.identification.recording.text import ArrowCells
from truepose.identification.recording.times import read_times
from truepose.models.file.driver import TEMPERATURE, VELOCITY
from truepose.models.machine.columns import OF_ROWS
from truepose.models.units import compatible, convert
from truepose.wording import joined, shortened

_TIMES: Final = ("time", "timestamp", "t", "stamp")
_GAP: Final = 5.0
"""A pause in the log of more than so many usual steps is a gap, in which nobody knows the joints."""
_DISAGREES: Final = 0.5
"""Share of a joint's velocity by which what was logged may differ from the slope of its positions."""
_HELD: Final = ("session", "role", "approach")
"""What holds from one sample of the log to the next."""
_POINT: Final = re.compile(r"^(?P<head>(.*\.)?)x$")


@dataclass(frozen=True)
class Log:
    """A robot's log in order of time: joints (k, nj) in their columns' units and velocities (k, nj) in those per second."""

    table: Table
    time: Array
    names: tuple[str, ...]
    joints: Array
    velocities: Array
    order: Index

    @property
    def step(self) -> float:
        """The usual time between samples, s."""
        return float(np.median(np.diff(self.time)))

    def at(self, time: Array) -> tuple[Array, Array]:
        """Joints (n, nj) and their velocities (n, nj), by the cubic that meets positions and velocities on both sides."""
        way = CubicHermiteSpline(self.time, self.joints, self.velocities)
        return np.asarray(way(time)), np.asarray(way.derivative()(time))

    def knows(self, time: Array) -> Mask:
        """(n,) times inside the log that are not in one of its gaps."""
        inside = (time >= self.time[0]) & (time <= self.time[-1])
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        return np.asarray(inside & (self.time[after] - self.time[after - 1] <= _GAP * self.step))


@dataclass(frozen=True)
class Pairing:
    """A probe's table with its times (n,), s by its own clock, and a robot's log."""

    probe: Table
    time: Array
    log: Log

    @classmethod
    def of(cls, probe: Table, log: Table, joints: Sequence[str] = ()) -> Pairing:
        """Of two tables. joints: columns of the log that are some, by default all of its numbers that have no other meaning.

        Raises InputError where a time or a joint is missing, and for logged velocities that are none.
        """
        probe, log = in_known_case(probe, _TIMES), in_known_case(log, (*_TIMES, *joints))
        return cls(probe, _time(probe), _logged(log, joints))

    @property
    def motion(self) -> Motion:
        """What tells the clocks: the motion of the first point that the probe read. Raises InputError where it read none."""
        probe, log = self.probe, self.log
        heads = [found["head"] for name in probe.names if (found := _POINT.match(name))]
        axes = next(
            ([f"{h}{a}" for a in "xyz"] for h in heads if all(f"{h}{a}" in probe for a in "xyz")), None
        )
        if axes is None:
            raise InputError(
                f"{probe.file}: found no point x y z to compare the clocks by, expected one, or --offset"
            )
        place = np.column_stack([sized(probe, name, probe.readings(name)) for name in axes])
        order = np.unique(self.time, return_index=True)[1]
        order = order[np.isfinite(place[order]).all(axis=1)]
        radians, slides = _internal(log)

        def joints(time: Array) -> Array:
            return log.at(np.clip(time, log.time[0], log.time[-1]))[0] * radians

        span = (float(log.time[0]), float(log.time[-1]))
        return Motion(self.time[order], place[order], joints, span, slides, log.step)

    @property
    def files(self) -> str:
        """Both, to open messages with."""
        return f"{self.probe.file} and {self.log.table.file}"

    def rows(self, clock: Clock, every: float = 0.0, most: int = 0) -> Table:
        """The probe's samples as rows of a recording: time by the log's clock, joints, their velocities, what else was logged,
        and what the probe read.

        every: least time between rows, s. most: so many rows of those in which the joints move, 0 for all rows. Samples
        outside of the log, or in a gap of it, are left out with a note. Raises InputError where all are, and for a column
        that both tables have.
        """
        at = clock.of_log(self.time)
        known = self.log.knows(at)
        if not known.any():
            raise InputError(
                f"{self.probe.file}: found no sample at a time of {self.log.table.file}: by its clock they are from "
                f"{at.min():.6g} to {at.max():.6g} s, the log is from {self.log.time[0]:.6g} to {self.log.time[-1]:.6g} s; "
                "expected both of one run"
            )
        kept = np.flatnonzero(known)
        kept = _thinned(kept[np.argsort(at[kept], kind="stable")], at, every)
        if most:
            speed = np.linalg.norm(self.log.at(at[kept])[1], axis=1)
            kept = kept[speed >= MOVING * np.quantile(speed, 0.9)]
            kept = kept[np.linspace(0, len(kept) - 1, min(len(kept), most)).astype(int)]
        notes = [*self.probe.notes, *self.log.table.notes]
        if not known.all():
            beyond = f"{np.sum(~known)} of {len(at)} samples are outside of {self.log.table.file}, or in a gap of it"
            notes.append(f"{self.probe.file}: {beyond}: left out")
        return replace(_rows(self.probe, self.log, kept, at), notes=tuple(notes))


def _time(table: Table) -> Array:
    """(n,) seconds of a table's column of time: numbers, dates or times of day."""
    name = next((name for name in _TIMES if name in table), None)
    if name is None:
        raise InputError(f"{table.file}: found no column of time, expected one called {joined(_TIMES, 'or')}")
    return sized(table, name, read_times(table, name).seconds)


def _logged(log: Table, joints: Sequence[str]) -> Log:
    time = _time(log)
    names = tuple(joints) or tuple(name for name in log.names if _may_be_joint(log, name))
    unknown = [name for name in names if name not in log]
    if unknown or not names:
        found = f"no joint {unknown[0]!r}" if unknown else "no column of numbers that may be a joint"
        raise InputError(
            f"{log.file}: found {found}, expected the joints by name; columns: {joined(log.names)}"
        )
    order = (
        len(time) - 1 - np.unique(np.round(time[::-1], 9), return_index=True)[1]
    )  # of several at one time, to the nanosecond, the last one counts
    if len(order) < 4:
        raise InputError(f"{log.file}: found {len(order)} different times, expected a log of at least 4")
    at, values = time[order], np.column_stack([sized(log, name, log.numbers(name))[order] for name in names])
    slopes = np.gradient(values, at, axis=0)
    for k, name in enumerate(names):
        if f"{VELOCITY}.{name}" in log:
            slopes[:, k] = _checked(log, name, _velocity(log, name)[order], slopes[:, k])
    return Log(log, at, names, values, slopes, order)


def _may_be_joint(log: Table, name: str) -> bool:
    if name.casefold() in (*OF_ROWS, *LOGGED, *_TIMES) or name.partition(".")[0] in (TEMPERATURE, *OF_JOINTS):
        return False
    try:
        log.numbers(name)
    except InputError:
        return False
    return True


def _velocity(log: Table, name: str) -> Array:
    """(k,) logged velocities in the unit of the joint's column per second."""
    own, logged = log.stated_units[name], log.stated_units[f"{VELOCITY}.{name}"]
    values = log.numbers(f"{VELOCITY}.{name}")
    if logged is None or logged == f"{own}/s":
        return values
    if own is None:
        raise InputError(
            f"{log.where(name)}: found no unit, expected one, as {VELOCITY}.{name} [{logged}] has: {name} [deg]"
        )
    return convert(values, logged, f"{own}/s", log.where(f"{VELOCITY}.{name}"))


def _checked(log: Table, name: str, logged: Array, slope: Array) -> Array:
    """Logged velocities, if they are the slope of the positions, roughly; in another unit they would spoil all in between."""
    size = float(np.sqrt(np.mean(slope**2)))
    if float(np.sqrt(np.mean((logged - slope) ** 2))) <= _DISAGREES * size:
        return logged
    raise InputError(
        f"{log.where(f'{VELOCITY}.{name}')}: found an rms of {np.sqrt(np.mean(logged**2)):.4g}, but {name} changes "
        f"by {size:.4g} a second: expected its velocity, with its unit in the header, or no such column"
    )


def _internal(log: Log) -> tuple[Array, Mask]:
    """(nj,) factors to rad, and which joints slide; columns without a unit are in deg if one goes beyond a turn in rad."""
    units = log.table.stated_units
    bare = [k for k, name in enumerate(log.names) if units[name] is None]
    usual = "deg" if bare and np.abs(log.joints[:, bare]).max() > 2.0 * np.pi else "rad"
    said = [units[name] or usual for name in log.names]
    slides = np.array([not compatible(unit, "rad") for unit in said])
    factors = [1.0 if slide else convert(1.0, unit, "rad") for unit, slide in zip(said, slides, strict=True)]
    return np.array(factors), slides


def _thinned(rows: Index, at: Array, every: float) -> Index:
    """Rows in order of time, at least ``every`` s apart."""
    if every <= 0.0:
        return rows
    kept, last = [], -np.inf
    for row in rows.tolist():
        if at[row] >= last + every * (1.0 - 1e-9):
            kept.append(row)
            last = at[row]
    return np.array(kept, dtype=np.intp)


def _rows(probe: Table, log: Log, kept: Index, at: Array) -> Table:
    units = log.table.stated_units
    q, v = log.at(at[kept])
    columns, cells = [Column("time", "s")], {"time": ArrowCells(at[kept])}
    for k, name in enumerate(log.names):
        unit = units[name]
        columns += [Column(name, unit), Column(f"{VELOCITY}.{name}", unit and f"{unit}/s")]
        cells |= {name: ArrowCells(q[:, k].copy()), f"{VELOCITY}.{name}": ArrowCells(v[:, k].copy())}
    others: dict[str, Sequence[object]] = dict(_beside(log, at[kept]))
    columns += [Column(name, units[name]) for name in others]
    read = [c for c in probe.columns if c.name not in _TIMES]
    twice = [c.name for c in read if c.name in cells or c.name in others]
    if twice:
        raise InputError(
            f"{log.table.file}: column {shortened([repr(n) for n in twice], 3)}: found there and in {probe.file}, "
            f"expected it in one; name the joints: --joint {log.names[0]} --joint ..."
        )
    whole: dict[str, Sequence[object]] = {**cells, **others}
    whole |= {c.name: [probe.cells[c.name][k] for k in kept] for c in read}
    return Table(probe.file, (*columns, *read), whole, len(kept))


def _beside(log: Log, at: Array) -> Mapping[str, Sequence[object]]:
    """What else was logged that a recording may hold: numbers between samples, and what holds on from the sample before."""
    out: dict[str, Sequence[object]] = {}
    before = log.order[np.clip(np.searchsorted(log.time, at, side="right") - 1, 0, len(log.time) - 1)]
    for name in log.table.names:
        kind = name.partition(".")[0]
        if name in log.names or kind == VELOCITY or name in _TIMES:
            continue
        if kind in _HELD:
            out[name] = [log.table.cells[name][k] for k in before]
        elif kind in (TEMPERATURE, *LOGGED, *OF_JOINTS):
            out[name] = ArrowCells(np.interp(at, log.time, log.table.numbers(name)[log.order]))
    return out


def clock_words(pairing: Pairing, clock: Clock, told_by: str) -> str:
    """What a note says of a clock that is ``told_by`` something: as stated, by the motion, by a machine file."""
    sure = "" if clock.sigma is None else f" +- {clock.sigma:.1g} s"
    files = f"{pairing.log.table.file}: its clock is that of {pairing.probe.file}"
    words = f"{files} plus {clock.offset:.9g} s{sure}, {told_by}"
    if clock.rate:
        drift = 1e3 * clock.rate * float(np.ptp(pairing.time))
        words += f"; they drift apart by {1e6 * clock.rate:.3g} ppm, {drift:.3g} ms in all"
    return words
