"""Which counted moves become readings, with which sign, and what is said of those, and of returns, that are left out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import norm

from support.command import input_error
from support.fringe_series import joined_rows
from truepose.arrays import Array
from truepose.identification.leaves.fringes import lengths
from truepose.identification.leaves.fringes.count import Count, End
from truepose.identification.leaves.fringes.excursions import Fault
from truepose.identification.leaves.fringes.lengths import SampleTable, Series, miscounted
from truepose.identification.leaves.fringes.levels import Levels
from truepose.identification.leaves.fringes.move import Move
from truepose.identification.recording.recording import Recording
from truepose.models.sensors.irradiance import Irradiance

BASE, SIGMA = 1.56e-3, 1e-5
NOWHERE = End(False, 0.0, 0.01, 0.0)
COUNT = Count(0.0, NOWHERE, NOWHERE, 0, Levels(np.zeros(1), np.zeros(1), np.ones(1)), 0.01, 0, ())


def recording(pose: list[int], origin: list[int], time: list[float] | None = None) -> Recording:
    n = len(pose)
    return joined_rows(pose, origin, range(n), np.zeros(n), time)


def work(rows: Recording | None = None) -> lengths.Readings:
    """Four rows in a chain, and a cavity of sigma 10 nm."""
    sensor = Irradiance((), SIGMA, True, BASE, (0.04, 0.9))
    return lengths.Readings(cast("Any", None), sensor, rows or recording([0, 1, 2, 3], [0, 0, 1, 2]))


def one(sign: int | None = None, row: int = 1) -> Series:
    return Series(row, np.zeros(0), np.zeros(0), None, sign)


def moved(change: float, sigma: float = 1e-6, *, signed: bool = True, faults: tuple[Fault, ...] = ()) -> Move:
    return Move(change, sigma, signed, COUNT, faults)


def taken(
    change: float, sign: int | None = None, sigma: float = 1e-6, *, signed: bool = True
) -> lengths.Readings:
    """The readings after one move of the second row."""
    found = work()
    found.take(1, one(sign), moved(change, sigma, signed=signed))
    return found


def test_a_move_that_is_left_out_is_so_with_every_reason_and_its_place() -> None:
    found = work()
    assert not found.take(2, one(row=701), moved(0.02, faults=(Fault.GAP, Fault.TURN)))
    where = "rows.csv: row 3: left out (samples from row 701 on): "
    assert found.notes == [where + fault.value for fault in (Fault.GAP, Fault.TURN)]
    assert found.left_out.tolist() == [False, False, True, False]
    assert found.change[2] == 0.0
    assert not found.take(1, one(), moved(-0.02))
    assert len(found.notes) == 2 and not found.left_out[1]
    assert (found.change[1], found.sigma[1]) == (-0.02, 1e-6)


def test_a_move_known_three_times_worse_than_the_sensor_is_left_out() -> None:
    for times, out in ((2.9, False), (3.1, True)):
        found = taken(0.02, sigma=times * SIGMA)
        assert found.left_out[1] == out
        assert [
            f"dL is known to {10 * times:.1f} nm only, and sigma is 10 nm" in note for note in found.notes
        ] == [True] * out


def test_the_tables_sign_comes_first_and_must_not_contradict_the_scans() -> None:
    for sign in (1, -1):
        for signed in (True, False):
            found = taken(0.02 * sign if signed else 0.02, sign, signed=signed)
            assert found.change[1] == 0.02 * sign and not found.left_out[1] and not found.notes
        found = taken(-0.02 * sign, sign)
        assert (
            found.left_out[1]
            and "its sign in the table is not that of the wavelength scans" in found.notes[0]
        )
        found = taken(-2.5e-6 * sign, sign)  # within three sigma of none
        assert found.change[1] == 2.5e-6 * sign and not found.left_out[1]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_nominal_machine_tells_a_sign_that_is_99_times_as_likely(sign: float) -> None:
    """Gaussian predictions with odds on either side of that."""
    change, std = 0.02, 0.01
    for odds, sure in ((90.0, False), (110.0, True)):
        value = sign * std**2 * np.log(odds) / (2.0 * change)
        likely = norm.logpdf(sign * change, value, std) - norm.logpdf(-sign * change, value, std)
        assert np.exp(likely) == pytest.approx(odds)
        found = work()
        found.nominal = np.full(4, value), np.full(4, std)
        by_model = found.take(1, one(), moved(change, signed=False))
        assert by_model is sure and found.left_out[1] != sure
        assert found.change[1] == (sign * change if sure else 0.0)
        assert (
            any("neither a scan of the wavelength nor the nominal machine" in n for n in found.notes) != sure
        )


def test_a_prediction_that_is_none_tells_no_sign() -> None:
    for value, std in ((np.nan, 0.01), (0.0, 0.01), (0.02, np.inf), (0.02, np.nan)):
        found = work()
        found.nominal = np.full(4, value), np.full(4, std)
        assert found.sign_of(1, one(), moved(0.02, signed=False)) == (0.0, True)
    exact = work()
    exact.nominal = np.full(4, -0.02), np.zeros(4)
    assert exact.sign_of(1, one(), moved(0.02, signed=False)) == (-1.0, True)
    assert work().sign_of(1, one(), moved(2.9e-6, signed=False)) == (
        1.0,
        False,
    )  # less than three sigma of none
    assert work().sign_of(1, one(), moved(0.0)) == (1.0, False)


def test_returns_that_miss_by_a_count_are_left_out_at_the_end() -> None:
    found = work(recording([0, 1, 2, 0], [0, 0, 1, 2]))
    found.rows.q[3] = found.rows.q[0]
    half = BASE / 2.0
    for row, change in ((1, 0.02), (2, 0.01), (3, -0.03 + half)):
        found.take(row, one(), moved(change))
    found.close()
    assert found.left_out.tolist() == [False, True, True, True]
    assert (found.change == 0.0).all()
    assert len(found.notes) == 1 and "+1 counts" in found.notes[0]
    rows = lengths.with_lengths(found.rows, found)
    assert rows.from_row is not None and not rows.from_row.flags.writeable
    assert rows.from_row.tolist() == [0, 1, 2, 3] and rows.notes == tuple(found.notes)
    assert rows.observations["dL"].tolist() == [0.0] * 4 and not rows.observations["dL"].flags.writeable


def test_series_of_a_pose_go_to_its_moves_in_order_of_time() -> None:
    """The first row of all is no move: it may have a series that nobody needs."""
    rows = recording([0, 1, 0, 1], [0, 0, 1, 2], [0.0, 30.0, 20.0, 10.0])
    a, b, c, d = (one(row=k) for k in range(4))
    for of_0 in ((c,), (a, c)):
        table = SampleTable("light.csv", {0: of_0, 1: (b, d)}, ())
        # row 3 was at pose 1 before row 1
        found = lengths.paired_series(rows, 0, table)
        assert list(found) == [1, 2, 3]
        assert found[3] is b and found[1] is d
    with input_error(r"light\.csv: column 'pose': found 1 series for pose 1, expected 2: rows\.csv: row"):
        lengths.paired_series(rows, 0, SampleTable("light.csv", {0: (c,), 1: (b,)}, ()))


def test_levels_that_moves_share_are_their_medians() -> None:
    def with_levels(low: float, high: float, faults: tuple[Fault, ...] = ()) -> Move:
        own = Levels(np.arange(2.0), np.array([low - 1.0, low + 1.0]), np.array([high, high]))
        return replace(moved(0.01, faults=faults), count=replace(COUNT, levels=own))

    good = [with_levels(*levels) for levels in ((1.0, 5.0), (1.1, 5.0), (1.2, 5.0), (9.0, 5.3), (1.1, 4.9))]
    shared = lengths.shared_levels([*good, with_levels(-50.0, 50.0, (Fault.WEAK,))])
    assert shared is not None
    assert (shared.low.tolist(), shared.high.tolist()) == ([1.1], [5.0])
    # 1-sigma from the median deviation of the worse end, of the fringe's size
    assert shared.sigma == pytest.approx(1.4826 * 0.1 / 3.8)
    single = lengths.shared_levels(good[:1])
    alike = lengths.shared_levels(good[:1] * 3)
    assert single is not None and alike is not None
    assert single.sigma == 10.0 * alike.sigma == 0.01  # one alone says nothing of others
    assert lengths.shared_levels([with_levels(1.0, 5.0, (Fault.GAP,))]) is None


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
