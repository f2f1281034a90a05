"""What the sensors should have read, row by row, with the 1-sigma of the model.

``predict`` uses the machine's own effects with the recording's drivers. The 1-sigma is that of the model
alone, without the sensor's noise (``truepose.identification.prediction.spread``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.prediction.blocks import TOGETHER
from truepose.identification.prediction.covariance import Covariance
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prediction.spread import column_std
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.file.driver import ROW, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXIS_UNITS
from truepose.models.units import convert
from truepose.wording import joined

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


def predictor_for(machine: Machine, recording: Recording) -> Predictor:
    """Predictor with the machine's effects, whose sessions are those of the fit that wrote the file."""
    known = machine.file.sessions if machine.file else ()
    predictor = Predictor(machine, recording, machine.effects)
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
    return [
        f"{recording.where(int(k))}: the mechanism cannot be assembled there; the row is empty" for k in rows
    ]


def unheard(machine: Machine, recording: Recording) -> list[str]:
    """A note for each driver that the effects read and the rows do not log: it stands at its default."""
    late = any(ROW in effect.drivers for effect in machine.effects) and not _is_the_fitted(machine, recording)
    ended = (
        ["what drifted in the order of the fitted rows is predicted as it was at their end"] if late else []
    )
    missing = [n for effect in machine.effects for n in effect.drivers if recording.driver(n) is None]
    columns = dict.fromkeys(Driver.of(name).column for name in missing if name != ROW)
    return ended + [f"no column {name!r}: effects that depend on it see its default" for name in columns]


def _is_the_fitted(machine: Machine, recording: Recording) -> bool:
    """Whether rows without a clock may be those that the file was fitted to: there are as many. Others come later."""
    if machine.file is None or machine.file.covariance is None:
        return True
    seen = Covariance.read(machine.file.covariance, f"{machine.file.path}: covariance").seen.get(ROW)
    place = recording.whole.driver(ROW)
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
