"""Laws of what scans of the wavelength tell of a counted move: its direction, its ends, and a wrong count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from truepose.identification.leaves.fringes import move
from truepose.identification.leaves.fringes.count import Count, End
from truepose.identification.leaves.fringes.excursions import Fault
from truepose.identification.leaves.fringes.levels import Levels, Scan

BASE = 1.56e-3
UNIT = BASE / (4.0 * np.pi)
LEVELS = Levels(np.zeros(1), np.zeros(1), np.ones(1))


def end(offset: float, *, high: bool = False, sigma: float = 0.01, doubt: float = 0.0) -> End:
    return End(high, offset, sigma, doubt)


def counted(walked: float, start: End, stop: End, faults: tuple[Fault, ...] = ()) -> Count:
    return Count(walked, start, stop, 0, LEVELS, 0.01, 0, faults)


def scan(phase: float, length: float = 0.9, phase_sigma: float = 0.01, length_sigma: float = 1e-4) -> Scan:
    return Scan(phase, phase_sigma, length, length_sigma, None, None)


@pytest.mark.parametrize("off", [1.0, 2.5])
def test_a_scan_that_suits_neither_direction_tells_none(off: float) -> None:
    """A rest at the very end of a fringe has no side: whatever the scan's phase, both directions fit alike."""
    count = counted(6.0 * np.pi, end(0.0), end(0.0))
    for before, after in ((scan(off), None), (None, scan(off)), (scan(off), scan(off, length_sigma=1.0))):
        found = move.signed_move(count, before, after, BASE)
        assert not found.signed and not found.faults
        assert found.change == pytest.approx(6.0 * np.pi * UNIT) and found.sigma == pytest.approx(
            np.hypot(0.01, 0.01) * UNIT
        )


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("high", [False, True])
def test_the_side_that_a_scan_sees_tells_the_direction(sign: float, high: bool) -> None:
    """An end's offset is along the walk, a scan's phase towards greater lengths."""
    count = counted(6.0 * np.pi, end(0.0), end(0.8, high=high))
    after = scan(sign * 0.8 + np.pi * high)
    found = move.signed_move(count, None, after, BASE)
    assert found.signed and not found.faults
    assert found.change == pytest.approx(sign * (6.0 * np.pi + 0.8) * UNIT)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_lengths_tell_the_direction_where_they_are_known_well_enough(sign: float) -> None:
    """Four sigma between the two directions: 16 in chi2."""
    way = 6.0 * np.pi * UNIT
    count = counted(6.0 * np.pi, end(0.0), end(0.0))
    for sigmas, signed in ((3.8, False), (4.2, True)):
        each = (2.0 * way / sigmas - count.sigma * UNIT) / np.sqrt(2.0)
        before, after = scan(0.0, 0.9, length_sigma=each), scan(0.0, 0.9 + sign * way, length_sigma=each)
        found = move.signed_move(count, before, after, BASE)
        assert found.signed is signed
        assert found.change == pytest.approx((sign if signed else 1.0) * way)


def test_a_length_or_a_phase_that_no_noise_makes_is_a_wrong_count() -> None:
    """5.5 sigma of either: 30 in chi2."""
    way = 6.0 * np.pi * UNIT
    for sigmas, wrong in ((5.2, False), (5.8, True)):
        count = counted(6.0 * np.pi, end(0.0), end(0.8))
        exact, spread = way + 0.8 * UNIT, np.hypot(1e-4, 1e-4) + count.sigma * UNIT
        after = scan(0.8, 0.9 + exact + sigmas * spread)
        assert (Fault.COUNT in move.signed_move(count, scan(0.0), after, BASE).faults) is wrong
        phase = np.sqrt(0.01**2 + 0.01**2 + 0.05**2)
        off = move.signed_move(count, None, scan(0.8 + sigmas * phase), BASE)
        assert off.signed and (Fault.COUNT in off.faults) is wrong


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("high", [False, True])
def test_scan_and_level_weigh_by_their_information(direction: float, high: bool) -> None:
    level, seen = end(0.5, high=high, sigma=0.03), 0.58
    phase = direction * seen + np.pi * high
    for sigma in (0.03, 0.01):
        placed = move.placed_end(level, scan(phase, phase_sigma=sigma), direction)
        information = np.array([0.03, sigma]) ** -2.0
        assert placed.sigma**-2.0 == pytest.approx(information.sum())
        assert placed.offset == pytest.approx(np.array([0.5, seen]) @ information / information.sum())
        assert placed.doubt == 0.0 and placed.high is high
    assert move.placed_end(level, None, direction) is level


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_side_that_the_level_does_not_know_is_the_scans(side: float) -> None:
    """Its distance from the end is kept: what was doubt about the side is none about the distance."""
    doubtful = End(
        False, 0.3, float(np.hypot(0.02, 0.4)), 0.4
    )  # half a rad to either side, not evenly likely
    placed = move.placed_end(doubtful, scan(0.5 * side, phase_sigma=0.02), 1.0)
    assert placed.offset == pytest.approx(0.5 * side)
    assert placed.sigma == pytest.approx(0.02 / np.sqrt(2.0)) and placed.doubt == 0.0
    count = counted(6.0 * np.pi, end(0.0), doubtful, (Fault.SIDE, Fault.JUMP))
    way = 6.0 * np.pi * UNIT
    sided = move.signed_move(count, scan(0.0), scan(0.3, 0.9 + way), BASE)
    assert sided.signed and sided.faults == (Fault.JUMP,)
    count = counted(6.0 * np.pi, doubtful, end(0.8), (Fault.SIDE,))
    assert move.signed_move(count, None, scan(0.8), BASE).faults == (Fault.SIDE,)  # nobody saw the start


def test_levels_of_scans_stand_where_the_move_begins_and_ends() -> None:
    t = np.linspace(2.0, 5.0, 10)
    one, two = (replace(scan(0.0), low=low, high=high) for low, high in ((1.0, 4.0), (1.5, 5.0)))
    both = move.levels_of([one, two], t)
    assert both is not None
    assert (both.knots.tolist(), both.low.tolist(), both.high.tolist()) == (
        [2.0, 5.0],
        [1.0, 1.5],
        [4.0, 5.0],
    )
    last = move.levels_of([None, two], t)
    assert last is not None
    assert (last.knots.tolist(), last.low.tolist(), last.high.tolist()) == ([5.0], [1.5], [5.0])
    assert move.levels_of([None, scan(0.0)], t) is None


def test_the_longest_run_of_one_wavelength_is_the_move() -> None:
    assert move.longest_constant(np.array([1.0, 2.0, 2.0, 2.0, 3.0, 3.0])) == slice(1, 4)
    assert move.longest_constant(np.array([1.0, 1.0, 2.0])) == slice(0, 2)
    assert move.longest_constant(np.array([1.0, 2.0, 2.0])) == slice(1, 3)
    assert move.longest_constant(np.ones(4)) == slice(0, 4)
