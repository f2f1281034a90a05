"""Biased estimators by their formulas: what they are, their estimated errors, what sampling shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np
import pytest
import sympy as sp  # type: ignore[import-untyped]
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from truepose.errors import InputError
from truepose.identification.fit.relinearised import LinearEstimate, Spectrum, decompose, ols
from truepose.identification.leaves.shrinking.estimating import Rule, liu, liu_parameter, pcr, ridge

Array = NDArray[np.float64]
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


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


# -- definitions ---------------------------------------------------------------------------------------


def test_each_estimator_is_its_formula(rng: np.random.Generator) -> None:
    h = collinear(rng)
    y = h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40)
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
    h = collinear(rng)
    problem = decompose(h, h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40))
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
    h = collinear(rng)
    y = h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40)
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


def test_raw_columns_do_not_forget_them(rng: np.random.Generator) -> None:
    """The paper's choice: what Liu's estimator makes of angles depends on whether they are rad or deg."""
    h = collinear(rng)
    y = h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40)
    here, there = (liu(decompose(h * k, y)).b * k for k in (1.0, 57.3))
    assert np.linalg.norm(there - here) > 0.1 * np.linalg.norm(here)


def test_a_problem_counted_from_elsewhere_is_the_same_problem(rng: np.random.Generator) -> None:
    h, away = collinear(rng), 100.0 * rng.standard_normal(6)
    y = h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40)
    whole, moved = decompose(h, y + h @ away), decompose(h, y).counted_from(away)
    np.testing.assert_allclose(moved.alpha, whole.alpha, rtol=1e-9)
    np.testing.assert_allclose(ridge(moved, 0.1).b, ridge(whole, 0.1).b, rtol=1e-9)


def test_no_reading_left_over_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="found 6 readings for 6 combinations"):
        decompose(rng.standard_normal((6, 6)), rng.standard_normal(6))


# -- the error and what tunes it -----------------------------------------------------------------------


def test_the_papers_parameter_minimises_the_papers_error() -> None:
    """Equation 14 is right: derived from equation 13 for two coordinates."""
    d, variance = sp.symbols("d s2", positive=True)
    lam, a = sp.symbols("l1:3", positive=True), sp.symbols("a1:3", real=True)
    error = sum(
        variance * (k + d) ** 2 / (k * (k + 1) ** 2) + (d - 1) ** 2 * b**2 / (k + 1) ** 2
        for k, b in zip(lam, a, strict=True)
    )
    (best,) = sp.solve(sp.diff(error, d), d)
    above = sum((b**2 - variance) / (k + 1) ** 2 for k, b in zip(lam, a, strict=True))
    below = sum((variance + k * b**2) / (k * (k + 1) ** 2) for k, b in zip(lam, a, strict=True))
    assert sp.simplify(best - above / below) == 0
    # with the unbiased estimate of each square it becomes Liu's own
    seen = sp.symbols("b1:3", real=True)
    unbiased = best.subs({b: sp.sqrt(c**2 - variance / k) for k, b, c in zip(lam, a, seen, strict=True)})
    own = 1 - variance * sum(1 / (k * (k + 1)) for k in lam) / sum(
        c**2 / (k + 1) ** 2 for k, c in zip(lam, seen, strict=True)
    )
    assert sp.simplify(unbiased - own) == 0


def error(problem: Spectrum, d: float, square: Array) -> float:
    """Equation 13."""
    lam = problem.values**2
    noise = float(problem.noise)
    own = noise * (lam + d) ** 2 / (lam * (lam + 1) ** 2) + (d - 1) ** 2 * square / (lam + 1) ** 2
    return float(np.sum(own))


@pytest.mark.parametrize("rule", ["plug-in", "unbiased"])
def test_the_parameter_is_where_the_estimated_error_is_least(rng: np.random.Generator, rule: Rule) -> None:
    h = collinear(rng)
    problem = decompose(h, h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40))
    square = problem.alpha**2 - (problem.noise / problem.values**2 if rule == "unbiased" else 0.0)
    best = minimize_scalar(
        lambda d: error(problem, d, square), bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-10}
    )
    # a parabola's minimum is found to the root of its rounding
    assert float(liu_parameter(problem, rule)) == pytest.approx(float(best.x), abs=1e-5)


def test_the_number_of_components_has_the_least_estimated_error(rng: np.random.Generator) -> None:
    h = collinear(rng)
    problem = decompose(h, h @ rng.standard_normal(6) + 3 * NOISE * rng.standard_normal(40))
    spread, square = problem.noise / problem.values**2, problem.alpha**2
    errors = [np.sum(spread[:k]) + np.sum((square - spread)[k:]) for k in range(7)]
    assert int(pcr(problem).tuning) == int(np.argmin(errors))


def test_ridge_follows_hoerl_kennard_and_baldwin(rng: np.random.Generator) -> None:
    h = collinear(rng)
    problem = decompose(h, h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40))
    plain = ols(problem).b
    assert float(ridge(problem).tuning) == pytest.approx(6 * float(problem.noise) / float(plain @ plain))


def test_the_error_formula_is_what_sampling_shows(rng: np.random.Generator) -> None:
    h, b, d, runs = collinear(rng), rng.standard_normal(6), 0.4, 20000
    y = (h @ b)[:, None] + NOISE * rng.standard_normal((40, runs))
    seen = np.mean(np.sum((liu(decompose(h, y), d).b.T - b) ** 2, axis=1))
    _, s, directions = np.linalg.svd(h, full_matrices=False)
    truth = Spectrum(s, directions.T, np.ones(6), directions @ b, np.array(NOISE**2))
    # squares of one leading coordinate: relative error of their mean is root(2 / runs) = 1 %
    assert seen == pytest.approx(error(truth, d, truth.alpha**2), rel=0.04)


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


@pytest.mark.parametrize("name", ["liu", "ridge", "pcr"])
def test_near_dependence_pays_for_bias(rng: np.random.Generator, name: str) -> None:
    """Where least squares blows up, each of them varies less and errs less, by its own rule."""
    h, b = collinear(rng), np.array([0.3, -0.2, 0.1, 0.4, -0.1, 0.2])
    y = (h @ b)[:, None] + NOISE * rng.standard_normal((40, 5000))
    problem = decompose(h, y)
    biased, plain = ESTIMATORS[name](problem).b, ols(problem).b
    assert np.sum(np.var(biased, axis=1)) < 0.8 * np.sum(np.var(plain, axis=1))
    assert np.mean((biased.T - b) ** 2) < 0.8 * np.mean((plain.T - b) ** 2)
