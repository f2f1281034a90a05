"""A probe's table with a clock of its own beside a robot's log: every sample becomes a row with the joints at its time."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import correlate, find_peaks

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.recording.file import LOGGED, OF_JOINTS
from truepose.identification.recording.joint_readings import sized
from truepose.identification.recording.table import Column, Table, in_known_case
from truepose.identification.recording.text import ArrowCells
from truepose.identification.recording.times import read_times
from truepose.models.file.driver import TEMPERATURE, VELOCITY
from truepose.models.machine.columns import OF_ROWS
from truepose.wording import joined, shortened

_TIMES: Final = ("time", "timestamp", "t", "stamp")
_GAP: Final = 5.0
"""A pause in the log of more than so many usual steps is a gap, in which nobody knows the joints."""
_HELD: Final = ("session", "role", "approach")
"""What holds from one sample of the log to the next."""
_MOVING: Final = 0.2
"""Share of the usual top speed from which a sample says anything of the clocks."""
_TOP: Final = 0.99
"""Quantile of the probe's speed that is its top speed."""
_GRID: Final = 1 << 16
"""Most samples that speeds are compared at."""
_FEWEST: Final = 20
"""Samples that clocks can be compared at."""
_LEAST: Final = 0.4
"""Least correlation of the two speeds."""
_MARGIN: Final = 0.02
"""How much more the best lag must correlate than any other."""
_POINT: Final = re.compile(r"^(?P<head>(.*\.)?)x$")


@dataclass(frozen=True)
class Clock:
    """time of the log = time of the probe + offset + rate * (time of the probe - middle), s; sigma: 1-sigma of the offset."""

    offset: float
    sigma: float | None = None
    rate: float = 0.0
    middle: float = 0.0

    def of_log(self, time: Array) -> Array:
        """Return times (n,) of the probe by the log's clock."""
        return np.asarray(time + self.offset + self.rate * (time - self.middle))


@dataclass(frozen=True)
class Log:
    """A robot's log in order of time: joints (k, nj) in their columns' units."""

    table: Table
    time: Array
    names: tuple[str, ...]
    joints: Array
    order: Index

    @property
    def step(self) -> float:
        """The usual time between samples, s."""
        return float(np.median(np.diff(self.time)))

    def at(self, time: Array) -> tuple[Array, Array]:
        """Return joints (n, nj) and their velocities (n, nj), by the cubic spline through all samples."""
        way = CubicSpline(self.time, self.joints)
        return np.asarray(way(time)), np.asarray(way(time, 1))

    def knows(self, time: Array) -> Mask:
        """Return which times (n,) are inside the log that are not in one of its gaps."""
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
    def place(self) -> tuple[Array, Array]:
        """Times (n,), in order, and places (n, 3) of the first point that the probe read. Raises InputError if it read none."""
        probe = self.probe
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
        return self.time[order], place[order]

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
            kept = kept[speed >= _MOVING * np.quantile(speed, 0.9)]
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
    # of several at one time, to the nanosecond, the last one counts
    order = len(time) - 1 - np.unique(np.round(time[::-1], 9), return_index=True)[1]
    if len(order) < 4:
        raise InputError(f"{log.file}: found {len(order)} different times, expected a log of at least 4")
    values = np.column_stack([sized(log, name, log.numbers(name))[order] for name in names])
    return Log(log, time[order], names, values, order)


def _may_be_joint(log: Table, name: str) -> bool:
    if name.casefold() in (*OF_ROWS, *LOGGED, *_TIMES) or name.partition(".")[0] in (TEMPERATURE, *OF_JOINTS):
        return False
    try:
        log.numbers(name)
    except InputError:
        return False
    return True


def _thinned(rows: Index, at: Array, every: float) -> Index:
    """Return rows in order of time, at least ``every`` s apart."""
    kept: list[int] = []
    for row in rows.tolist():
        if not kept or at[row] >= at[kept[-1]] + every * (1.0 - 1e-9):
            kept.append(row)
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


def clock_of(pairing: Pairing) -> Clock:
    """Return the clock of the probe by that of the log, from the motion that both saw, to about a sample.

    When the robot moves, the probe moves: the clocks are apart by the lag at which both speeds correlate best. Raises
    InputError if the motion does not tell it.
    """
    time, place = pairing.place
    log, where = pairing.log, pairing.files
    own = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    step = max(own, log.step, max(np.ptp(time), np.ptp(log.time)) / _GRID)
    seen, logged = np.arange(time[0], time[-1], step), np.arange(log.time[0], log.time[-1], step)
    place = np.column_stack([np.interp(seen, time, v) for v in place.T])
    speed = np.linalg.norm(np.diff(place, axis=0), axis=1)
    moving = np.sum(speed >= _MOVING * np.quantile(speed, _TOP)) if len(speed) else 0
    if min(len(time), len(seen), len(logged), moving) < _FEWEST:
        raise InputError(
            f"{where}: found less than {_FEWEST} samples, or samples at which the probe moves, that clocks could be compared "
            "at, expected --offset"
        )
    joints = _levelled(log.at(logged)[0])
    alike = _correlation(np.linalg.norm(np.diff(joints, axis=0), axis=1), speed)
    peaks = find_peaks(np.r_[-1.0, alike, -1.0])[0] - 1
    best, *others = peaks[np.argsort(-alike[peaks])].tolist()
    if alike[best] < _LEAST:
        raise InputError(
            f"{where}: found no time shift at which the probe moves when the joints do (correlation of the speeds "
            f"{alike[best]:.2f}), expected both to be of one run, or --offset"
        )
    first = logged[0] - seen[0] - (len(seen) - 2) * step
    if others and alike[others[0]] > alike[best] - _MARGIN:
        one, other = (f"{first + k * step:.6g} s" for k in (best, others[0]))
        raise InputError(
            f"{where}: the motion repeats itself, and an offset of {one} fits as well as {other}: expected --offset, or a "
            "motion that does not"
        )
    before, top, after = alike[np.clip([best - 1, best, best + 1], 0, len(alike) - 1)]
    bend = before - 2.0 * top + after
    between = 0.5 * (before - after) / bend if bend < 0.0 else 0.0  # top of the parabola through three
    return Clock(float(first + (best + between) * step), step)


def _levelled(joints: Array) -> Array:
    """Return columns (n, nq) with a standard deviation of 1, constant ones as they are.

    They are brought to a span of 1 first: squares of the smallest numbers are 0.
    """
    span = np.ptp(joints, axis=0)
    moved = (joints - joints[0]) / np.where(span > 0.0, span, 1.0)
    return np.asarray(moved / np.where(span > 0.0, moved.std(axis=0), 1.0))


def _correlation(a: Array, b: Array) -> Array:
    """Return Pearson's r of a[k + j] and b[k] over what they share, by every j; -1 for less than half of the shorter one."""
    a, b = (v / (v.std() or 1.0) for v in (a, b))
    one, other = np.ones(len(a)), np.ones(len(b))

    def over(x: Array, y: Array) -> Array:
        return np.asarray(correlate(x, y, mode="full", method="fft"))

    n = np.maximum(np.round(over(one, other)), 1.0)
    mean_a, mean_b = over(a, other) / n, over(one, b) / n
    spread_a, spread_b = over(a * a, other) / n - mean_a**2, over(one, b * b) / n - mean_b**2
    both = over(a, b) / n - mean_a * mean_b
    size = np.sqrt(np.maximum(spread_a, 0.0) * np.maximum(spread_b, 0.0))
    usable = (n >= 0.5 * min(len(a), len(b))) & (size > 1e-6)
    return np.where(usable, both / np.where(usable, size, 1.0), -1.0)


def clock_words(pairing: Pairing, clock: Clock, told_by: str) -> str:
    """What a note says of a clock that is ``told_by`` something: as stated, by the motion, by a machine file."""
    sure = "" if clock.sigma is None else f" +- {clock.sigma:.1g} s"
    files = f"{pairing.log.table.file}: its clock is that of {pairing.probe.file}"
    words = f"{files} plus {clock.offset:.9g} s{sure}, {told_by}"
    if clock.rate:
        drift = 1e3 * clock.rate * float(np.ptp(pairing.time))
        words += f"; they drift apart by {1e6 * clock.rate:.3g} ppm, {drift:.3g} ms in all"
    return words
