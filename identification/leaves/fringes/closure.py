"""Returns to a pose: the changes of length along the way must add up to nothing, or a fringe was miscounted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from truepose.arrays import Array, Index, Mask
from truepose.identification.recording.recording import Recording

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
    order = rows.order
    first: dict[tuple[int, int], int] = {}
    for row in order.tolist():
        place = int(label[row]), int(root[row])
        before = first.setdefault(place, row)
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
