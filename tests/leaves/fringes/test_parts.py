"""Laws of the parts of fringe counting, each on light whose phase is known: noise, levels, excursions, faults, rests, scans."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.arrays import Array
from truepose.identification.leaves.fringes import excursions as exc
from truepose.identification.leaves.fringes import levels
from truepose.identification.leaves.fringes.excursions import Excursions, extremes, find_excursions
from truepose.identification.leaves.fringes.levels import Levels, Noise, fitted_levels, noise_of
from truepose.identification.leaves.fringes.resting_level import find_rest
from truepose.identification.leaves.fringes.scan import Scan, read_scan
from truepose.models.sensors.irradiance import folded_phase, fringe

G = 0.2
HALF_LEVEL = float(folded_phase(0.5, G))
RATE, START = 7.0, 0.4
"""Phase rate (rad per time) and first phase of a mirror at constant speed."""


def steady(turns: float = 8.3, samples: float = 60.0, rate: float = RATE) -> tuple[Array, Array]:
    """Times and phases of a mirror at constant speed over so many ``turns`` of 2 pi, so many samples each."""
    n = round(turns * samples)
    t = np.arange(float(n)) * (2.0 * np.pi / rate / samples)
    return np.asarray(t, dtype=np.float64), np.asarray(START + rate * t, dtype=np.float64)


def light(phase: Array) -> Array:
    return fringe(np.cos(phase), G)


def excursions(turns: float = 8.3, samples: float = 60.0) -> tuple[Array, Array, Excursions]:
    t, phase = steady(turns, samples)
    return t, light(phase), find_excursions(t, light(phase), 0.0, G)


# -- noise and levels ----------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1e-3, 5.0])
def test_the_noise_of_a_sample_is_its_standard_deviation_whatever_it_lies_on(scale: float) -> None:
    n = 40_000
    t = np.linspace(0.0, 1.0, n)
    found = [
        noise_of(scale * (np.random.default_rng(seed).standard_normal(n) + way)).sigma
        for seed in range(8)
        for way in (0.0 * t, 40.0 * t, 300.0 * t**2)
    ]
    # the calmest fifth of pieces of 256 is calmer than most by a few per cent
    assert np.mean(found) == pytest.approx(scale, rel=0.1)
    assert np.std(found) < 0.05 * scale


def test_a_converter_adds_its_step_and_what_no_average_removes() -> None:
    """Rounding adds step^2 / 12; calm light stays on a step, off by the first harmonic of its staircase."""
    step, rng = 0.5, np.random.default_rng(2)
    calm = noise_of(step * (np.arange(5000) > 2500).astype(float))
    assert calm.sigma == pytest.approx(step / np.sqrt(12.0))
    x = np.linspace(0.0, step, 1001)[:-1]
    staircase = step * np.round(x / step) - x
    harmonic = 2.0 * np.mean(staircase * np.sin(2.0 * np.pi * x / step))
    assert calm.stuck == pytest.approx(abs(float(harmonic)) / np.sqrt(2.0), rel=1e-3)
    for size, most in ((1.0, 1e-7), (2.0, 1e-24)):  # the harmonic fades with the square of the noise
        noisy = noise_of(step * np.round(size * rng.standard_normal(60_000)))
        assert 0.0 < noisy.stuck < most * step
        assert noisy.sigma == pytest.approx(step * np.hypot(size, 1.0 / np.sqrt(12.0)), rel=0.25)
    assert noise_of(rng.standard_normal(2000)).stuck == 0.0
    assert noise_of(np.ones(3)) == Noise(0.0, 0.0)


@pytest.mark.parametrize("drift", [0.0, 0.3])
def test_levels_are_found_where_they_are_and_followed(drift: float) -> None:
    """Also from a wrong start, and with samples that are no light."""
    t, phase = steady(turns=30.0)
    share = t / t[-1]
    rng = np.random.default_rng(3)
    low, high = 2.0 + drift * share, 5.0 + 2.0 * drift * share
    signal = low + (high - low) * light(phase) + 0.01 * rng.standard_normal(len(t))
    signal[::97] += 2.0
    start = Levels(np.zeros(1), np.array([2.1]), np.array([5.1]))
    found = find_excursions(t, start.normalise(t, signal), 0.01, G)
    fitted = fitted_levels(t, signal, found, G, 0.01, 3.0)
    assert fitted is not None
    seen = [np.interp(t, fitted.knots, level) for level in (fitted.low, fitted.high)]
    off = max(float(np.abs(s - true).max()) for s, true in zip(seen, (low, high), strict=True))
    assert off < 0.02 * 3.0
    inside = slice(len(t) // 5, -len(t) // 5)
    assert max(np.abs(seen[0] - low)[inside].max(), np.abs(seen[1] - high)[inside].max()) < 0.005 * 3.0
    assert 0.0 < fitted.sigma < 0.003
    assert (len(fitted.knots) > 1) is (drift > 0.0)
    few = find_excursions(t[:250], start.normalise(t, signal)[:250], 0.01, G)
    assert fitted_levels(t[:250], signal[:250], few, G, 0.01, 3.0) is None


# -- excursions ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [60.0, 9.0])
def test_excursions_of_a_steady_mirror_are_those_of_its_phase(samples: float) -> None:
    t, v, found = excursions(samples=samples)
    low, high = HALF_LEVEL, np.pi - HALF_LEVEL
    # the half level is passed at +-low about every end of the low kind
    last = START + RATE * t[-1]
    ends = 2.0 * np.pi * np.arange(12)
    crossings = np.sort(np.concatenate([ends - low, ends + low]))
    crossings = crossings[(crossings > START) & (crossings < last)]
    np.testing.assert_allclose(START + RATE * found.times, crossings, atol=0.6 / samples)
    assert found.reach == pytest.approx((low, high))
    assert len(found) == len(crossings) + 1 == len(found.high) and (found.high[1:] != found.high[:-1]).all()
    assert found.sizes.sum() == len(t) and found.first[0] == 0 and found.first[-1] == len(t)
    assert np.isnan(found.durations[[0, -1]]).all() and np.isnan(found.speeds[[0, -1]]).all()
    np.testing.assert_allclose(found.durations[1:-1].sum(), found.times[-1] - found.times[0])
    np.testing.assert_allclose(found.speeds[1:-1], RATE, rtol=1.5 / samples)
    middle = np.array(
        [v[a:b].mean() > 0.5 for a, b in zip(found.first[1:-2], found.first[2:-1], strict=True)]
    )
    np.testing.assert_array_equal(found.high[1:-1], middle)
    np.testing.assert_allclose(extremes(v, found)[1:-1], found.high[1:-1], atol=(2.0 * np.pi / samples) ** 2)


# -- faults --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_jump_is_a_step_that_the_speed_around_it_does_not_make(noise: float) -> None:
    t, phase = steady(samples=200.0)
    rng = np.random.default_rng(6)
    shake = noise * rng.standard_normal(len(t))
    steep = (6.0 * np.pi + 0.5 - START) / RATE
    for jump, seen in ((0.0, False), (1.5, True)):
        v = light(phase + jump * (t > steep)) + shake
        assert exc.has_jump(t, v, noise, find_excursions(t, v, noise, G)) is seen
    fast, v, found = excursions(samples=6.0)  # large steps that the speed makes
    assert np.abs(np.diff(v)).max() > 0.3 and not exc.has_jump(fast, v, 0.0, found)
    step = np.where(np.arange(200) < 100, 0.2, 0.4)
    assert exc.has_jump(np.arange(200.0), step, 0.0, find_excursions(np.arange(200.0), step, 0.0, G))


def test_single_spikes_in_calm_light_are_mended_and_peaks_are_not() -> None:
    rng = np.random.default_rng(7)
    t, phase = steady(samples=800.0)
    signal = 3.0 * light(phase) + 0.003 * rng.standard_normal(len(t))
    spoilt = signal.copy()
    spoilt[[1000, 2500]] += (1.5, -1.2)
    mended, count = exc.without_spikes(spoilt, 0.003)
    assert count == 2
    assert np.abs(mended - signal).max() < 0.02
    untouched = np.ones(len(t), dtype=bool)
    untouched[[1000, 2500]] = False
    np.testing.assert_array_equal(mended[untouched], spoilt[untouched])
    for plain in (signal, 3.0 * light(steady(samples=5.0)[1]), signal[:15]):
        same, none = exc.without_spikes(plain, 0.003)
        assert none == 0 and same is plain


# -- rests and scans -----------------------------------------------------------------------------------


@pytest.mark.parametrize("level", [0.3, 0.98])
def test_a_rest_ends_before_the_motion_and_its_level_is_as_good_as_it_says(level: float) -> None:
    off = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        n = np.arange(6000)
        v = level - 0.6 * np.clip((n - 3000) / 1000.0, 0.0, 1.0) ** 3 + 0.01 * rng.standard_normal(6000)
        rest = find_rest(v, Noise(0.01, 0.0))
        assert rest.still and 1000 < rest.samples < 3300
        assert rest.sigma == pytest.approx(0.01 / np.sqrt(rest.samples), rel=0.8)
        off.append((rest.level - level) / rest.sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.6
    _, phase = steady(samples=100.0)  # what moves from the first sample on does not rest
    rest = find_rest(light(phase), Noise(0.001, 0.0))
    assert rest.samples < 20 and not rest.still


BASE, LENGTH, NOISE = 1.56e-3, 0.9, 0.01


def scan(seed: int, length: float = LENGTH, reach: float = 2e-5, levels: Levels | None = None) -> Scan | None:
    """A scan there and back of a cavity at rest; low 1, high 4."""
    rng = np.random.default_rng(seed)
    wave = BASE + reach * (1.0 - np.abs(np.linspace(-1.0, 1.0, 3000)))
    signal = 1.0 + 3.0 * (light(4.0 * np.pi * length / wave) + NOISE * rng.standard_normal(len(wave)))
    return read_scan(wave, signal, BASE, G, 3.0 * NOISE, levels)


def test_a_scan_gives_length_phase_and_levels_to_its_sigma() -> None:
    off = []
    for seed in range(12):
        length = LENGTH + 1e-4 * seed
        found = scan(seed, length)
        assert found is not None and found.low is not None and found.high is not None
        away = np.angle(np.exp(1j * (found.phase - 4.0 * np.pi * length / BASE)))
        off.append(((found.length - length) / found.length_sigma, away / found.phase_sigma))
        assert (found.low, found.high) == pytest.approx((1.0, 4.0), abs=0.02)
        assert found.phase_sigma < 0.02 and found.length_sigma < 1e-3 * LENGTH
    lengths, phases = np.array(off).T
    assert 0.4 < np.sqrt(np.mean(lengths**2)) < 1.7
    assert np.abs(phases).max() < 3.0


def test_levels_go_on_beyond_their_knots_as_they_drift_at_the_ends() -> None:
    knots = np.array([1.0, 2.0, 4.0])
    drifting = Levels(knots, np.array([0.0, 1.0, 5.0]), np.array([10.0, 12.0, 20.0]), 0.01, 0.02)
    far = levels.extended((0.0, 6.0), drifting)
    np.testing.assert_allclose(far.knots, [0.0, 1.0, 2.0, 4.0, 6.0])
    np.testing.assert_allclose(far.low, [-1.0, 0.0, 1.0, 5.0, 9.0])
    np.testing.assert_allclose(far.high, [8.0, 10.0, 12.0, 20.0, 28.0])
    assert (far.sigma, far.misfit) == (0.01, 0.02)
    still = Levels(np.array([2.0]), np.array([1.0]), np.array([3.0]))
    assert levels.extended((0.0, 6.0), still) is still
