"""Laws of returns: the changes between a pose and its return add up to nothing, or a fringe was miscounted on the way."""

from __future__ import annotations

import numpy as np
import pytest

from support.fringe_series import joined_rows
from truepose.arrays import Array
from truepose.identification.leaves.fringes.lengths import miscounted
from truepose.identification.recording.recording import Recording

HALF_WAVE = 7.8e-4


def way(poses: list[int], change: Array) -> Recording:
    """Moves from row to row through these poses."""
    return joined_rows(poses, [0, *range(len(poses) - 1)], poses, change)


def round_trip(miss: float) -> Recording:
    """Five moves out and back to the first pose, which add up to nothing but for one that is off by ``miss`` mm."""
    return way([0, 1, 2, 3, 4, 0], np.array([0.0, 0.01, 0.02 + miss, -0.005, 0.03, -0.055]))


@pytest.mark.parametrize(
    ("counts", "left_out"), [(0.0, False), (0.02, False), (1.0, True), (-3.03, True), (0.5, False)]
)
def test_a_return_that_misses_by_whole_counts_leaves_its_way_out(counts: float, left_out: bool) -> None:
    rows = round_trip(counts * HALF_WAVE)
    read = np.arange(6) > 0
    bad, notes = miscounted(rows, rows.observations["dL"], np.full(6, 1e-6), read, HALF_WAVE)
    assert bad.tolist() == [False, *[left_out] * 5]
    assert len(notes) == (abs(counts) >= 0.25)
    if left_out:
        assert f"{round(counts):+d} counts: a miscount in one of rows 2, 3, 4, 5, 6, left out" in notes[0]
        assert notes[0].startswith("rows.csv: row 6: back at the pose of row 1")
    if counts == 0.5:
        assert "no whole counts: the mirror did not come back" in notes[0]
    unread = read & (np.arange(6) != 4)  # the chain is broken: nothing returns
    assert not miscounted(rows, rows.observations["dL"], np.full(6, 1e-6), unread, HALF_WAVE)[0].any()


@pytest.mark.parametrize(("counts", "left_out"), [(1.0, True), (1.04, True), (1.07, False), (-0.96, True)])
def test_a_return_on_the_way_leaves_out_what_lies_between(counts: float, left_out: bool) -> None:
    """From the second pose by two others back to it, by whole counts to a twentieth of one."""
    change = np.array([0.0, 0.02, 0.01, -0.03, 0.02, 0.04])
    change[3] += counts * HALF_WAVE
    rows = way([0, 1, 2, 3, 1, 4], change)
    bad, notes = miscounted(rows, change, np.full(6, 1e-6), np.arange(6) > 0, HALF_WAVE)
    assert bad.tolist() == [False, False, *[left_out] * 3, False]
    (note,) = notes
    assert note.startswith("rows.csv: row 5: back at the pose of row 2")
    assert ("a miscount in one of rows 3, 4, 5, left out" in note) is left_out
