"""Parts of the independent simulator: operators with memory, heat in bodies, a cantilever."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from challenge.simulator import heat, operators
from challenge.simulator.base import Array
from challenge.simulator.cantilever import Section, cantilever
from challenge.simulator.stewart_physics import ring_compliance
from support.examples import examples

signals = arrays(np.float64, st.integers(2, 30), elements=st.floats(-5, 5, width=32))


class TestOperators:
    @given(signals, st.floats(0, 3))
    def test_play_is_exact_between_turning_points(self, path: Array, r: float) -> None:
        """Rate independence: points added on the way change nothing."""
        fine = np.interp(np.arange(0, len(path) - 0.9, 0.25), np.arange(len(path)), path)
        np.testing.assert_allclose(
            operators.play(fine[:, None], r)[::4], operators.play(path[:, None], r), atol=1e-13
        )

    @given(signals, st.floats(0.01, 3))
    def test_play_stays_within_its_width_and_lags(self, path: Array, r: float) -> None:
        out = operators.play(path, r)
        assert np.all(np.abs(path - out) <= r + 1e-12)
        assert np.all(np.diff(out) * np.diff(path) >= 0)

    @given(signals, st.floats(0.01, 3))
    def test_play_of_a_rising_path_is_idempotent(self, path: Array, r: float) -> None:
        rising = np.sort(path)
        once = operators.play(rising, r)
        np.testing.assert_array_equal(operators.play(once, 0.0, start=once[0]), once)
        np.testing.assert_allclose(operators.play(rising, r, start=once[0]), once, atol=0)

    @given(signals, st.floats(0.01, 2))
    def test_larger_turning_points_wipe_out_smaller_ones(self, path: Array, r: float) -> None:
        """After a sweep that is wider than all before it, no memory of them is left."""
        sweep = np.array([20.0, -20.0, 3.0])
        after = operators.play(np.concatenate([path, sweep]), r)[-1]
        assert after == operators.play(sweep, r)[-1]

    @given(signals)
    def test_no_width_no_memory(self, path: Array) -> None:
        np.testing.assert_array_equal(operators.play(path, 0.0), path)

    def test_the_approach_side_decides_after_an_overshoot(self) -> None:
        q = np.array([[0.3], [0.3], [-0.2]])
        side = np.array([[1.0], [-1.0], [1.0]])
        stood = operators.at_rows(operators.play(operators.waypoints(q, side, 0.1), 0.01))
        np.testing.assert_allclose(stood, q - 0.01 * side, atol=1e-15)

    def test_presliding_saturates_at_the_coulomb_limit(self) -> None:
        path = np.linspace(0, 1, 50)
        share = operators.presliding(path, [0.1, 0.4], [0.7, 0.3])
        assert share[-1] == pytest.approx(1.0)
        assert np.all(np.diff(share) >= -1e-15)

    @given(signals)
    def test_prandtl_ishlinskii_without_weights_is_nothing(self, path: Array) -> None:
        np.testing.assert_array_equal(
            operators.prandtl_ishlinskii(path, [0.1, 1.0], [0.0, 0.0]), np.zeros_like(path)
        )

    def test_creep_grows_with_the_logarithm_of_time(self) -> None:
        waits = np.array([10.0, 100.0, 1000.0])
        crept = [
            operators.creep(np.array([[0.0], [1.0]]), np.array([0.0, w]), 0.01, dwell=np.array([0.0, w]))[
                1, 0
            ]
            for w in waits
        ]
        # three elements to a decade follow the logarithm to a few percent
        np.testing.assert_allclose(np.diff(crept), 0.01, rtol=0.05)

    def test_creep_of_a_still_machine_is_nothing(self) -> None:
        still = np.full((5, 2), 0.7)
        np.testing.assert_array_equal(operators.creep(still, np.arange(5.0), 0.1), np.zeros((5, 2)))

    @given(st.floats(-1e3, 1e3), st.floats(1, 50))
    def test_a_stiffening_spring_balances_its_torque(self, torque: float, ratio: float) -> None:
        spring = operators.StiffeningSpring(1e6, ratio, 1e-3)
        w = float(spring.windup(np.array([torque]))[0])
        assert 1e6 * w + 1e6 * (ratio - 1) * w**3 / 1e-6 == pytest.approx(torque, rel=1e-9, abs=1e-6)

    @given(st.floats(0, 0.2), st.floats(-3, 3), st.floats(-3, 3))
    def test_an_eccentric_disc_reads_the_direction_of_its_head(
        self, e: float, phase: float, reading: float
    ) -> None:
        true = float(operators.eccentric_disc(np.array([reading]), e, phase)[0])
        centre = e * np.array([np.cos(true + phase), np.sin(true + phase)])
        seen = np.arctan2(*(np.array([1.0, 0.0]) - centre)[::-1])
        assert np.exp(1j * (true - seen)) == pytest.approx(np.exp(1j * reading), abs=1e-12)

    @given(arrays(np.float64, 6, elements=st.floats(-3, 3)))
    def test_a_centred_disc_reads_true(self, reading: Array) -> None:
        np.testing.assert_array_equal(operators.eccentric_disc(reading, 0.0, 1.0), reading)


class TestHeat:
    def test_a_lump_follows_a_ramp_by_its_lag(self) -> None:
        time = np.linspace(0, 1e5, 500)
        body = heat.lump(time, 1e-3 * time, 600.0)
        assert 1e-3 * time[-1] - body[-1] == pytest.approx(0.6, rel=1e-9)

    @settings(max_examples=examples(30))
    @given(st.floats(10, 3000), st.integers(2, 6))
    def test_more_instants_change_nothing(self, lag: float, parts: int) -> None:
        time, drive = np.array([0.0, 400.0, 700.0, 2000.0]), np.array([20.0, 26.0, 21.0, 24.0])
        fine = np.unique(np.concatenate([np.linspace(0, 2000, 20 * parts), time]))
        body = heat.lump(fine, np.interp(fine, time, drive), lag)
        np.testing.assert_allclose(body[np.searchsorted(fine, time)], heat.lump(time, drive, lag), atol=1e-9)

    def test_skin_leads_core_and_both_arrive(self) -> None:
        time = np.linspace(0, 40_000, 300)
        skin, core = heat.skin_and_core(time, np.where(time > 0, 30.0, 20.0), 300.0, 1200.0)
        assert np.all(skin[1:] >= core[1:])
        assert skin[-1] == pytest.approx(30.0, abs=1e-3)
        assert core[-1] == pytest.approx(30.0, abs=1e-3)

    def test_no_strain_at_twenty_degrees(self) -> None:
        assert heat.strain(20.0, 1e-5) == 0.0


class TestCantilever:
    def test_textbook_deflections(self) -> None:
        """F L^3 / 3 EI, F L^2 / 2 EI, w L^4 / 8 EI of a slender bar; shear is left, (d / L)^2 of it."""
        section, length = Section.tube(20.0, 18.0), 4000.0
        by_wrench, by_weight = cantilever(np.zeros(3), np.array([0.0, 0.0, length]), section)
        ei = section.young * section.second
        assert by_wrench[0, 0] == pytest.approx(length**3 / 3 / ei, rel=1e-3)
        assert by_wrench[4, 0] == pytest.approx(length**2 / 2 / ei, rel=1e-9)
        assert by_weight[0, 0] == pytest.approx(length**3 / 8 / ei, rel=1e-3)
        assert by_weight[4, 0] == pytest.approx(length**2 / 6 / ei, rel=1e-9)

    def test_compliance_is_symmetric_and_positive(self) -> None:
        for C in (
            cantilever(np.ones(3), np.array([300.0, 80.0, -50.0]), Section.box(50, 44))[0],
            ring_compliance(),
        ):
            np.testing.assert_allclose(C, C.T, atol=1e-9 * np.max(C))
            assert np.min(np.linalg.eigvalsh(C)) > 0
