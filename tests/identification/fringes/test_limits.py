"""Laws of fringe counting at its limits: the fewest samples, two recordings, the first fringe, returns on the way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.identification.leaves.fringes import excursions, lengths, levels, move, turns
from truepose.identification.leaves.fringes.count import Count, End, evenly, normalised
from truepose.identification.leaves.fringes.excursions import Excursions, centre_means, find_excursions
from truepose.identification.leaves.fringes.lengths import read_samples
from truepose.identification.leaves.fringes.levels import Levels, Noise, Scan, find_rest, noise_of
from truepose.identification.leaves.fringes.move import Move, read_move
from truepose.models.machine.fabry_perot import coupling, folded_phase, fringe
from truepose.models.units import UnitSystem

Array = NDArray[np.float64]
MIRRORS = (0.2, 0.2)
G = coupling(MIRRORS)
LOW = float(folded_phase(0.5, G))
LEVELS = Levels(np.zeros(1), np.zeros(1), np.ones(1))


# -- samples -------------------------------------------------------------------------------------------


def test_a_table_of_numbers_is_a_series_for_each_pose(tmp_path: Path) -> None:
    path = tmp_path / "light.csv"
    rows = [f"{k // 40},{0.01 * k!r},{np.sin(k):.12g}" for k in range(80)]
    path.write_text("# a note\n" + "\n".join(["pose,t [ms],I", *rows]) + "\n", encoding="utf-8")
    found = read_samples(path, UnitSystem())
    assert [len(found.series[k][0].t) for k in (0, 1)] == [40, 40]
    np.testing.assert_allclose(found.series[1][0].t, 1e-5 * np.arange(40, 80))
    path.write_text("\n".join(["pose,t,I,I", *(f"{row},1" for row in rows)]) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="column 'I': found twice"):
        read_samples(path, UnitSystem())


def test_a_signal_that_hardly_repeats_has_no_converter_however_calm_it_is() -> None:
    for n in (200, 4000, 20_000):
        calm = np.linspace(0.0, 1.0, n)
        assert noise_of(calm).sigma < 1e-12 and noise_of(calm).stuck == 0.0
    assert noise_of(np.round(calm, 2)).sigma == pytest.approx(0.01 / np.sqrt(12.0), rel=1e-6)


def test_the_step_of_a_converter_is_the_smallest_between_its_values() -> None:
    """A signal need not stop on every one of them."""
    signal = np.repeat([0.0, 0.5, 3.0, 7.5], 1000)
    assert noise_of(signal).sigma == pytest.approx(0.5 / np.sqrt(12.0))


# -- excursions ----------------------------------------------------------------------------------------


def light(t: Array, rate: float = 7.0, start: float = 0.3) -> Array:
    return fringe(np.cos(start + rate * t), G)


def test_the_only_whole_excursion_has_a_middle_too() -> None:
    t = np.arange(0.0, 0.85, 1e-4)
    found = find_excursions(t, light(t), 0.0, G)
    assert len(found) == 3
    mean, count = centre_means(t, light(t), found)
    third = LOW + (np.pi - LOW) * 2.0 * np.linspace(1.0 / 3.0, 2.0 / 3.0, 2001)
    assert mean[1] == pytest.approx(float(np.mean(fringe(np.cos(third), G))), abs=1e-4)
    assert count[1] == pytest.approx(found.sizes[1] / 3.0, abs=1.5)
    for part in (t < 0.1, t < 0.3):  # one and two: both are cut
        few = find_excursions(t[part], light(t[part]), 0.0, G)
        assert len(few) == 1 + int(part.sum() > 2000)
        assert np.isnan(centre_means(t[part], light(t[part]), few)[0]).all()


def test_three_samples_are_enough_for_the_middle_of_an_excursion() -> None:
    """Of fourteen a fringe three are in the middle of its high end, and two of its low one."""
    t = 2.0 * np.pi / 7.0 / 14.0 * np.arange(150.0)
    one = normalised(t, light(t), LEVELS, Noise(0.0, 0.0), G)
    _, count = centre_means(one.t, one.v, one.found)
    assert evenly(one)[1:-1].all()
    for k in (6, 7):
        high = bool(one.found.high[k])
        start, stop = one.found.times[k - 1], one.found.times[k]
        middle = np.abs(t - 0.5 * (start + stop)) < (stop - start) / 6.0
        assert middle.sum() == count[k] == (3 if high else 2)
        off = replace(one, v=one.v + np.where(middle, -0.03 if high else 0.03, 0.0))
        assert bool(evenly(off)[k]) is not high


def test_a_crossing_lies_between_the_first_two_samples_on_different_sides() -> None:
    rng = np.random.default_rng(1)
    for _ in range(300):
        above = rng.random(12) < 0.5
        before, span = int(rng.integers(0, 4)), int(rng.integers(1, 8))
        after = before + span
        above[after] = not above[before]
        change = [k for k in range(before, after) if above[k] != above[k + 1]]
        low, up = excursions.neighbours_around(above, np.array([before]), np.array([after]))
        assert (int(low[0]), int(up[0])) == (change[0], change[0] + 1)


# -- faults --------------------------------------------------------------------------------------------


def sized(sizes: list[int]) -> Excursions:
    """Excursions of so many samples each, a sample a unit of time."""
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp)
    high = np.arange(len(sizes)) % 2 == 1
    return Excursions(high, first, first[1:-1].astype(float), (LOW, np.pi - LOW))


def test_no_fringe_may_be_too_fast_wherever_it_is() -> None:
    """The first and the last excursion are cut: what is left of them says nothing."""
    for place in range(1, 8):
        sizes = [9] * 10
        sizes[place : place + 2] = 1, 2
        assert excursions.too_fast(sized(sizes)) is True
        sizes[place : place + 2] = 2, 2
        assert excursions.too_fast(sized(sizes)) is False
    assert excursions.too_fast(sized([1, 1, 3, 1])) is False
    assert excursions.too_fast(sized([1, 2, 1])) is False


def test_one_whole_excursion_tells_how_fast_the_mirror_moves() -> None:
    """Large steps that its speed makes are no jumps."""
    t = np.arange(0.0, 0.85, 2.0 * np.pi / 7.0 / 9.0)
    v = light(t)
    found = find_excursions(t, v, 0.0, G)
    assert len(found) == 3 and np.abs(np.diff(v)).max() > 0.3
    assert not excursions.has_jump(t, v, 0.0, found)
    jumped = np.where(np.arange(len(t)) < len(t) // 2, v, 1.0 - v)
    assert excursions.has_jump(1e3 * t, jumped, 0.0, replace(found, times=1e5 * found.times))


@pytest.mark.parametrize("rising", [True, False])
def test_six_times_the_step_that_the_speed_makes_is_a_jump_and_twice_is_none(rising: bool) -> None:
    """Where light is steepest, at forty samples a fringe and at fifteen: a clock may be late for a sample."""
    for samples, times, jump in ((40.0, 6.0, True), (15.0, 2.0, False)):
        step = 2.0 * np.pi / samples
        sides = np.arange(-150.0, 151.0) + np.where(np.arange(-150, 151) > 0, times - 1.0, 0.0)
        phase = 4.0 * np.pi + (LOW if rising else -LOW) + step * (sides - 0.5 * times)
        t, v = np.arange(301.0), fringe(np.cos(phase), G)
        assert np.argmax(np.abs(np.diff(v))) == 150 and abs(v[151] - v[150]) > 0.3
        assert excursions.has_jump(t, v, 0.0, find_excursions(t, v, 0.0, G)) is jump


@pytest.mark.parametrize("scale", [1e-3, 5.0])
def test_a_spike_is_a_sample_a_tenth_of_the_range_off_its_neighbours(scale: float) -> None:
    """What is off by less is taken as it is; so is what is hidden in the noise."""
    calm = scale * light(np.arange(0.0, 3.0, 1e-3))
    for share, spiked in ((0.15, True), (-0.13, True), (0.07, False), (-0.08, False)):
        spoilt = calm.copy()
        spoilt[[700, 1500]] += share * np.ptp(calm)
        mended, count = excursions.without_spikes(spoilt, 0.0)
        assert count == (2 if spiked else 0)
        np.testing.assert_allclose(mended, calm if spiked else spoilt, atol=1e-3 * scale)
        assert excursions.without_spikes(spoilt, 0.01 * scale)[1] == 0


# -- rests and scans -----------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.0, 0.004, 0.05, 0.3])
def test_what_never_moves_rests_for_most_of_its_samples_and_for_all_of_a_power_of_two(sigma: float) -> None:
    """Windows double while they can; after that, noise may hide a step that is too short."""
    for n in range(1, 300):
        rest = find_rest(np.full(n, 0.4), Noise(sigma, 0.0))
        assert n // 2 < rest.samples <= n and rest.still
        assert rest.level == pytest.approx(0.4)
        if n & (n - 1) == 0:
            assert rest.samples == n


@pytest.mark.parametrize("fringes", [3.0, 7.3, 20.0])
def test_the_first_guess_of_a_scan_is_near_its_phase_and_its_length(fringes: float) -> None:
    """About the middle of the scan, to the step of the lengths tried and what the ends of a fringe add."""
    x = np.linspace(-0.5, 0.5, 600)
    for phase in np.arange(-3.0, 3.2, 0.4):
        v = fringe(np.cos(phase + 2.0 * np.pi * fringes * x), G)
        guess = levels.first_guesses(x, v, G, False)[0]
        assert abs(np.angle(np.exp(1j * (guess[0] - phase)))) < 0.3
        assert abs(guess[1] - 2.0 * np.pi * fringes) < 1.0


# -- shared levels --------------------------------------------------------------------------------------


def test_two_moves_that_agree_share_levels_as_well_as_three_do() -> None:
    nowhere = End(False, 0.0, 0.01, 0.0)
    count = Count(0.0, nowhere, nowhere, 0, LEVELS, 0.01, 0, ())
    one = Move(0.01, 1e-6, True, 1.56e-3, count, ())
    found = [lengths.shared_levels([one] * k) for k in (1, 2, 3)]
    assert [levels and levels.sigma for levels in found] == [0.01, 0.001, 0.001]


def test_what_scan_and_rest_differ_by_is_weighed_by_both_and_what_a_phase_cannot_be_better_than() -> None:
    """A twentieth of a rad."""
    for scanned, rested in ((0.4, 0.1), (0.1, 0.4), (0.001, 0.001)):
        end = End(False, 0.5, rested, 0.0)
        count = Count(6.0 * np.pi, End(False, 0.0, 0.01, 0.0), end, 0, LEVELS, 0.01, 0, ())
        after = Scan(0.8, scanned, 0.9, 1e-4, None, None)
        (chi2,) = move.misfits_of(count, None, after, 1e-4, 1.0)
        assert chi2 == pytest.approx(0.3**2 / (scanned**2 + rested**2 + 0.05**2))


# -- passages and turns --------------------------------------------------------------------------------


def judged(path: Array, seed: int = 0) -> turns.Visit:
    """Light on a path of phases (n,) from the low end, in seconds from 5 on."""
    n, rng = len(path), np.random.default_rng(seed)
    v: Array = fringe(np.cos(path), G) + 0.002 * rng.standard_normal(n)
    one, t = np.ones(n, dtype=bool), 5.0 + 0.1 * np.arange(float(n))
    halves = np.zeros(n, dtype=np.intp)
    return turns.Visit(t, v, Noise(0.002, 0.0), False, G, 1e-3, halves, one, ~one)


def test_samples_are_fitted_in_time_from_minus_one_to_one() -> None:
    visit = judged(np.linspace(-1.0, 1.0, 101))
    np.testing.assert_allclose(turns.light_of(visit).u, np.linspace(-1.0, 1.0, 101), atol=1e-12)
    # in groups: their mean times
    many = judged(np.linspace(-1.0, 1.0, 1600))
    np.testing.assert_allclose(
        turns.light_of(many).u, np.linspace(-1.0, 1.0, 1600).reshape(-1, 10).mean(axis=1), atol=1e-9
    )


@pytest.mark.parametrize(("samples", "enough"), [(5, False), (6, True)])
def test_a_motion_needs_as_many_samples_as_it_has_unknowns(samples: int, enough: bool) -> None:
    """Four of a cubic, and two levels."""
    light = turns.light_of(judged(np.linspace(-1.0, 1.0, samples)))
    assert (turns.smooth_verdict(light, (3, 5)) is not None) is enough


def test_motions_are_tried_until_one_fits_and_the_last_only_confirms() -> None:
    """A motion of degree 5 that no cubic follows passes; of that it is sure when a degree confirms it."""
    u = np.linspace(-1.0, 1.0, 120)
    light = turns.light_of(judged(0.7 * u + 0.5 * (16.0 * u**5 - 20.0 * u**3 + 5.0 * u)))
    cubic, free, alone = (turns.smooth_verdict(light, degrees) for degrees in ((3, 4), (3, 5, 7), (3, 5)))
    assert cubic is not None and free is not None and alone is not None
    assert free.fits and free.passed
    assert not cubic.fits and not alone.fits


@pytest.mark.parametrize("seed", range(3))
def test_guesses_of_a_motion_that_comes_back_are_the_same_seen_backwards(seed: int) -> None:
    """Polynomials in time, of which the odd powers change their sign."""
    rng = np.random.default_rng(seed)
    u = np.linspace(-1.0, 1.0, 60)
    there = turns.light_of(judged(0.3 - 1.2 * (u - 0.1 * seed) ** 2))
    there = replace(there, distance=there.distance + 0.03 * rng.random(60))
    back = replace(there, distance=there.distance[::-1])
    turned = np.append((-1.0) ** np.arange(6), [1.0, 1.0])
    guesses = [list(turns.Problem.of(light, -1.0, 5).starts()) for light in (there, back)]
    assert len(guesses[0]) == 3
    for one, other in zip(*guesses, strict=True):
        np.testing.assert_allclose(other, turned * one, atol=1e-9)


def test_scans_are_read_with_the_levels_of_the_move_where_they_touch_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its first and its last sample, where light fades along the move."""
    t, sides = 1e-3 * np.arange(3000.0), 100
    used: list[Levels | None] = []
    monkeypatch.setattr(move, "read_scan", lambda *rest: used.append(rest[-1]))
    wave = np.full(len(t), 1.56e-3)
    wave[:sides] += 1e-8 * np.arange(sides, 0.0, -1.0)
    wave[-sides:] += 1e-8 * np.arange(1.0, sides + 1.0)
    shake = 1e-3 * np.random.default_rng(2).standard_normal(len(t))
    found = read_move(t, (2.0 - 0.1 * t) * light(t, 60.0) + shake, wave, MIRRORS)
    assert not found.faults and len(found.count.levels.knots) > 1
    first, last = used
    assert first is not None and last is not None
    for own, place in ((first, t[sides]), (last, t[-sides - 1])):
        expected = found.count.levels.at(float(place))
        assert own.high[0] == pytest.approx(expected.high[0], abs=1e-9)
        assert own.high[0] == pytest.approx(2.0 - 0.1 * place, rel=0.01)
