"""Laws of how one passage of a fringe's end is judged: which samples, how far they lie from the end, what rests say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from support.fringe_series import EVERY, RATE, G, series, steady
from truepose.identification.leaves.fringes import count as counting
from truepose.identification.leaves.fringes import turns
from truepose.identification.leaves.fringes.count import evenly
from truepose.identification.leaves.fringes.levels import Rest
from truepose.models.machine.fabry_perot import fringe

Array = NDArray[np.float64]


def every(n: int, k: int | None = None) -> NDArray[np.bool_]:
    """All but ``k``."""
    out = np.ones(n, dtype=bool)
    if k is not None:
        out[k] = False
    return out


def far(visit: turns.Visit) -> tuple[Array, Array]:
    """Times of the groups and their distance from the end that is visited, rad."""
    light = turns.light_of(visit)
    span = visit.t[-1] - visit.t[0]
    return visit.t[0] + 0.5 * (light.u + 1.0) * span, light.distance


@pytest.mark.parametrize("fringes", [3.0, 6.0])
def test_what_is_judged_lies_as_far_from_the_end_as_the_mirror_does(fringes: float) -> None:
    """The light of a steady mirror unfolds to its distance from the end of the fringe that is judged."""
    one = series(steady(fringes, start=0.4))
    even = evenly(one)
    first_end = 0 if not one.found.high[0] else 1
    last = len(one.found) - 1
    for k in range(last + 1):
        end = np.pi * (k + first_end)
        times, distance = far(counting.visit_of(one, k, even))
        true = np.abs(0.4 + RATE * times - end)
        # next to one that is cut by the end of the series nobody knows how far that goes
        known = true < (np.pi - 0.05 if k in (1, last - 1) else np.inf)
        assert known.sum() > 20
        np.testing.assert_allclose(distance[known], true[known], atol=0.07)


def test_rests_hold_the_motions_next_to_them() -> None:
    one = series(steady())
    even, last = evenly(one), len(one.found) - 1
    held = [
        tuple(edge is not None for edge in counting.visit_of(one, k, even).edges) for k in range(last + 1)
    ]
    assert held == [(True, False), *[(False, False)] * (last - 1), (False, True)]


@pytest.mark.parametrize("end", [0.0, np.pi])
def test_a_move_within_one_excursion_passes_or_turns(end: float) -> None:
    """Between rests it goes on to the other side; without any it comes back with steady acceleration."""
    share = np.clip((np.arange(900.0) - 300.0) / 250.0, 0.0, 1.0)
    smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    back = -0.5 - 0.6 * np.linspace(-1.0, 1.0, 900) ** 2
    for path, sign in ((-0.7 + 1.4 * smooth, 1.0), (back, -1.0)):
        one = series(end + path, 0.002)
        judged = counting.passages(one)
        assert len(one.found) == 1 and judged is not None
        assert sign * judged[0][0] > turns.DECISIVE


def test_a_window_reaches_two_plain_neighbours_or_half_of_the_next() -> None:
    one = series(steady())
    found, t, n = one.found, one.t, len(one.found)

    def spans(k: int, even: NDArray[np.bool_], start: float, stop: float) -> bool:
        rows = counting.window_of(one, k, even)
        return bool(np.allclose(t[[rows.start, rows.stop - 1]], [start, stop], rtol=0.0, atol=1.01 / EVERY))

    times, half = found.times, 0.5 * found.durations
    assert spans(5, every(n), times[2], times[7])
    assert spans(5, every(n, 3), times[3], times[7])
    assert spans(5, every(n, 7), times[2], times[6])
    assert spans(5, every(n, 4) & every(n, 6), times[4] - half[4], times[5] + half[6])
    assert spans(1, every(n, 0), t[one.rests[0].samples - 1], times[3])
    # the ends of the series: without what rests, and half of the next
    assert spans(0, every(n), t[one.rests[0].samples - 1], times[0] + half[1])
    assert spans(n - 1, every(n), times[-1] - half[-2], t[len(t) - one.rests[1].samples])
    rested = replace(one, rests=(replace(one.rests[0], samples=6), replace(one.rests[1], samples=9)))
    first, last = (counting.window_of(rested, k, every(n)) for k in (0, n - 1))
    assert (first.start, last.stop) == (5, len(t) - 8)  # a sample of each rest stays
    # where the next is cut by the end, half as long as the one that is judged
    short = series(steady(1.0, start=0.9))
    k = len(short.found) - 2
    rows = counting.window_of(short, k, every(len(short.found), k + 1))
    expected = min(short.found.times[k] + 0.5 * short.found.durations[k], short.t[-short.rests[1].samples])
    assert short.t[rows.stop - 1] == pytest.approx(expected, abs=1.01 / EVERY)


@pytest.mark.parametrize("high", [False, True])
@pytest.mark.parametrize("distance", [0.7, 1.2])
def test_a_rest_is_held_where_it_is(high: bool, distance: float) -> None:
    one = series(steady())
    phase = np.pi - distance if high else distance
    slope = abs(float(fringe(np.cos(phase + 1e-6), G) - fringe(np.cos(phase - 1e-6), G))) / 2e-6
    for sigma, still in ((0.02, True), (1e-5, False)):
        rest = Rest(50, float(fringe(np.cos(phase), G)), sigma, still)
        held = counting.held_rest(one, rest, high)
        assert held.distance == pytest.approx(distance, abs=1e-9) and held.still is still
        assert held.sigma == pytest.approx(max(0.03, sigma / slope), rel=0.3)
        assert held.sigma >= 0.03  # a polynomial follows no better
