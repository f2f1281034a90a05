"""What the sensors should have read, row by row, with the 1-sigma of the model.

``predict`` uses the machine's own effects with the recording's drivers. The 1-sigma is that of the model
alone, without the sensor's noise (``truepose.identification.prediction.predict``).

How far the model may be off, column by column: parameters, what no parameter explains, and rows that were never seen.

The variance of a column is J C J', C from the file's ``covariance:`` for what it names and from tolerances for the
rest; plus the square of what the fit left ``unexplained`` in that kind of reading; plus, outside of what was seen, what
forms without a name (``empirical``) and the errors of form of named effects may be there. What is unexplained of
rotations is that of a small turn; a column of a rotation vector near half a turn moves more than that.

A recording as the machine would give it: its own effects, some more, and the sensor's noise.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.prediction.covariance import Covariance, covariance_of_file
from truepose.identification.prediction.outside import outside_notes
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prediction.sensor_rows import TOGETHER
from truepose.identification.prior import FORM_ERROR
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.common import sensor_names
from truepose.models.effects.empirical import Empirical
from truepose.models.file.driver import ROW, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXIS_UNITS
from truepose.models.machine.seen import Range, drivers_of, ranges_of_file, values_of
from truepose.models.sensors.base import Sensor
from truepose.models.units import convert
from truepose.wording import joined

LEAST_RANGE = 1e-6
"""Half of a range that is taken for a driver that was never varied."""


def column_std(predictor: Predictor, values: Array, jacobian: Array) -> Array:
    """(n, k) 1-sigma of the sensors' columns from their values (n, k) and derivatives by p (n, k, np)."""
    machine, p_sigma = predictor.machine, _stated(predictor)
    names = predictor.model.names
    variance = _beyond(predictor, values, jacobian)
    left = np.flatnonzero(p_sigma > 0)
    coefficients = [c.scale for e in machine.effects for c in e.coefficients]
    scales = np.array([*(p.scale for p in machine.parameters), *coefficients])
    known = covariance_of_file(machine)
    if known is not None:
        missing = [name for name in known.names if name not in names]
        if missing:
            assert machine.file is not None
            raise InputError(
                f"{machine.file.path}: covariance.names: found {missing[0]!r}, no parameter of this machine"
            )
        at = np.array([names.index(name) for name in known.names], dtype=int)
        variance += known.std(jacobian[..., at], scales[at]) ** 2
        variance += np.where(np.any(jacobian != 0.0, axis=2), _unexplained(machine, known), 0.0)
        left = np.setdiff1d(left, at)
    stated = Covariance.of_tolerances([names[k] for k in left], p_sigma[left])
    return np.asarray(np.sqrt(variance + stated.std(jacobian[..., left], scales[left]) ** 2))


def _unexplained(machine: Machine, known: Covariance) -> Array:
    """(k,) variance of each column that no parameter explains."""
    out = []
    for name, sensor in zip(sensor_names(machine), machine.sensors, strict=True):
        kinds = [_kinds(sensor)[unit] for unit in sensor.columns.values()]
        out += [known.unexplained.get(f"{name}.{kind}", (0.0, ""))[0] ** 2 for kind in kinds]
    return np.array(out)


def _kinds(sensor: Sensor) -> dict[str, str]:
    """The kind of reading (position, rotation, distance) by unit; each sensor has one of a unit."""
    kinds = {channel.unit: channel.kind for channel in reversed(sensor.channels)}
    return {unit: kinds.get(unit, "") for unit in sensor.columns.values()}


def _beyond(predictor: Predictor, values: Array, jacobian: Array) -> Array:
    """(n, k) variance that effects have where they were not seen.

    Held at the end of its range, a form without a name of amplitude c is off by the change of a random curve of that
    size since there: variance 2 c^2 (1 - exp(-o)), o the overshoot in halves of the range. It grows like a random walk at
    once and ends at that of two values that know nothing of each other. So does the error of form of a named effect, a
    tenth of its signal, of which the fitted rows know nothing out there.
    """
    machine, model = predictor.machine, predictor.model
    values_at = values_of(model, predictor.q, predictor.z)
    at = dict(zip((*model.readings, *model.drivers), values_at.T, strict=True))
    columns = [name for sensor in machine.sensors for name in sensor.columns]
    at |= dict(zip(columns, values.T, strict=True))
    out, first = np.zeros(values.shape), len(machine.parameters)
    seen = ranges_of_file(machine)
    for effect in machine.effects:
        own = slice(first, first + len(effect.coefficients))
        first = own.stop
        form, over = effect.effect, None
        if isinstance(form, Empirical):
            over = form.overshoot(machine, effect.place, effect.settings_map, at)
        if over is None:
            over = _outside(seen, at, {*model.readings, *drivers_of(machine, effect)})
        signal = jacobian[..., own] * effect.amplitudes
        moved = (
            np.sum(signal**2, axis=2)
            if isinstance(form, Empirical)
            else (FORM_ERROR * np.sum(signal, axis=2)) ** 2
        )
        out += -2.0 * np.expm1(-over)[:, None] * moved
    return out


def _outside(seen: Mapping[str, Range], at: Mapping[str, Array], sources: Collection[str]) -> Array:
    """(n,) how far values of sources lie outside of what was seen, in halves of each range; 0 where nothing is known."""
    out = np.zeros(len(next(iter(at.values()))))
    for name in sources:
        if name in seen and name in at:
            low, high = seen[name]
            half = max((high - low) / 2, LEAST_RANGE)
            out += np.maximum(np.abs(at[name] - (low + high) / 2) / half - 1.0, 0.0)
    return out


def _stated(predictor: Predictor) -> Array:
    """(np,) 1-sigma as the file states it: tolerances, and the ``std`` of effects."""
    machine = predictor.machine
    sigma = [parameter.tolerance for parameter in machine.parameters]
    specs = machine.file.effects if machine.file else ()
    for k, effect in enumerate(machine.effects):
        spec = specs[k] if k < len(specs) else None
        for c in effect.coefficients:
            known = spec is not None and spec.effect == effect.effect.slug
            sigma.append((spec.std_of(c.name, c.unit) if spec and known else None) or 0.0)
    return np.array(sigma)


POSE = ("pose.x", "pose.y", "pose.z", "pose.rx", "pose.ry", "pose.rz")


@dataclass(frozen=True)
class Prediction:
    """Values and 1-sigma (n, k) of columns in internal units, poses (n, 4, 4); NaN where not ``good``."""

    columns: Mapping[str, str]
    values: Array
    std: Array | None
    poses: Array
    good: Mask


def predict(machine: Machine, recording: Recording) -> pd.DataFrame:
    """One row for each row, in order: sensor columns, ``<column>.std``, pose.x ... pose.rz (rotation vector).

    The recording needs no readings. Columns are in the units of the
    machine file. Rows that cannot be assembled are NaN (see ``unassembled``).
    """
    found = predicted(predictor_for(machine, recording))
    units = machine.units
    assert found.std is not None
    data: dict[str, Array] = {}
    for k, (name, unit) in enumerate(found.columns.items()):
        data[name] = convert(found.values[:, k], unit, units.written(unit))
        data[f"{name}.std"] = convert(found.std[:, k], unit, units.written(unit))
    turns = np.full((len(recording), 3), np.nan)
    turns[found.good] = lie.log_so3(found.poses[found.good, :3, :3])
    pose = np.hstack([found.poses[:, :3, 3], turns])
    for name, values, unit in zip(POSE, pose.T, AXIS_UNITS.values(), strict=True):
        data[name] = convert(values, unit, units.written(unit))
    return pd.DataFrame(data)


def predictor_for(machine: Machine, recording: Recording, visits: int = 1) -> Predictor:
    """Predictor with the machine's effects, whose sessions are those of the fit that wrote the file; ``visits`` as there."""
    known = machine.file.sessions if machine.file else ()
    predictor = Predictor(machine, recording, machine.effects, visits=visits)
    for k, name in enumerate(predictor.model.drivers):
        if name == ROW and not _is_the_fitted(machine, recording):
            predictor.z[:, k] = predictor.model.z_home[k]
        recorded = recording.driver(name, known) if known and name != ROW else None
        if recorded is not None:
            predictor.z[:, k] = recorded
    return predictor


def predicted(predictor: Predictor, *, with_std: bool = True) -> Prediction:
    """Values at the machine's own parameters; ``with_std=False`` leaves the 1-sigma out."""
    machine, p = predictor.machine, predictor.model.p_home
    columns = {name: unit for sensor in machine.sensors for name, unit in sensor.columns.items()}
    if any(sensor.differs_from_row for sensor in machine.sensors) and predictor.recording.from_row is None:
        raise InputError(
            f"{', '.join(predictor.recording.files)}: missing column 'from', which a change counts from"
        )
    x, good = predictor.assemble(p)
    x[~good] = predictor.model.home
    parts = [_of_some(predictor.of_rows(rows), p, x[rows], with_std) for rows in _parted(machine, len(x))]
    values, poses, std = (None if own[0] is None else np.concatenate(own) for own in zip(*parts, strict=True))
    assert values is not None
    assert poses is not None
    good = _complete(machine, predictor.recording, good)
    values, poses = np.where(good[:, None], values, np.nan), np.where(good[:, None, None], poses, np.nan)
    return Prediction(
        columns, values, None if std is None else np.where(good[:, None], std, np.nan), poses, good
    )


def _parted(machine: Machine, rows: int) -> list[Index]:
    """Rows that are predicted together: all where a reading compares rows, else some at a time, for their derivatives."""
    step = max(rows, 1) if any(s.compares or s.differs_from_row for s in machine.sensors) else TOGETHER
    return [np.arange(start, min(start + step, rows)) for start in range(0, max(rows, 1), step)]


def _of_some(predictor: Predictor, p: Array, x: Array, with_std: bool) -> tuple[Array, Array, Array | None]:
    """Values (n, k), poses (n, 4, 4) and, where they are wanted, 1-sigmas (n, k) of the predictor's rows."""
    if not with_std:
        _, values, poses = predictor.values(p, x)
        return values, poses, None
    _, values, jacobian, poses = predictor.columns(p, x)
    return values, poses, column_std(predictor, np.nan_to_num(values), np.nan_to_num(jacobian))


def unassembled(recording: Recording, frame: pd.DataFrame) -> list[str]:
    """A note for each row that has no prediction."""
    rows = np.flatnonzero(frame[POSE[0]].isna().to_numpy())
    why = "the mechanism cannot be assembled there; the row is empty"
    return [f"{recording.where(int(k))}: {why}" for k in rows]


def notes_outside(machine: Machine, recording: Recording) -> tuple[str, ...]:
    """Return a note on rows that lie outside of what the calibration saw."""
    predictor = predictor_for(machine, recording)
    return outside_notes(predictor.model, predictor.q, predictor.z, recording.where, of_tool=False)


def unheard(machine: Machine, recording: Recording) -> list[str]:
    """A note for each driver that the effects read and the rows do not log: it stands at its default."""
    late = any(ROW in effect.drivers for effect in machine.effects) and not _is_the_fitted(machine, recording)
    drifted = "what drifted in the order of the fitted rows is predicted as it was at their end"
    ended = [drifted] if late else []
    missing = [n for effect in machine.effects for n in effect.drivers if recording.driver(n) is None]
    columns = dict.fromkeys(Driver.of(name).column for name in missing if name != ROW)
    return ended + [f"no column {name!r}: effects that depend on it see its default" for name in columns]


def _is_the_fitted(machine: Machine, recording: Recording) -> bool:
    """Whether rows without a clock may be those that the file was fitted to: there are as many. Others come later."""
    known = covariance_of_file(machine)
    if known is None:
        return True
    seen, place = known.seen.get(ROW), recording.whole.driver(ROW)
    return place is not None and (seen is None or float(np.min(place)) == seen[0])


def unknown_frames(machine: Machine, recording: Recording) -> list[str]:
    """A note for each session that the fit has not seen, where the machine's frames are set up anew for each session."""
    known = machine.file.sessions if machine.file else ()
    if not machine.set_up or not known:
        return []
    whose, out = joined(machine.set_up), list[str]()
    unseen = ~recording.session_recorded | ~np.isin(recording.session, known)
    for number in np.unique(recording.session[unseen]).tolist():
        row = int(np.flatnonzero(unseen & (recording.session == number))[0])
        out.append(
            f"{recording.where(row)}: session {number} was not in the fit, so where its {whose} stood is not known: "
            f"predicted as in session {max(known)}; truepose calibrate --only {','.join(machine.set_up)} finds it"
        )
    return out


def _complete(machine: Machine, recording: Recording, good: Mask) -> Mask:
    """A change is known only when the row it counts from is known too."""
    if recording.from_row is not None and any(sensor.differs_from_row for sensor in machine.sensors):
        return good & good[recording.from_row]
    return good


def simulate(
    machine: Machine,
    poses: Recording,
    extra: Sequence[PlacedEffect] = (),
    *,
    seed: int | None = 0,
) -> pd.DataFrame:
    """The sensor's columns for every row of ``poses``, in the machine file's units.

    Noise is the instrument's, drawn from ``seed``; None leaves it out. Raises InputError naming the first row
    that cannot be assembled, and a column of labels that a sensor without readings needs.
    """
    _check_labels(machine, poses)
    predictor = predictor_for(machine.with_effects((*machine.effects, *extra)), poses)
    found = predicted(predictor, with_std=False)
    if not found.good.all():
        row = int(np.flatnonzero(~found.good)[0])
        raise InputError(f"{poses.where(row)}: the mechanism cannot be assembled there; mend or drop the row")
    rng = np.random.default_rng(0 if seed is None else seed)
    units = machine.units
    data: dict[str, Array] = {}
    offset = 0
    for sensor in machine.sensors:
        values = found.values[:, offset : offset + len(sensor.columns)]
        offset += len(sensor.columns)
        read = values if seed is None else sensor.noisy(values, rng)
        if sensor.differs_from_row and poses.from_row is not None:  # a change since itself is nothing
            read = np.where((poses.from_row == np.arange(len(poses)))[:, None], 0.0, read)
        for k, (name, unit) in enumerate(sensor.columns.items()):
            data[name] = convert(read[:, k], unit, units.written(unit))
    return pd.DataFrame(data)


def _check_labels(machine: Machine, poses: Recording) -> None:
    for sensor in machine.sensors:
        for name in sensor.label_columns:
            if name not in poses.labels:
                raise InputError(
                    f"{', '.join(poses.files)}: missing column {name!r}, which the sensor {sensor.type} needs"
                )


def with_inputs(table: Table, simulated: pd.DataFrame) -> pd.DataFrame:
    """The columns of a table of poses as they stand, then the simulated readings in place of its own."""
    kept = {}
    for column in table.columns:
        if column.name not in simulated:
            kept[column.header] = list(table.cells[column.name])
    return pd.concat([pd.DataFrame(kept), simulated], axis=1)
