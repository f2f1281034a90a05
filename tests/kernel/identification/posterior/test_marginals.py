"""Laws of the linear algebra of a posterior, against covariances of all readings written out in full."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy.stats import norm

from support.linear_problems import (
    SIZES,
    Dense,
    random_problem,
    single,
)
from truepose.arrays import Array
from truepose.identification.posterior.design import GridPoint, Term, Terms
from truepose.identification.posterior.marginal import (
    LARGEST_COST,
    Marginal,
    log_gains,
    log_gains_together,
    marginal,
    plausibility,
)
from truepose.identification.prior import BOUND_DOUBT, Sizes

TERMS = single(1, 2, 1, 3)
WIDTH = 7
POINTS: Sequence[GridPoint] = (GridPoint((1, 0), 0), GridPoint((0, 1), 1), GridPoint((2, 1), 2))
AT = pytest.mark.parametrize("point", POINTS)
seeds = given(st.integers(0, 10**6))


def start(dense: Dense, point: GridPoint, terms: Terms = TERMS) -> Marginal:
    return marginal(dense.design, dense.unknowns, terms, point)


def every(dense: Dense, found: Marginal) -> tuple[Array, Array]:
    """t (w,) and M (w, w), asked for in all the ways that there are."""
    columns = np.arange(dense.g.shape[1])
    rows = found.rows(columns)
    np.testing.assert_allclose(found.among(columns), rows, atol=1e-8)
    np.testing.assert_allclose(found.scores(columns), found.score, atol=1e-8)
    return found.score, rows


# -- marginals ------------------------------------------------------------------------------------------------


@AT
@seeds
@hypothesis_settings(max_examples=10, deadline=None)
def test_scores_and_products_are_those_of_the_whole_covariance(point: GridPoint, seed: int) -> None:
    """Two kinds of channels, geometry in widened tolerances, a column without a prior, others that no widening changes."""
    dense = random_problem(seed)
    inverse = dense.precision(point)
    score, rows = every(dense, start(dense, point))
    np.testing.assert_allclose(score, dense.g.T @ inverse @ dense.e, atol=1e-7)
    np.testing.assert_allclose(rows, dense.g.T @ inverse @ dense.g, atol=1e-7)


@seeds
@hypothesis_settings(max_examples=10, deadline=None)
def test_log_evidence_of_two_points_differs_as_their_densities(seed: int) -> None:
    dense = random_problem(seed)
    found = [start(dense, point).log_evidence for point in POINTS]
    exact = [dense.log_evidence(point) for point in POINTS]
    np.testing.assert_allclose(np.diff(found), np.diff(exact), atol=1e-6)
    # what is left of both, whatever the point, is a constant of the readings
    assert found[0] - exact[0] == pytest.approx(found[2] - exact[2], abs=1e-6)


@AT
@seeds
@hypothesis_settings(max_examples=10, deadline=None)
def test_what_is_taken_in_is_marginalised(point: GridPoint, seed: int) -> None:
    """At once or one after the other, its log Bayes factor, and all that is left of the other columns."""
    dense = random_problem(seed)
    columns, sizes = [1, 2, 5], [0.7, 0.7, 2.0]
    root = start(dense, point)
    once = root.including(np.array(columns), np.array(sizes))
    twice = root.including(np.array(columns[:2]), np.array(sizes[:2])).including(
        np.array(columns[2:]), np.array(sizes[2:])
    )
    inverse = dense.precision(point, columns, sizes)
    gain = dense.log_evidence(point, columns, sizes) - dense.log_evidence(point)
    assert root.gain(np.array(columns), np.array(sizes)) == pytest.approx(gain, abs=1e-6)
    for found in (once, twice):
        score, rows = every(dense, found)
        np.testing.assert_allclose(score, dense.g.T @ inverse @ dense.e, atol=1e-6)
        np.testing.assert_allclose(rows, dense.g.T @ inverse @ dense.g, atol=1e-6)
        assert found.log_evidence - root.log_evidence == pytest.approx(gain, abs=1e-6)


@AT
@seeds
@hypothesis_settings(max_examples=10, deadline=None)
def test_what_is_left_out_again_was_never_there(point: GridPoint, seed: int) -> None:
    """Scores, rows, blocks, evidence, and what is taken in afterwards."""
    dense = random_problem(seed)
    columns, sizes = np.array([1, 2, 5, 6]), np.array([0.7, 0.7, 2.0, 300.0])
    root = start(dense, point)
    out = np.array([1, 3])
    kept = np.delete(np.arange(4), out)
    found = root.including(columns, sizes).without(out)
    exact = root.including(columns[kept], sizes[kept])
    for one, other in zip(every(dense, found), every(dense, exact), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)
    assert found.log_evidence == pytest.approx(exact.log_evidence, abs=1e-6)
    gains = [log_gains([m], SIZES)[0] for m in (found, exact)]
    np.testing.assert_allclose(gains[0], gains[1], atol=1e-5)
    more = [m.including(columns[out], sizes[out]).log_evidence for m in (found, exact)]
    assert more[0] == pytest.approx(more[1], abs=1e-6)


@AT
@seeds
@hypothesis_settings(max_examples=10, deadline=None)
def test_coefficients_are_those_of_conditioned_gaussians(point: GridPoint, seed: int) -> None:
    dense = random_problem(seed)
    columns, sizes = np.array([0, 3, 4]), np.array([0.5, 1.5, 1.5])
    inside = dense.g[:, columns]
    inverse = dense.precision(point)
    covariance = np.linalg.inv(inside.T @ inverse @ inside + np.diag(sizes**-2.0))
    mean, found = start(dense, point).posterior(columns, sizes)
    np.testing.assert_allclose(found, covariance, atol=1e-8)
    np.testing.assert_allclose(mean, covariance @ inside.T @ inverse @ dense.e, atol=1e-7)


@AT
@pytest.mark.parametrize("add", [10.0, -1e4])
def test_what_has_no_prior_may_be_anything(point: GridPoint, add: float) -> None:
    """A constant along a column without tolerance changes no score, no evidence and no gain."""
    dense = random_problem(3, flat=2)
    flat = np.flatnonzero(~np.isfinite(dense.always.sigma))
    moved = replace(dense, e=dense.e + add * dense.a[:, flat[0]] - 0.3 * add * dense.a[:, flat[1]])
    one, other = start(dense, point), start(moved, point)
    np.testing.assert_allclose(other.score, one.score, atol=1e-9 * abs(add) + 1e-8)
    assert other.log_evidence == pytest.approx(one.log_evidence, abs=1e-10 * add**2 + 1e-6)
    gains = [log_gains([m], SIZES)[0] for m in (one, other)]
    np.testing.assert_allclose(gains[1], gains[0], atol=1e-8 * abs(add) + 1e-7)


def test_a_term_that_is_a_column_without_a_prior_is_never_seen() -> None:
    dense = random_problem(4)
    flat = int(np.flatnonzero(~np.isfinite(dense.always.sigma))[0])
    g = dense.g.copy()
    g[:, 0] = 7.0 * dense.a[:, flat]
    hidden = replace(dense, g=g)
    assert hidden.design.seen.tolist() == [False] + [True] * (WIDTH - 1)
    found = log_gains([start(hidden, POINTS[0])], SIZES)[0]
    np.testing.assert_allclose(found[:, 0], 0.0, atol=1e-9)  # as likely with it as without


# -- gains of terms ---------------------------------------------------------------------------------------------


@AT
@seeds
@hypothesis_settings(max_examples=10, deadline=None)
def test_gains_are_the_log_bayes_factors_of_terms_of_any_width(point: GridPoint, seed: int) -> None:
    """Columns that fill a term up to a common width count for nothing."""
    dense = random_problem(seed)
    found = log_gains([start(dense, point)], SIZES)[0]
    null = dense.log_evidence(point)
    for k, own in enumerate(TERMS.columns):
        for s, size in enumerate(SIZES.values):
            gain = dense.log_evidence(point, own.tolist(), [float(size)] * len(own)) - null
            assert found[s, k] == pytest.approx(gain, abs=1e-6)


def test_points_weighed_at_once_are_weighed_as_one_by_one() -> None:
    """A root, and what is left beside columns that were taken in."""
    dense = random_problem(1)
    every = [start(dense, point) for point in POINTS]
    every.append(every[0].including(np.array([1, 2]), np.array([0.7, 2.0])))
    found = log_gains(every, SIZES)
    for one, own in zip(every, found, strict=True):
        np.testing.assert_allclose(log_gains([one], SIZES)[0], own, rtol=1e-12)


@seeds
@hypothesis_settings(max_examples=20, deadline=None)
def test_a_sign_is_worth_its_chance_and_at_most_a_factor_of_two(seed: int) -> None:
    dense = random_problem(seed)
    free = Term((0,), 0, 0, 0.0, (-np.inf,), (np.inf,))
    bounded = replace(free, cause=1, lower=(0.0,)), replace(free, cause=2, lower=(0.0,), upper=(1e-6,))
    terms = Terms([free, *bounded], single(1, 1, 1).urn)
    sizes = Sizes(np.array([0.3, 1.0]), np.log([0.5, 0.5]))
    root = start(dense, POINTS[0], terms)
    found = log_gains([root], sizes)[0]
    worth = found[:, 1] - found[:, 0]
    assert np.all(worth <= np.log(2.0) + 1e-9)
    for s, size in enumerate(sizes.values):
        mean, covariance = root.posterior(np.array([0]), np.array([size]))
        expected = np.log(2.0) + norm.logcdf(mean[0] / np.sqrt(covariance[0, 0]))
        assert worth[s] == pytest.approx(expected, abs=1e-6)
    assert np.all(found[:, 2] <= found[:, 1] + 1e-12)
    assert np.all(found[:, 2] >= found[:, 1] - LARGEST_COST - 1e-9)


@given(st.floats(1.0, 40.0), st.floats(1.0, 1.5))
def test_the_further_beyond_its_bound_the_more_a_coefficient_costs(times: float, more: float) -> None:
    """The square of the log of the excess in units of a fifth, halved, and never more than a limit; either way."""

    def cost(value: float) -> float:
        one = np.ones((1, 1))
        return float(plausibility(value * one[None], 0.0 * one[None], -one, one)[0, 0])

    here, beyond = cost(times), cost(times * more)
    assert 0.0 >= here >= beyond >= -LARGEST_COST
    assert here == pytest.approx(max(-0.5 * (np.log(times) / BOUND_DOUBT) ** 2, -LARGEST_COST))
    assert cost(-times) == here


@given(st.floats(-1.0, 1.0), st.floats(0.0, 3.0))
def test_within_its_bounds_or_not_surely_beyond_a_coefficient_costs_nothing(value: float, std: float) -> None:
    one = np.ones((1, 1))
    assert plausibility(value * one[None], std * one[None], -one, one)[0, 0] == 0.0
    far = (1.0 + 2.9 * std) * one[None]
    assert plausibility(far, std * one[None], -one, one)[0, 0] == 0.0


# -- terms of many columns, groups, bounds ------------------------------------------------------------------------


@pytest.mark.parametrize("width", [17, 18, 19, 25])
def test_terms_of_many_columns_gain_as_their_columns_together_do(width: int) -> None:
    """Filled up to a common width, or factored one by one: at every point, beside others, at every size."""
    dense = random_problem(2, readings=60, width=width + 4)
    terms = single(width, 1, 3)
    root = start(dense, POINTS[0], terms)
    beside = root.including(np.array([width]), np.array([0.6]))
    found = log_gains([root, beside], SIZES)
    for marginal_, own in zip((root, beside), found, strict=True):
        for k, columns in enumerate(terms.columns):
            for s, size in enumerate(SIZES.values):
                gain = marginal_.gain(columns, np.full(len(columns), size))
                assert own[s, k] == pytest.approx(gain, abs=1e-7)


def test_columns_of_a_group_gain_together_with_the_prior_of_their_size() -> None:
    dense = random_problem(6)
    root, columns = start(dense, POINTS[1]), np.array([0, 3, 5])
    found = log_gains_together(root, columns, SIZES)
    expected = [root.gain(columns, np.full(3, size)) for size in SIZES.values] + SIZES.log_prior
    np.testing.assert_allclose(found, expected, atol=1e-8)


@AT
def test_the_last_of_some_coefficients_are_told_as_among_all(point: GridPoint) -> None:
    dense = random_problem(8)
    root, columns, sizes = start(dense, point), np.array([4, 0, 6, 2]), np.array([0.5, 2.0, 1.0, 0.7])
    mean, covariance = root.posterior(columns, sizes)
    for number in (1, 3, 4):
        last, std = root.last(columns, sizes, number)
        np.testing.assert_allclose(last, mean[-number:], atol=1e-9)
        np.testing.assert_allclose(std, np.sqrt(np.diag(covariance))[-number:], atol=1e-9)


@AT
def test_bounds_of_terms_of_several_columns_are_those_of_their_own_coefficients(point: GridPoint) -> None:
    """The gain without bounds, and what mean and 1-sigma of each coefficient say of its sign."""
    dense = random_problem(9)
    free = Term((1, 2, 5), 0, 0, 0.0, (-np.inf,) * 3, (np.inf,) * 3)
    held = replace(free, cause=1, lower=(0.0, -np.inf, 0.0), upper=(np.inf, 0.2, 0.5))
    root = start(dense, point, Terms([free, held], single(1, 1).urn))
    found = log_gains([root], SIZES)[0]
    for s, size in enumerate(SIZES.values):
        mean, covariance = root.posterior(np.array([1, 2, 5]), np.full(3, size))
        std = np.sqrt(np.diag(covariance))
        expected = plausibility(mean, std, np.array(held.lower), np.array(held.upper))
        assert found[s, 1] - found[s, 0] == pytest.approx(float(expected), abs=1e-7)
