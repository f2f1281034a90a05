"""Laws of how the levels of a fringe are fitted: which samples, the phase of crossings, robust least squares, knots."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.identification.leaves.fringes import levels
from truepose.identification.leaves.fringes.excursions import find_excursions
from truepose.identification.leaves.fringes.levels import evenly_passed
from truepose.models.sensors.irradiance import folded_phase, fringe

Array = NDArray[np.float64]
G = 0.2
HALF_LEVEL = float(folded_phase(0.5, G))
RATE, START = 7.0, 0.4
"""Phase rate (rad per time) and first phase of a mirror at constant speed."""


def steady(turns: float, samples: float) -> tuple[Array, Array]:
    """Times and phases of a mirror at constant speed over so many ``turns`` of 2 pi, so many samples each."""
    t = np.arange(float(round(turns * samples))) * (2.0 * np.pi / RATE / samples)
    return t, START + RATE * t


def light(phase: Array) -> Array:
    return fringe(np.cos(phase), G)


@pytest.mark.parametrize(("stride", "samples"), [(1, 60.0), (3, 2600.0)])
def test_samples_that_levels_are_fitted_to_are_those_of_the_even_excursions(
    stride: int, samples: float
) -> None:
    """All of them, or every third where that is enough, each with the excursion that owns it."""
    t, phase = steady(120.0, samples)
    v = light(phase)
    found = find_excursions(t, v, 0.0, G)
    even = np.flatnonzero(evenly_passed(v, found, 1.0, 1.15))[3:-1:2]
    at, which = levels.inside_samples(found, even)
    owned = [np.arange(found.first[k], found.first[k + 1]) for k in even]
    np.testing.assert_array_equal(at, np.concatenate(owned)[::stride])
    np.testing.assert_array_equal(which, np.repeat(even, [len(own) for own in owned])[::stride])


@pytest.mark.parametrize("shift", [-0.06, 0.04])
def test_a_half_level_that_is_off_is_seen_in_how_long_excursions_last(shift: float) -> None:
    """Light raised by so much of a fringe crosses 0.5 where it should cross less: nearer to the low end."""
    t, phase = steady(40.0, 3000.0)
    v = light(phase) + shift
    found = find_excursions(t, v, 0.0, G)
    even = np.flatnonzero(evenly_passed(v, found, 1.0, 1.15))
    seen = levels.level_error(found, even, np.zeros(1))
    # phase from the low end at which crossings are, less the one at which they should be
    true = float(folded_phase(0.5 - shift, G)) - HALF_LEVEL
    np.testing.assert_allclose(seen, true, rtol=0.03)
    at, which = levels.inside_samples(found, even)
    unfolded = levels.crossing_phases(t[at], which, found, seen)
    # the end of the fringe that every excursion goes to
    end = np.pi * np.round((START + RATE * 0.5 * (found.times[which] + found.times[which - 1])) / np.pi)
    np.testing.assert_allclose(unfolded, START + RATE * t[at] - end, atol=0.01)


@pytest.mark.parametrize("turns", [5.0, 9.0])
def test_a_half_level_that_drifts_is_seen_when_it_is_off_and_the_same_backwards(turns: float) -> None:
    """Light that rises evenly by a tenth of a fringe, and is right in the middle of the recording."""
    t, phase = steady(turns, 3000.0)
    shift = np.linspace(-0.05, 0.05, len(t))
    seen, true = [], []
    for way in (1, -1):
        v = (light(phase) + shift)[::way]
        found = find_excursions(t, v, 0.0, G)
        even = np.flatnonzero(evenly_passed(v, found, 1.0, 1.3))
        whole = found.times[[even[0] - 1, even[-1]]]
        seen.append(levels.level_error(found, even, whole)[even])
        middle = 0.5 * (found.times[even] + found.times[even - 1])
        true.append(folded_phase(0.5 - np.interp(middle, t, shift[::way]), G) - HALF_LEVEL)
        # half an excursion earlier or later differs by more
        drift = abs(true[-1][-1] - true[-1][0]) / (len(even) - 1)
        np.testing.assert_allclose(seen[-1], true[-1], atol=0.25 * drift)
    np.testing.assert_allclose(seen[0], seen[1][::-1], atol=1e-3 * np.ptp(seen[0]))


@pytest.mark.parametrize("bad", [0, 7])
def test_least_squares_leave_out_what_lies_far_beyond_the_rest(bad: int) -> None:
    rng = np.random.default_rng(8)
    columns = np.column_stack([np.ones(200), np.linspace(-1.0, 1.0, 200)])
    values = columns @ [2.0, -3.0] + 0.01 * rng.standard_normal(200)
    spoilt = values.copy()
    spoilt[:bad] += 5.0
    solution, inverse, rms = levels.robust_fit(columns, spoilt)
    kept = np.arange(200) >= bad
    expected = np.linalg.lstsq(columns[kept], values[kept], rcond=None)[0]
    np.testing.assert_allclose(solution, expected, atol=1e-9)
    np.testing.assert_allclose(inverse, np.linalg.inv(columns[kept].T @ columns[kept]), rtol=1e-9)
    assert rms == pytest.approx(float(np.sqrt(np.mean((values - columns @ expected)[kept] ** 2))))


@pytest.mark.parametrize(("sigmas", "kept"), [(3.5, True), (-3.5, True), (7.0, False), (-7.0, False)])
def test_least_squares_leave_out_what_lies_beyond_five_sigmas(sigmas: float, kept: bool) -> None:
    values = 0.01 * np.random.default_rng(8).standard_normal(1000)
    values[500] = 0.01 * sigmas
    rest = np.arange(1000) != 500
    expected = np.mean(values) if kept else np.mean(values[rest])
    solution, inverse, _ = levels.robust_fit(np.ones((1000, 1)), values)
    assert solution[0] == pytest.approx(expected, abs=1e-12)
    assert 1.0 / inverse[0, 0] == pytest.approx(1000 if kept else 999)


def test_hats_are_straight_between_knots_and_add_up_to_one() -> None:
    knots, t = np.array([1.0, 2.0, 4.0]), np.linspace(0.0, 5.0, 41)
    hats = levels.hat_shares(t, knots)
    np.testing.assert_allclose(hats.sum(axis=1), 1.0)
    for height in np.eye(3):
        np.testing.assert_allclose(hats @ height, np.interp(t, knots, height), atol=1e-12)
    np.testing.assert_array_equal(levels.hat_shares(t, knots[:1]), 1.0)
