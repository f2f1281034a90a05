"""The Airy function of a cavity: against the sum over beams, and its inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support import fringe_signal as signals
from truepose.errors import InputError
from truepose.models.sensors.irradiance import (
    cosine,
    coupling,
    folded_phase,
    fringe,
    fringe_slope,
    irradiance,
    phase_noise,
    reflectance,
    round_trip_phase,
)

WAVELENGTH = 1.56e-3
mirrors = st.floats(0.001, 0.95)


@given(mirrors, mirrors, st.floats(-20.0, 20.0))
def test_closed_form_is_the_sum_over_beams(first: float, second: float, phase: float) -> None:
    beams = signals.reflected(np.array([phase]), (first, second))[0]
    # the sum stops at 1e-15 and holds up to 700 terms: rounding stays below 1e-12
    assert float(reflectance(phase, (first, second))) == pytest.approx(beams, abs=1e-12)


@given(mirrors, mirrors, st.floats(-20.0, 20.0))
def test_reflectance_is_a_share_between_resonance_and_antiresonance(
    first: float, second: float, phase: float
) -> None:
    low, high = (float(reflectance(at, (first, second))) for at in (0.0, np.pi))
    value = float(reflectance(phase, (first, second)))
    assert 0.0 <= low < high < 1.0
    assert low - 1e-14 <= value <= high + 1e-14  # some ten roundings


@given(mirrors, mirrors, st.floats(0.01, 2.0), st.integers(-5, 5))
def test_period_in_length_is_half_a_wavelength(first: float, second: float, length: float, n: int) -> None:
    there = irradiance(length, WAVELENGTH, (first, second), 3.0, 0.5)
    again = irradiance(length + n * WAVELENGTH / 2.0, WAVELENGTH, (first, second), 3.0, 0.5)
    # a phase of 1.6e4 rad is known to 4e-12 rad; the steepest slope is below 30 per rad
    assert float(again) == pytest.approx(float(there), abs=1e-9)
    assert float(round_trip_phase(WAVELENGTH / 2.0, WAVELENGTH)) == pytest.approx(2.0 * np.pi)


@given(mirrors, mirrors, st.floats(-6.0, 6.0))
def test_fringe_is_the_normalised_reflectance(first: float, second: float, phase: float) -> None:
    pair = (first, second)
    low, high = (float(reflectance(at, pair)) for at in (0.0, np.pi))
    expected = (float(reflectance(phase, pair)) - low) / (high - low)
    # weak mirrors make fringes of some 1e-3, where rounding is 1e-13 of a fringe
    assert float(fringe(np.cos(phase), coupling(pair))) == pytest.approx(expected, abs=1e-9)


@given(st.floats(0.001, 0.95), st.floats(0.01, np.pi - 0.01))
def test_phase_comes_back(g: float, phase: float) -> None:
    # near an end of a fringe rounding of v is magnified by 1 / slope, at most 1e7 here
    assert float(folded_phase(fringe(np.cos(phase), g), g)) == pytest.approx(phase, abs=1e-8)
    assert float(folded_phase(fringe(np.cos(-phase), g), g)) == pytest.approx(phase, abs=1e-8)


@given(st.floats(0.001, 0.9), st.floats(0.1, 3.0))
def test_slope_is_the_derivative(g: float, phase: float) -> None:
    step = 1e-5
    up, down = (float(fringe(np.cos(phase + s), g)) for s in (step, -step))
    # the third derivative is below 2e4 for g <= 0.9: 2e-6 of truncation
    assert float(fringe_slope(phase, g)) == pytest.approx((up - down) / (2.0 * step), rel=1e-4, abs=1e-5)


@given(st.floats(0.001, 0.95))
def test_noise_beyond_a_fringe_counts_as_its_end(g: float) -> None:
    # the formula at the ends is rounded, by less than 1e-12 where the fringe is sharpest
    assert float(cosine(-0.1, g)) == pytest.approx(1.0, abs=1e-12)
    assert float(cosine(1.1, g)) == pytest.approx(-1.0, abs=1e-12)


def test_phase_noise_is_the_spread_of_the_inverse() -> None:
    rng = np.random.default_rng(3)
    g, noise = coupling((0.04, 0.9)), 0.002
    for phase in (0.5, 1.2, 2.0, 2.6):
        v = float(fringe(np.cos(phase), g))
        spread = np.std(folded_phase(v + noise * rng.standard_normal(4000), g))
        # 4000 draws know a standard deviation to 1.1 %; the joint formula adds up to 5 %
        assert float(phase_noise(v, noise, g)) == pytest.approx(spread, rel=0.1)


@pytest.mark.parametrize("pair", [(0.0, 0.9), (0.04, 1.0), (-0.1, 0.5), (0.5, np.nan)])
def test_reflectivities_outside_the_open_interval_are_refused(pair: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="reflectivities"):
        coupling(pair)
