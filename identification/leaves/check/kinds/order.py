"""Readings beside the wrong rows: shifted by some rows, or sorted by themselves."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from truepose.identification.fit.align import rigid_motion
from truepose.identification.leaves.check.pair import SELDOM, Scene, Sheet, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.models.sensors.pose import Pose, Position
from truepose.models.sensors.targets import Targets
from truepose.wording import shortened

Array = NDArray[np.float64]
_FURTHEST = 3
_MOST_SORTED = 400
_ROUNDS, _TRIED = 12, 3


def shifted(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Readings that stand up to three rows too early or too late, or in the opposite order."""
    columns = _columns(rig)
    if len(scene.rows) < 4 + _FURTHEST or scene.rows.from_row is not None:
        return
    yield from (_shift(columns, by) for by in (1, -1, 2, -2, 3, -3))
    if len(scene.rows.files) == 1:
        yield Slip(
            "rows-shifted",
            columns,
            "readings from the last row to the first",
            f"turn {shortened(columns, 3)} round, against the joints",
            lambda scene: scene.with_readings_of(np.arange(len(scene.rows))[::-1]),
            lambda pair: pair.each(lambda s: s.with_cells_of(columns, np.arange(len(s.cells))[::-1])),
            between=True,
        )


def _shift(columns: tuple[str, ...], by: int) -> Slip:
    """Readings that stand some rows too late, or too early: of a sheet, rows without a reading are taken out."""

    def change(scene: Scene) -> Scene:
        source, lost = _places(scene.rows.source_file, by)
        return scene.with_readings_of(source).without(lost)

    def mend(sheet: Sheet) -> Sheet:
        source, lost = _places(np.zeros(len(sheet.cells), dtype=np.int64), by)
        return sheet.with_cells_of(columns, source).rows(np.flatnonzero(~lost))

    rows = f"{abs(by)} row{'s' if abs(by) > 1 else ''}"
    return Slip(
        "rows-shifted",
        columns,
        f"readings {rows} {'too late' if by > 0 else 'too early'}",
        f"move {shortened(columns, 3)} {rows} {'up' if by > 0 else 'down'}, against the joints",
        change,
        lambda pair: pair.each(mend),
        between=True,
    )


def _columns(rig: Rig) -> tuple[str, ...]:
    return tuple(n for s in rig.machine.sensors for n in s.columns)


def _places(file: NDArray[np.int64], by: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """For each row the row that its readings stand in, and which have none, file by file."""
    n = len(file)
    source = np.arange(n) + by
    inside = (source >= 0) & (source < n)
    source = np.clip(source, 0, n - 1)
    return source, ~(inside & (file[source] == file))


def matched(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Where a column is sorted: each reading beside the row that it fits, by assignment and rigid motion in turns."""
    rows = scene.rows
    sorted_by = [n for n, v in rows.observations.items() if _monotone(v)]
    sorted_by += [n for n, v in zip(rows.joints, rows.q.T, strict=True) if _monotone(v)]
    points = _points(rig, scene)
    if not sorted_by or points is None or not 8 <= len(rows) <= _MOST_SORTED or len(rows.files) > 1:
        return
    order = _assigned(rig, scene, points)
    if order is None:
        return
    columns = _columns(rig)
    yield Slip(
        "rows-shifted",
        tuple(sorted_by),
        f"rows sorted by {shortened(sorted_by, 2)} in some of the columns only",
        "put readings and joints back into one order",
        lambda scene: scene.with_readings_of(order),
        lambda pair: pair.each(lambda sheet: sheet.with_cells_of(columns, order)),
        SELDOM,
        between=True,
    )


def _monotone(values: Array) -> bool:
    steps = np.diff(values)
    return bool(len(values) >= 8 and np.ptp(values) > 0 and ((steps >= 0).all() or (steps <= 0).all()))


def _points(rig: Rig, scene: Scene) -> Array | None:
    for sensor in rig.machine.sensors:
        if isinstance(sensor, (Pose, Position, Targets)):
            return np.column_stack([scene.rows.observations[n] for n in [*sensor.columns][:3]])
    return None


def _assigned(rig: Rig, scene: Scene, points: Array) -> NDArray[np.intp] | None:
    """The row whose reading belongs to each row: the best of several attitudes, then with base and tool fitted."""
    here = rig.predictor.over(scene.rows)
    x, _ = rig.assembled(here, scene.p, scene)
    drawn = here.poses(scene.p, x)[0][:, :3, 3]
    ends = [_in_turns(drawn, points, *attitude) for attitude in _attitudes(drawn, points)]
    best, chosen = np.inf, None
    for _, start in sorted(ends, key=lambda end: end[0])[:_TRIED]:
        order = start
        for _ in range(_ROUNDS):
            stand = rig.stand(scene.with_readings_of(order))
            if stand.misfit < best:
                best, chosen = stand.misfit, order
            if stand.bad:
                break
            seen = here.poses(stand.p, x)[0][:, :3, 3]
            fresh = linear_sum_assignment(cdist(seen, points) ** 2)[1]
            if (fresh == order).all():
                break
            order = fresh
    return chosen


def _in_turns(drawn: Array, points: Array, rotation: Array, shift: Array) -> tuple[float, NDArray[np.intp]]:
    """Assignment and rigid motion in turns, from an attitude; the sum of squares that it leaves, and the order."""
    order = np.arange(len(drawn))
    for _ in range(_ROUNDS):
        fresh = linear_sum_assignment(cdist(drawn @ rotation.T + shift, points) ** 2)[1]
        rotation, shift = rigid_motion(drawn, points[fresh])
        if (fresh == order).all():
            break
        order = fresh
    rotation, shift = rigid_motion(drawn, points[order])
    return float(np.sum((drawn @ rotation.T + shift - points[order]) ** 2)), order


def _attitudes(drawn: Array, points: Array) -> Iterator[tuple[Array, Array]]:
    """As they stand, and with the main axes of both clouds brought together, every way round."""
    yield np.eye(3), points.mean(axis=0) - drawn.mean(axis=0)
    yield np.eye(3), np.zeros(3)
    a = np.linalg.svd(drawn - drawn.mean(axis=0), full_matrices=False)[2].T
    b = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2].T
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = (b[:, order] * np.array(signs)) @ a.T
            if np.linalg.det(turn) > 0:
                yield turn, points.mean(axis=0) - turn @ drawn.mean(axis=0)
