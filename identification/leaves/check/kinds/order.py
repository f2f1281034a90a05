"""Readings beside the wrong rows: shifted by some rows, or sorted by themselves."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from truepose.arrays import Array, Index, Mask
from truepose.identification.fit.align import rigid_motion
from truepose.identification.leaves.check.kinds.joints import narrowed
from truepose.identification.leaves.check.pair import RARE, SELDOM, Pair, Scene, Sheet, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.models.sensors.pose import Pose, Position
from truepose.models.sensors.targets import Targets
from truepose.models.units import convert
from truepose.wording import shortened

# -- Joints that were read at another time than the sensor, or not at all for a while

_CLOCKS = 16.0
"""Steps of time that clocks may differ by."""
_FEWEST = 8
"""Rows in which a joint stands still, or moves, to be told."""


def clocks(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Yield joints that were read at another time than the sensor, where the rows have times."""
    time, files = scene.rows.time, len(scene.rows.files)
    if time is None or files > 1 or scene.rows.from_row is not None or len(time) < 8:
        return
    steps = np.diff(time)
    if not (steps > 0).all():
        return
    # what is left is to be most of the rows: few of them fit anything
    longest = min(_CLOCKS * float(np.median(steps)), float(time[-1] - time[0]) / 2.0)
    half = np.geomspace(longest / 64, longest, 9)

    def misfit(late: float) -> float:
        return rig.stand(_delayed(late, scene), quick=True).misfit

    late = narrowed(misfit, np.concatenate([-half[::-1], [0.0], half]))
    if late == 0.0:
        return
    yield Slip(
        "clock",
        ("time",),
        f"the clocks of joints and readings differ: the readings are {abs(late):.3g} s {'late' if late > 0 else 'early'}",
        "record both by one clock, or measure at rest",
        partial(_delayed, late),
        partial(_mend_clock, scene.rows.joints, late),
        RARE,
        between=True,
    )


def _delayed(late: float, scene: Scene) -> Scene:
    """The joints as they were when the readings were taken, ``late`` seconds before their own rows."""
    time = scene.rows.time
    if time is None:
        return scene
    then = time - late
    q = np.column_stack([np.interp(then, time, column) for column in scene.rows.q.T])
    lost = (then < time[0]) | (then > time[-1])
    return scene.with_joints(q).without(lost)


def _mend_clock(joints: tuple[str, ...], late: float, pair: Pair) -> Pair:
    def change(sheet: Sheet) -> Sheet:
        if "time" not in sheet.units:
            return sheet
        unit = sheet.units["time"] or "s"
        time = convert(sheet.numbers("time"), unit, "s")
        then = time - late
        moved = {n: np.interp(then, time, sheet.numbers(n)) for n in joints if n in sheet.units}
        return sheet.with_numbers(moved).rows(np.flatnonzero((then >= time[0]) & (then <= time[-1])))

    return pair.each(change)


def stands_still(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Yield joints that stand still for a run of rows while the others move, as if they had not been logged there."""
    rows = scene.rows
    moved = np.any(np.diff(rows.q, axis=0) != 0.0, axis=1)
    for name, column in zip(rows.joints, rows.q.T, strict=True):
        first, last = _longest_run(column)
        others = moved[first:last]
        if last + 1 - first < _FEWEST or len(column) - (last + 1 - first) < _FEWEST or not others.all():
            continue
        run = np.zeros(len(column), dtype=bool)
        run[first : last + 1] = True
        numbers = rows.source_row[[first, last]].tolist()
        yield Slip(
            "joint-stands-still",
            (name,),
            f"{name} stands still from row {numbers[0]} to row {numbers[1]} ({int(run.sum())} of {len(run)} rows), where the "
            "others move: it was not logged there",
            f"log {name} there, or take these rows out",
            partial(Scene.without, lost=run),
            partial(Pair.each, change=partial(Sheet.rows, places=np.flatnonzero(~run))),
            SELDOM,
            between=True,
        )


def _longest_run(column: Array) -> tuple[int, int]:
    """Return the first and the last row of the longest run of equal values (n,)."""
    starts = np.flatnonzero(np.r_[True, np.diff(column) != 0.0, True])
    k = int(np.argmax(np.diff(starts)))
    return int(starts[k]), int(starts[k + 1]) - 1


# -- Readings beside the wrong rows: shifted by some rows, or sorted by themselves

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
    says = f"readings {rows} {'too late' if by > 0 else 'too early'}"
    fix = f"move {shortened(columns, 3)} {rows} {'up' if by > 0 else 'down'}, against the joints"
    return Slip("rows-shifted", columns, says, fix, change, lambda pair: pair.each(mend), between=True)


def _columns(rig: Rig) -> tuple[str, ...]:
    return tuple(n for s in rig.machine.sensors for n in s.columns)


def _places(file: NDArray[np.int64], by: int) -> tuple[Index, Mask]:
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


def _assigned(rig: Rig, scene: Scene, points: Array) -> Index | None:
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


def _in_turns(drawn: Array, points: Array, rotation: Array, shift: Array) -> tuple[float, Index]:
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
