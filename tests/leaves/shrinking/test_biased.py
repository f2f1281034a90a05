"""Biased estimators by their formulas: what they are, their estimated errors, what sampling shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from support.command import input_error
from truepose.arrays import Array
from truepose.identification.fit.relinearised import LinearEstimate, Spectrum, decompose, ols
from truepose.identification.leaves.shrinking.estimating import Rule, liu, liu_parameter, pcr, ridge

ESTIMATORS: Mapping[str, Callable[[Spectrum], LinearEstimate]] = MappingProxyType(
    {"ols": ols, "liu": liu, "ridge": ridge, "pcr": pcr}
)
FIXED: Mapping[str, Callable[[Spectrum], LinearEstimate]] = MappingProxyType(
    {
        "ols": ols,
        "liu": lambda problem: liu(problem, 0.4),
        "ridge": lambda problem: ridge(problem, 0.03),
        "pcr": lambda problem: pcr(problem, 4),
    }
)
NOISE = 0.1


def collinear(rng: np.random.Generator, n: int = 40, m: int = 6) -> Array:
    """A design (n, m) whose singular values span three decades."""
    left, right = np.linalg.qr(rng.standard_normal((n, m)))[0], np.linalg.qr(rng.standard_normal((m, m)))[0]
    out: Array = left @ np.diag(np.logspace(1, -2, m)) @ right
    return out


def drawn(rng: np.random.Generator, noise: float = NOISE) -> tuple[Array, Array]:
    """Return a design and what is read of it."""
    h = collinear(rng)
    return h, h @ rng.standard_normal(6) + noise * rng.standard_normal(40)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


# -- definitions ---------------------------------------------------------------------------------------


def test_each_estimator_is_its_formula(rng: np.random.Generator) -> None:
    h, y = drawn(rng)
    problem, square, eye = decompose(h, y), h.T @ h, np.eye(6)
    plain = np.linalg.lstsq(h, y, rcond=None)[0]
    close = partial(np.testing.assert_allclose, rtol=1e-8, atol=1e-10)  # normal equations square 1e3
    close(ols(problem).b, plain)
    close(liu(problem, 0.3).b, np.linalg.solve(square + eye, h.T @ y + 0.3 * plain))
    close(ridge(problem, 0.2).b, np.linalg.solve(square + 0.2 * eye, h.T @ y))
    leading = np.linalg.svd(h)[2][:3].T
    shares = np.linalg.lstsq(h @ leading, y, rcond=None)[0]
    close(pcr(problem, 3).b, leading @ shares)


def test_their_limits_are_least_squares_and_each_other(rng: np.random.Generator) -> None:
    problem = decompose(*drawn(rng))
    for limit in (liu(problem, 1.0), ridge(problem, 0.0), pcr(problem, 6)):
        np.testing.assert_allclose(limit.b, ols(problem).b, rtol=1e-12)
    np.testing.assert_allclose(liu(problem, 0.0).b, ridge(problem, 1.0).b, rtol=1e-12)


def test_what_no_reading_sees_stays_at_zero(rng: np.random.Generator) -> None:
    h = collinear(rng) @ np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    h[:, 4] = h[:, 3]
    problem = decompose(h, rng.standard_normal(40))
    assert len(problem.values) == 4
    for estimator in ESTIMATORS.values():
        found = estimator(problem)
        assert found.b[5] == pytest.approx(0.0, abs=1e-12)
        assert found.b[3] == pytest.approx(found.b[4], rel=1e-9)  # the shortest of all that fit


@pytest.mark.parametrize("name", ESTIMATORS)
def test_many_right_hand_sides_are_each_of_them(rng: np.random.Generator, name: str) -> None:
    h, estimator = collinear(rng), ESTIMATORS[name]
    y = (h @ rng.standard_normal(6))[:, None] + NOISE * rng.standard_normal((40, 7))
    together = estimator(decompose(h, y))
    for k in range(7):
        alone = estimator(decompose(h, y[:, k]))
        np.testing.assert_allclose(together.b[:, k], alone.b, rtol=1e-9)
        assert together.tuning[k] == pytest.approx(float(alone.tuning), rel=1e-9)
        assert together.spectrum.noise[k] == pytest.approx(float(alone.spectrum.noise), rel=1e-9)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_triangular_factor_is_as_good_as_its_rows(rng: np.random.Generator, name: str) -> None:
    h, y = drawn(rng)
    r = np.asarray(np.linalg.qr(np.column_stack([h, y]), mode="r"))
    rows, factor = decompose(h, y), decompose(r[:, :6], r[:, 6], n_observations=40)
    np.testing.assert_allclose(ESTIMATORS[name](factor).b, ESTIMATORS[name](rows).b, rtol=1e-8)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_columns_of_length_one_forget_their_units(rng: np.random.Generator, name: str) -> None:
    h, units = collinear(rng), np.array([1e-3, 1.0, 1e3, 57.3, 25.4, 1.0])
    y = h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40)
    here, there = (
        ESTIMATORS[name](decompose(h * k, y, 1.0 / np.linalg.norm(h * k, axis=0))).b * k
        for k in (np.ones(6), units)
    )
    np.testing.assert_allclose(there, here, rtol=1e-9)


def test_a_problem_counted_from_elsewhere_is_the_same_problem(rng: np.random.Generator) -> None:
    h, away = collinear(rng), 100.0 * rng.standard_normal(6)
    y = h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40)
    whole, moved = decompose(h, y + h @ away), decompose(h, y).counted_from(away)
    np.testing.assert_allclose(moved.alpha, whole.alpha, rtol=1e-9)
    np.testing.assert_allclose(ridge(moved, 0.1).b, ridge(whole, 0.1).b, rtol=1e-9)


def test_no_reading_left_over_is_refused(rng: np.random.Generator) -> None:
    with input_error("found 6 readings for 6 combinations"):
        decompose(rng.standard_normal((6, 6)), rng.standard_normal(6))


# -- the error and what tunes it -----------------------------------------------------------------------


def error(problem: Spectrum, d: float, square: Array) -> float:
    """Equation 13."""
    lam = problem.values**2
    noise = float(problem.noise)
    own = noise * (lam + d) ** 2 / (lam * (lam + 1) ** 2) + (d - 1) ** 2 * square / (lam + 1) ** 2
    return float(np.sum(own))


@pytest.mark.parametrize("rule", ["plug-in", "unbiased"])
def test_the_parameter_is_where_the_estimated_error_is_least(rng: np.random.Generator, rule: Rule) -> None:
    problem = decompose(*drawn(rng))
    square = problem.alpha**2 - (problem.noise / problem.values**2 if rule == "unbiased" else 0.0)
    best = minimize_scalar(
        lambda d: error(problem, d, square), bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-10}
    )
    # a parabola's minimum is found to the root of its rounding
    assert float(liu_parameter(problem, rule)) == pytest.approx(float(best.x), abs=1e-5)


@pytest.mark.parametrize("name", FIXED)
def test_the_covariance_is_what_sampling_shows(rng: np.random.Generator, name: str) -> None:
    """The estimator's variance with its tuning fixed; bias is not in it, and is there."""
    h, b, runs = collinear(rng), rng.standard_normal(6), 20000
    y = (h @ b)[:, None] + NOISE * rng.standard_normal((40, runs))
    found = FIXED[name](decompose(h, y)).b
    said = FIXED[name](decompose(h, y[:, 0])).covariance(NOISE**2)
    scale = np.sqrt(np.outer(np.diag(said), np.diag(said)))
    # a covariance of n samples is known to root(2 / n) = 1 % of its scale
    np.testing.assert_allclose(np.cov(found) / scale, said / scale, atol=0.05)
    bias = np.linalg.norm(found.mean(axis=1) - b)
    assert bool(bias > 0.05) == (name != "ols")
