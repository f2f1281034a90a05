"""Joints that were read at another time than the sensor, or not at all for a while."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from truepose.identification.leaves.check.kinds.joints import narrowed
from truepose.identification.leaves.check.pair import RARE, SELDOM, Pair, Scene, Sheet, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.models.units import convert

Array = NDArray[np.float64]
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
            partial(_without, run),
            partial(_mend_run, np.flatnonzero(~run)),
            SELDOM,
            between=True,
        )


def _longest_run(column: Array) -> tuple[int, int]:
    """Return the first and the last row of the longest run of equal values (n,)."""
    starts = np.flatnonzero(np.r_[True, np.diff(column) != 0.0, True])
    k = int(np.argmax(np.diff(starts)))
    return int(starts[k]), int(starts[k + 1]) - 1


def _without(run: NDArray[np.bool_], scene: Scene) -> Scene:
    return scene.without(run)


def _mend_run(kept: NDArray[np.intp], pair: Pair) -> Pair:
    return pair.each(lambda sheet: sheet.rows(kept))
