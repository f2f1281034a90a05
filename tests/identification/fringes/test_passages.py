"""Laws of what passed the end of a fringe, each on light whose phase is known, or on crossings put where they are wanted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from support.fringe_series import EVERY, RATE, G, series, steady
from truepose.identification.leaves.fringes import count as counting
from truepose.identification.leaves.fringes import turns
from truepose.identification.leaves.fringes.count import Series, evenly
from truepose.identification.leaves.fringes.excursions import Excursions
from truepose.identification.leaves.fringes.levels import Noise, Rest
from truepose.models.machine.fabry_perot import folded_phase, fringe

Array = NDArray[np.float64]
QUIET = Noise(0.0, 0.0)
LOW = float(folded_phase(0.5, G))


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
    judged = counting.passages(one)
    assert judged is not None
    assert np.isinf(judged[0][1:-1]).all() and (judged[0][1:-1] > 0).all()
    assert {k for k, _ in judged[1]} == {0, len(one.found) - 1}


@pytest.mark.parametrize(
    ("share", "in_time"), [(0.014, True), (0.016, False), (-0.014, True), (-0.017, False)]
)
def test_an_excursion_is_late_by_one_and_a_half_per_cent_of_its_time(share: float, in_time: bool) -> None:
    factors = np.ones(9)
    factors[4] += share
    found = counting.in_time(timed(factors), every(11))
    assert found.tolist() == every(11, None if in_time else 5).tolist()


def test_of_neighbours_out_of_time_the_worst_is_the_one() -> None:
    """One that lasts longer by a tenth makes both its neighbours look off by half of that."""
    for k in range(2, 9):
        factors = np.ones(9)
        factors[k - 1] = 1.1
        assert counting.in_time(timed(factors), every(11)).tolist() == every(11, k).tolist()


def test_neighbours_that_did_not_pass_evenly_tell_no_time() -> None:
    factors = np.ones(9)
    factors[4] = 1.1
    for other in (4, 6):
        even = every(11, other)
        assert counting.in_time(timed(factors), even)[5]
    assert not counting.in_time(timed(factors), every(11, 5))[5]
    assert counting.in_time(timed(np.array([1.0, 1.5])), every(4)).all()  # too few to compare


@pytest.mark.parametrize(("samples", "in_time"), [(10, True), (20, True), (100, True), (4000, False)])
def test_noise_hides_lateness_by_the_root_of_the_samples_at_a_crossing(samples: int, in_time: bool) -> None:
    """A twentieth of an excursion's samples, one at least: 0.02 of a fringe hides 4 % of its time until there are many."""
    factors = np.ones(9)
    factors[4] = 1.04
    assert counting.in_time(timed(factors, samples, 0.02), every(11))[5] == in_time


def hidden(k: int, samples: int, sigma: float) -> float:
    """By how much the logarithm of an excursion's time may be off before it is late, beyond 0.015."""
    low, high = 0.0, 3.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        factors = np.ones(10)
        factors[k - 1] = np.exp(middle)
        in_time = bool(counting.in_time(timed(factors, samples, sigma), every(12))[k])
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
    judged = counting.passages(one)
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
    judged = counting.passages(one)
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
    judged = counting.passages(one, everyone=True)
    assert judged is not None
    assert [k for k, _ in judged[1]] == list(range(len(one.found)))
    assert (judged[0][1:-1] > turns.DECISIVE).all() and np.isfinite(judged[0]).all()
    for k, verdict in judged[1][1:-1]:
        assert verdict.fits and verdict.odds == judged[0][k]
        assert verdict.level == pytest.approx(float(one.found.high[k]), abs=5.0 * verdict.sigma)


def test_a_mirror_that_rests_all_the_time_did_not_pass() -> None:
    judged = counting.passages(series(np.full(400, 1.0), 0.01))
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


def test_a_middle_may_be_off_by_what_noise_leaves_of_its_mean() -> None:
    """A hundredth of a fringe and five sigma of the mean over the middle third."""
    one = series(steady())
    k = 5
    inside = slice(int(one.found.first[k]), int(one.found.first[k + 1]))
    for sigma in (0.0, 0.02, 0.04):
        most = 0.01 + 5.0 * sigma / np.sqrt(one.found.sizes[k] / 3.0)
        for share, even in ((0.9, True), (1.1, False)):
            v = one.v.copy()
            v[inside] -= np.where(one.found.high[k], 1.0, -1.0) * share * most
            noisy = replace(one, v=v, noise=Noise(sigma, 0.0))
            assert bool(evenly(noisy)[k]) is even


def test_three_excursions_show_no_neighbours_and_four_and_five_do() -> None:
    for fringes, count in ((1.0, 3), (1.5, 4)):
        one = series(steady(fringes, start=0.3))
        assert len(one.found) == count
        assert evenly(one).tolist() == [False, *[count == 4] * (count - 2), False]
    late = np.array([1.0, 1.1, 1.0])
    assert counting.in_time(timed(late), every(5)).tolist() == every(5, 2).tolist()


def test_an_excursion_that_misses_its_end_by_four_hundredths_does_not_reach_it() -> None:
    """And by four sigma; or, with few samples, by what lies between two of them."""
    one = series(steady())
    for high in (False, True):
        k = int(np.flatnonzero(one.found.high[2:-2] == high)[0]) + 2
        inside = slice(int(one.found.first[k]), int(one.found.first[k + 1]))
        for noise in (0.0, 0.02):
            for miss, reaches in ((0.03, True), (0.05, False)):
                far = miss + 4.0 * noise
                v = one.v.copy()
                v[inside] = np.minimum(v[inside], 1.0 - far) if high else np.maximum(v[inside], far)
                assert bool(counting.reaches_end(v, noise, one.found, G)[k]) is reaches
    for samples in (4.5, 5.3, 6.7, 9.1):
        n = round(12.0 * samples)
        sparse = series(0.3 + np.arange(float(n)) * 2.0 * np.pi / samples)
        assert counting.reaches_end(sparse.v, 0.0, sparse.found, G)[1:-1].all()
        step = 2.0 * np.pi / samples
        missed = fringe(np.cos(np.pi + 0.9 * step), G) - 0.04
        low = np.where(sparse.v > 0.5, np.minimum(sparse.v, missed), sparse.v)
        assert not counting.reaches_end(low, 0.0, sparse.found, G)[1:-1][sparse.found.high[1:-1]].any()
