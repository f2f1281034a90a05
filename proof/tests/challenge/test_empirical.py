"""The best model without a name: what it must reach, and when it must hold still."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from challenge.empirical import MOST, RIDGE, Problem, best_empirical, errors_left
from challenge.setup import Setup
from challenge.simulator.base import Imperfection, Plan
from challenge.slopes import Constant
from proof_support.tiny_machine import Tiny

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def setup() -> Setup:
    rng = np.random.default_rng(3)
    return Setup.draw(Tiny(), Tiny().specimen(rng), Plan(poses=40), rng)


def _told(setup: Setup, things: tuple[Imperfection, ...], seed: int = 1) -> Array:
    """(MOST + 1,) errors with so many columns allowed."""
    exact, held = setup.exact(things)
    noise = setup.sigma * np.random.default_rng(seed).standard_normal(exact.shape)
    calm = np.ones(len(exact), dtype=bool)
    return np.array(best_empirical(setup, exact + noise, held, calm))


def test_a_smooth_error_of_a_joint_is_followed_by_a_few_columns(setup: Setup) -> None:
    errors = _told(setup, (Imperfection("gain", ("q2",), 2e-3),))
    assert len(errors) == MOST + 1
    assert errors[3] < 0.1 * errors[0]


def test_where_nothing_is_missing_no_column_is_taken_that_costs_much(setup: Setup) -> None:
    """The fewest columns within a standard error of the best: noise alone calls for none, or nearly none."""
    kept = [np.max(_told(setup, (), seed)) / _told(setup, (), seed)[0] for seed in range(5)]
    assert np.median(kept) < 1.2


def test_wild_rows_are_left_out(setup: Setup) -> None:
    exact, held = setup.exact(())
    rng = np.random.default_rng(5)
    read = exact + setup.sigma * rng.standard_normal(exact.shape)
    calm = np.ones(len(exact), dtype=bool)
    calm[[3, 20]] = False
    good = best_empirical(setup, read, held, calm)
    read[~calm] += 5.0  # mm
    assert best_empirical(setup, read, held, calm) == good


def test_without_columns_it_is_the_fit_under_tolerances() -> None:
    """Error of the posterior mean, written out as generalised least squares."""
    rng = np.random.default_rng(7)
    n, f = 60, 4
    J, ahead = rng.standard_normal((n, f)), rng.standard_normal((30, f))
    off = rng.standard_normal(f)
    free = tuple(Constant(f"c{k}", 1.0, 0.01, 1.0, float(off[k]), False) for k in range(f))
    seen = rng.standard_normal(n)
    nothing = Problem(J, rng.standard_normal((n, 3)), seen)
    asked = Problem(ahead, rng.standard_normal((30, 3)), np.zeros(30))
    # steps from the truth: nominal values lie at -off, with a tolerance of one step
    mean = -off + J.T @ np.linalg.solve(np.eye(n) + J @ J.T, seen + J @ off)
    errors = errors_left(nothing, asked, free)
    assert errors[0] == pytest.approx(float(np.sqrt(np.mean((ahead @ mean) ** 2))), rel=1e-9)
    # one column that has no other beside it: the same with the column as a direction of its own, under its prior
    column, its_way = rng.standard_normal(n), rng.standard_normal(30)
    length = np.sqrt(column @ np.linalg.solve(np.eye(n) + J @ J.T, column))
    rows = [np.column_stack([J, column]), np.column_stack([np.eye(f), np.zeros(f)])]
    stacked = np.vstack([*rows, np.append(np.zeros(f), np.sqrt(RIDGE) * length)])
    both = np.linalg.lstsq(stacked, np.append(np.append(seen, -off), 0.0), rcond=None)[0]
    one = errors_left(Problem(J, column[:, None], seen), Problem(ahead, its_way[:, None], np.zeros(30)), free)
    missed = ahead @ both[:f] + its_way * both[f]
    assert one[1] == pytest.approx(float(np.sqrt(np.mean(missed**2))), rel=1e-9)
    assert one[1:] == pytest.approx(one[1])
