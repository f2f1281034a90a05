"""Photocurrents of a recording's moves as its column ``dL``: counted, signed, checked, or left out with a note."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.identification.leaves.fringes.closure import miscounted
from truepose.identification.leaves.fringes.faults import Fault
from truepose.identification.leaves.fringes.levels import Levels
from truepose.identification.leaves.fringes.move import Move, read_move
from truepose.identification.leaves.fringes.photocurrent import SampleTable, Series, read_samples
from truepose.identification.prediction.predict import predicted, predictor_for
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine
from truepose.models.sensors.irradiance import Irradiance

_ODDS = 4.6  # log of the odds (99 to 1) from which on the model's sign is taken
_COARSE = 3.0  # times the sensor's sigma: changes known less well are left out
_SHOWN = 12


@dataclass(frozen=True)
class ReadLengths:
    """``dL`` (n,) in mm with its 1-sigma; ``left_out`` (n,): rows that carry no reading; what there is to say."""

    change: Array
    sigma: Array
    left_out: Mask
    notes: tuple[str, ...]


def read_fringes(
    machine: Machine,
    rows: Recording,
    tables: dict[int, Path],
    progress: Callable[[str], None] | None = None,
) -> ReadLengths:
    """ReadLengths of the rows whose source file (an index into ``rows.files``) has a table of samples.

    The sign comes from the table's column ``sign``, from scans of the wavelength, or from the machine's nominal
    constants where they leave little doubt. Rows of other files are 0 and not left out. Raises InputError naming
    file, row and pose where samples are missing or are no series.
    """
    sensor = sensor_of(machine)
    units = machine.units
    work = Readings(machine, sensor, rows)
    for index, path in tables.items():
        work.read(index, read_samples(path, units), progress or (lambda _: None))
    work.close()
    return ReadLengths(work.change, work.sigma, work.left_out, tuple(work.notes))


def sensor_of(machine: Machine) -> Irradiance:
    """The machine's sensor of type irradiance. InputError when it has none."""
    for sensor in machine.sensors:
        if isinstance(sensor, Irradiance):
            return sensor
    where = f"{machine.file.path}: " if machine.file else ""
    kinds = ", ".join(sensor.type for sensor in machine.sensors) or "none"
    raise InputError(f"{where}sensor: found {kinds}, expected one of type irradiance for --irradiance")


class Readings:
    """ReadLengths as they come in: change and its 1-sigma (n,) in mm, rows that are left out (n,), notes."""

    def __init__(self, machine: Machine, sensor: Irradiance, rows: Recording) -> None:
        self.machine, self.sensor, self.rows = machine, sensor, rows
        self.change, self.sigma = np.zeros(len(rows)), np.zeros(len(rows))
        self.left_out = np.zeros(len(rows), dtype=bool)
        self.notes: list[str] = []

    def read(self, index: int, table: SampleTable, progress: Callable[[str], None]) -> None:
        """All moves of one file."""
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
            which = listed_rows([self.rows.source_row[row] for row in by_model])
            self.notes.append(
                f"{self.rows.files[index]}: the sign of dL in {which} is that of the nominal machine: {table.file} "
                "has no scan of the wavelength there that tells"
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
        where = f"{self.rows.where(row)}"
        why = [fault.value for fault in move.faults]
        coarse = _COARSE * self.sensor.sigma
        if not why and 0.0 < coarse < move.sigma:
            why.append(
                f"dL is known to {1e6 * move.sigma:.1f} nm only, and sigma is {coarse / _COARSE * 1e6:.3g} nm"
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
            self.notes.append(f"{where}: left out (samples from row {one.row} on): {reason}")
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
    low, high = (
        np.array([levels.low.mean() for levels in good]),
        np.array([levels.high.mean() for levels in good]),
    )
    size = float(np.median(high - low))
    spread = max(float(np.median(np.abs(end - np.median(end)))) for end in (low, high))
    sigma = max(1.4826 * spread / size, 0.001 if len(good) > 1 else 0.01)
    return Levels(np.zeros(1), np.array([np.median(low)]), np.array([np.median(high)]), sigma)


def listed_rows(numbers: Sequence[int]) -> str:
    """The first of some rows in words, and how many more there are."""
    shown = ", ".join(str(number) for number in numbers[:_SHOWN])
    more = f" and {len(numbers) - _SHOWN} more" if len(numbers) > _SHOWN else ""
    return f"row{'s' if len(numbers) > 1 else ''} {shown}{more}"


def with_lengths(rows: Recording, found: ReadLengths) -> Recording:
    """The recording with dL; a row that was left out refers to itself, so that it says nothing."""
    assert rows.from_row is not None
    origin = np.where(found.left_out, np.arange(len(rows)), rows.from_row)
    for array in (origin, found.change):
        array.setflags(write=False)
    observations = {**rows.observations, "dL": found.change}
    return replace(rows, observations=observations, from_row=origin, notes=(*rows.notes, *found.notes))
