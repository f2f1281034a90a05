"""Photocurrents of a recording's moves as its column ``dL``: counted, signed, checked, or left out with a note.

The long table of a photocurrent, ``pose t I``, as one series for every move.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.leaves.fringes.excursions import Fault
from truepose.identification.leaves.fringes.levels import Levels
from truepose.identification.leaves.fringes.move import Move, read_move
from truepose.identification.prediction.predict import predicted, predictor_for
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table, read_table
from truepose.models.machine.machine import Machine
from truepose.models.sensors.irradiance import Irradiance
from truepose.models.units import UnitSystem, convert
from truepose.wording import close_matches, shortened

# -- Returns to a pose: the changes of length along the way must add up to nothing, or a fringe was miscounted

_REPEATS = 0.05  # of a count: how well a pose repeats where nothing was miscounted
_SIGMAS = 4.0
_NOTABLE = 0.25  # of a count: returns that miss by more are worth a note


def miscounted(
    rows: Recording, change: Array, sigma: Array, read: Mask, count: float
) -> tuple[Mask, list[str]]:
    """(n,) rows between two visits to one pose whose changes sum to whole counts (mm each) instead of 0, and notes.

    ``change`` (n,) and its ``sigma`` hold where ``read``. Rows are returns to a pose when they are replicates
    (see `Recording.replicates`) that changes link. A return that misses by anything else is only noted: the
    mirror, or what holds the fibre, moved.
    """
    assert rows.from_row is not None
    length, variance, root = _lengths(rows, change, sigma, read)
    label, bad, notes = rows.replicates(), np.zeros(len(rows), dtype=bool), []
    first: dict[tuple[int, int], int] = {}
    for row in rows.order.tolist():
        before = first.setdefault((int(label[row]), int(root[row])), row)
        if before == row:
            continue
        gap = float(length[row] - length[before])
        fringes = round(gap / count)
        margin = max(_SIGMAS * float(np.sqrt(variance[row] + variance[before])), _REPEATS * count)
        what = (
            f"{rows.where(row)}: back at the pose of row {rows.source_row[before]}, dL since then adds up to "
        )
        if fringes != 0 and abs(gap - fringes * count) < margin:
            way = _between(rows.from_row, before, row)
            bad[way] |= read[way]
            named = ", ".join(str(rows.source_row[k]) for k in way if read[k])
            notes.append(
                f"{what}{1e6 * gap:.0f} nm, {fringes:+d} counts: a miscount in one of rows {named}, left out"
            )
        elif abs(gap) > _NOTABLE * count:
            notes.append(f"{what}{1e6 * gap:.0f} nm, no whole counts: the mirror did not come back")
    return bad, notes


def _lengths(rows: Recording, change: Array, sigma: Array, read: Mask) -> tuple[Array, Array, Index]:
    """Length and its variance at every row since the root of its chain of moves, and that root."""
    assert rows.from_row is not None
    length, variance = np.zeros(len(rows)), np.zeros(len(rows))
    root = np.arange(len(rows))
    for row in rows.order.tolist():
        origin = int(rows.from_row[row])
        if read[row] and origin != row:
            length[row] = length[origin] + change[row]
            variance[row] = variance[origin] + sigma[row] ** 2
            root[row] = root[origin]
    return length, variance, root


def _between(origin: NDArray[np.int64], first: int, last: int) -> list[int]:
    """Rows whose moves lead from one row to another, by the chain of both to where they meet."""

    def chain(row: int) -> list[int]:
        out = [row]
        while int(origin[out[-1]]) != out[-1]:
            out.append(int(origin[out[-1]]))
        return out

    one, other = chain(first), chain(last)
    return sorted(set(one) ^ set(other))


# -- The long table of a photocurrent, ``pose t I``, as one series for every move

_NEEDED: Final = ("pose", "t", "I")
_FEWEST: Final = 32


@dataclass(frozen=True)
class Series:
    """The samples of one move in order of time: t in s, the signal as recorded, wavelengths in mm.

    ``row``: where its first sample stands in the file, from 1; ``sign``: +1 or -1 where the table says it.
    """

    row: int
    t: Array
    signal: Array
    wavelength: Array | None
    sign: int | None


@dataclass(frozen=True)
class SampleTable:
    """A table of samples, and the series of each pose in the order of the file."""

    file: str
    series: Mapping[int, Sequence[Series]]
    notes: tuple[str, ...]


def read_samples(path: Path | str, units: UnitSystem) -> SampleTable:
    """Read CSV or Parquet with columns ``pose``, ``t`` (s), ``I`` (any unit), perhaps ``wavelength``, ``sign``.

    ``wavelength`` without a unit of its own is in the file's unit of length. Raises InputError naming file, row
    and column: for a missing column, what is no number, and times that do not increase within a pose's series.
    """
    table = read_table(path)
    for name in _NEEDED:
        if name not in table:
            raise InputError(f"{table.file}: missing column {name!r}; {close_matches(name, table.names)}")
    pose = table.integers("pose")
    values = {name: table.numbers(name) for name in ("t", "I", "wavelength", "sign") if name in table}
    values["t"] = convert(values["t"], table.unit("t", "s", "s"), "s")
    table.unit("I", "1", "any")
    if "wavelength" in values:
        unit = table.unit("wavelength", units.length, "mm")
        values["wavelength"] = convert(values["wavelength"], unit, "mm")
        wrong, found = values["wavelength"] <= 0.0, table.cells["wavelength"]
        table.refuse("wavelength", wrong, lambda row: str(found[row]), "a wavelength > 0")
    if "sign" in values:
        wrong, signs = ~np.isin(values["sign"], (-1.0, 0.0, 1.0)), table.cells["sign"]
        table.refuse("sign", wrong, lambda row: str(signs[row]), "-1, 1, or 0 for unknown")
    ignored = [name for name in table.names if name not in (*_NEEDED, "wavelength", "sign")]
    notes = [f"{table.file}: ignored columns that mean nothing here: {', '.join(map(repr, ignored))}"]
    return SampleTable(table.file, _series(table, pose, values), tuple(notes if ignored else []))


def _series(
    table: Table, pose: NDArray[np.int64], values: Mapping[str, Array]
) -> dict[int, tuple[Series, ...]]:
    """Return unbroken runs of rows of one pose, by pose."""
    new = np.append(True, pose[1:] != pose[:-1])
    time, sign = values["t"], values.get("sign", np.zeros(len(pose)))
    for row in (np.flatnonzero(~new[1:] & (np.diff(time) <= 0.0)) + 1).tolist():
        raise InputError(
            f"{table.where('t', row)}: found {time[row]:.9g} s after {time[row - 1]:.9g} s in pose {pose[row]}, expected "
            "times that increase within a pose"
        )
    for row in (np.flatnonzero(~new[1:] & (np.diff(sign) != 0.0)) + 1).tolist():
        raise InputError(
            f"{table.where('sign', row)}: found {sign[row]:g} after {sign[row - 1]:g}, expected one sign in all rows of a "
            "series"
        )
    out: dict[int, tuple[Series, ...]] = {}
    for first, last in itertools.pairwise([*np.flatnonzero(new).tolist(), len(pose)]):
        if last - first < _FEWEST:
            raise InputError(
                f"{table.where('I', first)}: found {last - first} samples in the series, expected at least {_FEWEST}"
            )
        wavelength = values["wavelength"][first:last] if "wavelength" in values else None
        one = Series(
            first + 1, time[first:last], values["I"][first:last], wavelength, int(sign[first]) or None
        )
        out[int(pose[first])] = (*out.get(int(pose[first]), ()), one)
    return out


# -- Photocurrents of a recording's moves as its column ``dL``: counted, signed, checked, or left out with a note

_ODDS = 4.6  # log of the odds (99 to 1) from which on the model's sign is taken
_COARSE = 3.0  # times the sensor's sigma: changes known less well are left out
_SHOWN = 12


def sensor_of(machine: Machine) -> Irradiance:
    """The machine's sensor of type irradiance. InputError when it has none."""
    for sensor in machine.sensors:
        if isinstance(sensor, Irradiance):
            return sensor
    where = f"{machine.file.path}: " if machine.file else ""
    kinds = ", ".join(sensor.type for sensor in machine.sensors) or "none"
    raise InputError(f"{where}sensor: found {kinds}, expected one of type irradiance for --irradiance")


class Readings:
    """Changes of length as they come in: ``change`` and its 1-sigma (n,) in mm, rows ``left_out`` (n,), notes."""

    def __init__(self, machine: Machine, sensor: Irradiance, rows: Recording) -> None:
        self.machine, self.sensor, self.rows = machine, sensor, rows
        self.change, self.sigma = np.zeros(len(rows)), np.zeros(len(rows))
        self.left_out = np.zeros(len(rows), dtype=bool)
        self.notes: list[str] = []

    def read(self, index: int, table: SampleTable, progress: Callable[[str], None]) -> None:
        """Read all moves of one file.

        The sign comes from the table's column ``sign``, from scans of the wavelength, or from the machine's nominal constants
        where they leave little doubt. Raises InputError naming file, row and pose where samples are missing or are no series.
        """
        series = paired_series(self.rows, index, table)
        self.notes += table.notes
        moves: dict[int, Move] = {}
        for done, (row, one) in enumerate(series.items()):
            progress(f"counting fringes: {done} of {len(series)} moves")
            moves[row] = self._move(one, None)
        shared = shared_levels(list(moves.values()))
        if shared is not None:
            for row, move in moves.items():
                if {Fault.LEVELS, Fault.WEAK} & set(move.faults):
                    moves[row] = self._move(series[row], shared)
        by_model = [row for row, move in moves.items() if self.take(row, series[row], move)]
        if by_model:
            numbers = shortened([str(self.rows.source_row[row]) for row in by_model], _SHOWN)
            self.notes.append(
                f"{self.rows.files[index]}: the sign of dL in row{'s' * (len(by_model) > 1)} {numbers} is that of the nominal "
                f"machine: {table.file} has no scan of the wavelength there that tells"
            )

    def close(self) -> None:
        """Returns that do not close by whole fringes are miscounts."""
        read = (self.sigma > 0.0) & ~self.left_out
        bad, notes = miscounted(self.rows, self.change, self.sigma, read, self.sensor.wavelength / 2.0)
        self.notes += notes
        self.left_out |= bad
        self.change[self.left_out] = 0.0

    def _move(self, one: Series, levels: Levels | None) -> Move:
        wavelength = self.sensor.wavelength if one.wavelength is None else one.wavelength
        return read_move(one.t, one.signal, wavelength, self.sensor.reflectivities, levels)

    def take(self, row: int, one: Series, move: Move) -> bool:
        """Keep a move as a reading, or leave it out with a note; whether the model gave the sign."""
        why = [fault.value for fault in move.faults]
        coarse = _COARSE * self.sensor.sigma
        if not why and 0.0 < coarse < move.sigma:
            why.append(
                f"dL is known to {1e6 * move.sigma:.1f} nm only, and sigma is {self.sensor.sigma * 1e6:.3g} nm"
            )
        sign, by_model = (0.0, False) if why else self.sign_of(row, one, move)
        if not why and sign == 0.0:
            why.append("neither a scan of the wavelength nor the nominal machine tells the sign of dL")
        elif not why and one.sign is not None and move.signed and sign * move.change < -3.0 * move.sigma:
            why.append("its sign in the table is not that of the wavelength scans")
        self.left_out[row] = bool(why)
        self.change[row] = sign * abs(move.change)
        self.sigma[row] = max(move.sigma, 1e-12)
        for reason in why:
            self.notes.append(f"{self.rows.where(row)}: left out (samples from row {one.row} on): {reason}")
        return by_model and not why

    def sign_of(self, row: int, one: Series, move: Move) -> tuple[float, bool]:
        """-1, 1, or 0 where nothing tells; and whether the nominal machine was asked."""
        if one.sign is not None:
            return float(one.sign), False
        if move.signed:
            return float(np.sign(move.change)) or 1.0, False
        if move.change < 3.0 * move.sigma:
            return 1.0, False  # no sign to speak of
        value, std = (array[row] for array in self.nominal)
        if not np.isfinite(value) or value == 0.0 or not np.isfinite(std):
            return 0.0, True
        # odds of + against - for a Gaussian prediction
        odds = 2.0 * move.change * value / max(std, 1e-150) ** 2
        return (float(np.sign(value)) if abs(odds) > _ODDS else 0.0), True

    @cached_property
    def nominal(self) -> tuple[Array, Array]:
        """dL (n,) in mm of the nominal machine and its 1-sigma."""
        found = predicted(predictor_for(self.machine, self.rows))
        assert found.std is not None
        column = list(found.columns).index("dL")
        return found.values[:, column], found.std[:, column]


def paired_series(rows: Recording, index: int, table: SampleTable) -> dict[int, Series]:
    """The series of every row of a file that has a move; rows of one pose take theirs in order."""
    assert rows.from_row is not None
    assert rows.pose is not None
    own = np.flatnonzero(rows.source_file == index)
    out: dict[int, Series] = {}
    for pose in np.unique(rows.pose[own]):
        of_pose = own[rows.pose[own] == pose]
        if rows.time is not None:
            of_pose = of_pose[np.argsort(rows.time[of_pose], kind="stable")]
        moving = of_pose[rows.from_row[of_pose] != of_pose]
        found = table.series.get(int(pose), ())
        if len(found) == len(of_pose):
            moving_series = [one for row, one in zip(of_pose, found, strict=True) if row in moving]
        else:
            moving_series = list(found)
        if len(moving_series) != len(moving):
            where = rows.where(int(moving[0] if len(moving) else of_pose[0]))
            raise InputError(
                f"{table.file}: column 'pose': found {len(found)} series for pose {pose}, expected {len(moving)}: "
                f"{where} is a move to it"
            )
        out |= dict(zip((int(row) for row in moving), moving_series, strict=True))
    return dict(sorted(out.items()))


def shared_levels(moves: Sequence[Move]) -> Levels | None:
    """Levels of the moves that show their own, for those that span too few fringes."""
    good = [move.count.levels for move in moves if not move.faults]
    if not good:
        return None
    low, high = np.array([(levels.low.mean(), levels.high.mean()) for levels in good]).T
    size = float(np.median(high - low))
    spread = max(float(np.median(np.abs(end - np.median(end)))) for end in (low, high))
    sigma = max(1.4826 * spread / size, 0.001 if len(good) > 1 else 0.01)
    return Levels(np.zeros(1), np.array([np.median(low)]), np.array([np.median(high)]), sigma)


def with_lengths(rows: Recording, found: Readings) -> Recording:
    """Return the recording with dL; a row that was left out refers to itself, so that it says nothing."""
    assert rows.from_row is not None
    origin = np.where(found.left_out, np.arange(len(rows)), rows.from_row)
    for array in (origin, found.change):
        array.setflags(write=False)
    observations = {**rows.observations, "dL": found.change}
    return replace(rows, observations=observations, from_row=origin, notes=(*rows.notes, *found.notes))
