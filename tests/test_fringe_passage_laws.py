"""Laws of what passed the end of a fringe, each on light whose phase is known, or on crossings put where they are wanted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.identification.fringes import passages, turns
from truepose.identification.fringes.excursions import Excursions
from truepose.identification.fringes.levels import Levels, Noise
from truepose.identification.fringes.passages import Series, evenly, normalised
from truepose.identification.fringes.rest import Rest
from truepose.models.fabry_perot import folded_phase, fringe

Array = NDArray[np.float64]
G = 0.2
LEVELS = Levels(np.zeros(1), np.array([2.0]), np.array([6.0]))
QUIET = Noise(0.0, 0.0)
LOW = float(folded_phase(0.5, G))
RATE = 7.0
EVERY = 200.0


def series(phase: Array, noise: float = 0.0, seed: int = 0, per_time: float = EVERY) -> Series:
    """Light of a path of ``phase`` (n,), of levels 2 and 6, so many samples a unit of time."""
    t = np.arange(len(phase)) / per_time
    shake = 4.0 * noise * np.random.default_rng(seed).standard_normal(len(phase))
    return normalised(t, 2.0 + 4.0 * fringe(np.cos(phase), G) + shake, LEVELS, Noise(4.0 * noise, 0.0), G)


def steady(fringes: float = 6.0, start: float = 0.3, rate: float = RATE) -> Array:
    n = round(fringes * 2.0 * np.pi / rate * EVERY)
    return np.asarray(start + rate * np.arange(n) / EVERY)


def timed(factors: Array, samples: int = 40, sigma: float = 0.0) -> Series:
    """Excursions of a steady mirror but for the ``factors`` (K - 1,) by which the inner ones last longer."""
    count = len(factors) + 2
    high = np.arange(count) % 2 == 1
    half = np.where(high, np.pi - LOW, LOW)
    times = np.concatenate([[0.0], np.cumsum(2.0 * half[1:-1] * factors / RATE)]) + 1.0
    first = np.arange(count + 1, dtype=np.intp) * samples
    found = Excursions(high, first, times, (LOW, np.pi - LOW))
    rest = Rest(0, 0.5, 0.1, False)
    return Series(np.zeros(0), np.zeros(0), Noise(sigma, 0.0), 0.001, G, found, (rest, rest))


def every(n: int, k: int | None = None) -> NDArray[np.bool_]:
    """All but ``k``."""
    out = np.ones(n, dtype=bool)
    if k is not None:
        out[k] = False
    return out


# -- at a glance ---------------------------------------------------------------------------------------


def test_a_steady_mirror_passes_every_end_between_its_first_and_last() -> None:
    one = series(steady())
    assert evenly(one)[1:-1].all() and not evenly(one)[[0, -1]].any()
    judged = passages.passages(one)
    assert judged is not None
    assert np.isinf(judged[0][1:-1]).all() and (judged[0][1:-1] > 0).all()
    assert {k for k, _ in judged[1]} == {0, len(one.found) - 1}


@pytest.mark.parametrize(
    ("share", "in_time"), [(0.014, True), (0.016, False), (-0.014, True), (-0.017, False)]
)
def test_an_excursion_is_late_by_one_and_a_half_per_cent_of_its_time(share: float, in_time: bool) -> None:
    factors = np.ones(9)
    factors[4] += share
    found = passages._in_time(timed(factors), every(11))
    assert found.tolist() == every(11, None if in_time else 5).tolist()


def test_of_neighbours_out_of_time_the_worst_is_the_one() -> None:
    """One that lasts longer by a tenth makes both its neighbours look off by half of that."""
    for k in range(2, 9):
        factors = np.ones(9)
        factors[k - 1] = 1.1
        assert passages._in_time(timed(factors), every(11)).tolist() == every(11, k).tolist()


def test_neighbours_that_did_not_pass_evenly_tell_no_time() -> None:
    factors = np.ones(9)
    factors[4] = 1.1
    for other in (4, 6):
        even = every(11, other)
        assert passages._in_time(timed(factors), even)[5]
    assert not passages._in_time(timed(factors), every(11, 5))[5]
    assert passages._in_time(timed(np.array([1.0, 1.5])), every(4)).all()  # too few to compare


@pytest.mark.parametrize(("samples", "in_time"), [(10, True), (20, True), (100, True), (4000, False)])
def test_noise_hides_lateness_by_the_root_of_the_samples_at_a_crossing(samples: int, in_time: bool) -> None:
    """A twentieth of an excursion's samples, one at least: 0.02 of a fringe hides 4 % of its time until there are many."""
    factors = np.ones(9)
    factors[4] = 1.04
    assert passages._in_time(timed(factors, samples, 0.02), every(11))[5] == in_time


def hidden(k: int, samples: int, sigma: float) -> float:
    """By how much the logarithm of an excursion's time may be off before it is late, beyond 0.015."""
    low, high = 0.0, 3.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        factors = np.ones(10)
        factors[k - 1] = np.exp(middle)
        in_time = bool(passages._in_time(timed(factors, samples, sigma), every(12))[k])
        low, high = (middle, high) if in_time else (low, middle)
    return low - 0.015


def test_what_noise_hides_goes_by_its_size_the_samples_and_the_width() -> None:
    """Four sigma of each of two crossings' phase, from at least one sample."""
    for k in (4, 5):
        half = np.pi - LOW if k % 2 else LOW
        at_one = hidden(k, 20, 0.02)
        assert at_one == pytest.approx(4.0 * 2.0 * 0.02 / half, rel=1e-6)
        assert hidden(k, 5, 0.02) == pytest.approx(at_one) and hidden(k, 20, 0.04) == pytest.approx(
            2.0 * at_one
        )
        assert hidden(k, 80, 0.02) == pytest.approx(at_one / 2.0)
        assert hidden(k, 20, 0.0) == pytest.approx(0.0, abs=1e-9)


def uneven(ratio: float, kind: float, fringes: int = 6) -> tuple[Series, int]:
    """A mirror ``ratio`` times as fast around one end of a fringe as elsewhere; that excursion's number."""
    centre = 2.0 * np.pi * (fringes // 2) + kind * np.pi
    half = np.pi - LOW if kind else LOW
    edges = np.array([0.3, centre - half, centre + half, 2.0 * np.pi * fringes])
    times = np.concatenate([[0.0], np.cumsum(np.diff(edges) / (RATE * np.array([1.0, ratio, 1.0])))])
    phase = np.interp(np.arange(0.0, times[-1], 1.0 / EVERY), times, edges)
    one = series(np.asarray(phase))
    return one, int(np.searchsorted(one.found.times, 0.5 * (times[1] + times[2])))


@pytest.mark.parametrize("kind", [0, 1])
def test_one_that_is_slower_than_its_neighbours_by_1_4_is_not_even(kind: int) -> None:
    for ratio, even in ((1.0, True), (1.3, True), (0.74, True), (0.69, False), (0.4, False)):
        one, k = uneven(ratio, kind)
        assert bool(evenly(one)[k]) is even
        others = np.delete(evenly(one), [0, k, len(one.found) - 1])
        assert others.all()


@pytest.mark.parametrize("kind", [0, 1])
def test_a_mirror_that_turns_at_the_end_of_a_fringe_is_not_even_there(kind: int) -> None:
    """With steady acceleration it is about 2.5 times as slow there as in the neighbouring excursions, or more."""
    t = np.arange(-3.0, 3.0, 1.0 / EVERY)
    end = 10.0 * np.pi + kind * np.pi
    one = series(end - 3.0 * t**2)
    k = int(np.searchsorted(one.found.times, 3.0))
    speed = one.found.speeds
    assert max(speed[k - 1], speed[k + 1]) > 2.4 * speed[k]
    assert not evenly(one)[k]
    judged = passages.passages(one)
    assert judged is not None
    assert np.isfinite(judged[0][k])


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("before", [0.3, 0.6])
def test_a_sudden_turn_before_the_end_of_a_fringe_is_no_passage(before: float, kind: int) -> None:
    """The mirror comes back at the speed at which it came: only its time and its middle tell."""
    peak = 8.0 * np.pi + kind * np.pi - before
    t = np.arange(0.0, 2.0 * (peak - 0.3) / RATE, 1.0 / EVERY)
    one = series(peak - np.abs(peak - 0.3 - RATE * t), 0.002)
    k = int(np.searchsorted(one.found.times, (peak - 0.3) / RATE))
    judged = passages.passages(one)
    assert judged is not None
    odds = judged[0]
    assert odds[k] < -turns.DECISIVE
    assert (np.delete(odds, [0, k, len(odds) - 1]) > turns.DECISIVE).all()


def test_a_series_reversed_in_time_rests_the_other_way_round() -> None:
    """Where it starts and where it stops are looked at alike."""
    t = np.clip((np.arange(900.0) - 300.0) / 250.0, 0.0, 1.0)
    path = 0.8 + 20.0 * t**2 * (3.0 - 2.0 * t)
    there, back = series(path), series(path[::-1])
    assert there.rests == back.rests[::-1] and there.rests[0] != there.rests[1]


def test_everyone_is_judged_on_request_and_agrees() -> None:
    one = series(steady(3.0), 0.002)
    judged = passages.passages(one, everyone=True)
    assert judged is not None
    assert [k for k, _ in judged[1]] == list(range(len(one.found)))
    assert (judged[0][1:-1] > turns.DECISIVE).all() and np.isfinite(judged[0]).all()
    for k, verdict in judged[1][1:-1]:
        assert verdict.fits and verdict.odds == judged[0][k]
        assert verdict.level == pytest.approx(float(one.found.high[k]), abs=5.0 * verdict.sigma)


def test_a_mirror_that_rests_all_the_time_did_not_pass() -> None:
    judged = passages.passages(series(np.full(400, 1.0), 0.01))
    assert judged is not None
    assert judged[0].tolist() == [-np.inf] and judged[1] == []


def test_levels_alike_off_for_all_do_not_make_passages_doubtful_and_one_dim_middle_does() -> None:
    one = series(steady())
    moved = replace(one, v=0.95 * one.v)  # the low end stays, the high one is missed by a twentieth
    assert not evenly(moved)[moved.found.high].any() and evenly(moved)[1:-1][~moved.found.high[1:-1]].all()
    raised = replace(one, v=0.03 + one.v)
    assert evenly(raised)[1:-1].all()
    k = 5
    inside = slice(int(one.found.first[k]), int(one.found.first[k + 1]))
    for shift, even in ((0.005, True), (-0.015, False), (0.015, False)):
        v = one.v.copy()
        v[inside] += shift
        assert bool(evenly(replace(one, v=v))[k]) is even
        assert np.delete(evenly(replace(one, v=v)), [0, k, len(one.found) - 1]).all()


# -- one by one ----------------------------------------------------------------------------------------


def far(visit: turns.Visit) -> tuple[Array, Array]:
    """Times of the groups and their distance from the end that is visited, rad."""
    light = turns._light(visit)
    span = visit.t[-1] - visit.t[0]
    return visit.t[0] + 0.5 * (light.u + 1.0) * span, light.distance


@pytest.mark.parametrize("fringes", [3.0, 6.0])
def test_what_is_judged_lies_as_far_from_the_end_as_the_mirror_does(fringes: float) -> None:
    """The light of a steady mirror unfolds to its distance from the end of the fringe that is judged."""
    one = series(steady(fringes, start=0.4))
    even = evenly(one)
    first_end = 0 if not one.found.high[0] else 1
    last = len(one.found) - 1
    for k in (0, *range(2, last - 1), last):
        end = np.pi * (k + first_end)
        times, distance = far(passages._visit(one, k, even))
        np.testing.assert_allclose(distance, np.abs(0.4 + RATE * times - end), atol=0.07)


def test_a_window_reaches_two_plain_neighbours_or_half_of_the_next() -> None:
    one = series(steady())
    found, t, n = one.found, one.t, len(one.found)

    def spans(k: int, even: NDArray[np.bool_], start: float, stop: float) -> bool:
        rows = passages._window(one, k, even)
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
    first, last = (passages._window(rested, k, every(n)) for k in (0, n - 1))
    assert (first.start, last.stop) == (5, len(t) - 8)  # a sample of each rest stays
    # where the next is cut by the end, half as long as the one that is judged
    short = series(steady(1.0, start=0.9))
    k = len(short.found) - 2
    rows = passages._window(short, k, every(len(short.found), k + 1))
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
        held = passages._held(one, rest, high)
        assert held.distance == pytest.approx(distance, abs=1e-9) and held.still is still
        assert held.sigma == pytest.approx(max(0.03, sigma / slope), rel=0.3)
        assert held.sigma >= 0.03  # a polynomial follows no better
