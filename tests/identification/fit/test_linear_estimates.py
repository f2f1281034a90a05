"""Laws of relinearised linear estimators, on problems that are linear: what each is, what it knows of itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.identification.fit import leastsquares
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import WIDE_PROBLEM, Status
from truepose.identification.fit.problem import Prior, Problem
from truepose.identification.fit.relinearised import Scaling, Shrunk, column_scale, relinearised
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
TOLERANCE = np.array([0.3, 2.0, 0.05, 1.0, 0.2])
DRAWN = np.array([1.0, -2.0, 0.5, 10.0, 3.0])
STEP = np.array([0.5, 1.0, 0.1, 100.0, 0.4])
"""Tolerances, drawing values and steps of five parameters, the fourth of which has no tolerance where one is loose."""
LOOSE = np.array([False, False, False, True, False])
READINGS = 30
SIGMAS = (0.02, 0.5)


def prior(sigma: Array) -> Prior:
    return Prior(tuple("abcde"), DRAWN, sigma, STEP, ("length",) * 5)


@dataclass
class Linear:
    """A problem whose whitened readings are linear in p, but for ``bend`` times the square of the last one."""

    slopes: Array
    offset: Array
    p: Array
    prior: Prior = field(default_factory=lambda: prior(np.full(5, np.inf)))
    bend: float = 0.0
    predictor: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(channels=[SimpleNamespace(sigma=s) for s in SIGMAS])
    )

    @property
    def n_observations(self) -> int:
        return len(self.offset)

    def residual(self, p: Array) -> Array:
        out: Array = self.slopes @ p + self.offset
        out[-1] += self.bend * p[-1] ** 2
        return out

    def blocks(self, t: Array) -> Iterator[Array]:
        p = self.p + STEP * t
        slopes = self.slopes.copy()
        slopes[-1, -1] += 2.0 * self.bend * p[-1]
        yield np.column_stack([slopes * STEP, self.residual(p)])


class Ending:
    """A problem whose readings cannot be told any more after some evaluations."""

    def __init__(self, given: Linear, evaluations: int) -> None:
        self.p, self.prior, self.predictor = given.p, given.prior, given.predictor
        self.n_observations = given.n_observations
        self._given, self._left = given, evaluations

    def blocks(self, t: Array) -> Iterator[Array]:
        self._left -= 1
        for block in self._given.blocks(t):
            yield block if self._left >= 0 else np.full_like(block, np.nan)


def problem(seed: int = 1, bend: float = 0.0, blind: bool = False) -> Linear:
    """Readings of parameters a few tolerances from the drawing, where the search starts elsewhere again."""
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal((READINGS, 5)) / TOLERANCE * np.array([3.0, 0.3, 1.0, 2.0, 0.6])
    if blind:
        slopes[:, 4] = 0.0
    p = DRAWN + 2.0 * TOLERANCE * rng.standard_normal(5)
    out = Linear(slopes, np.zeros(READINGS), DRAWN + TOLERANCE * rng.standard_normal(5), bend=bend)
    out.offset = rng.standard_normal(READINGS) - out.residual(p)
    return out


def solved(
    given: Linear, name: str, scaling: Scaling = "tolerance", tuning: float | None = None, loose: bool = False
) -> tuple[Array, Shrunk]:
    """Parameters (5,) where the estimate comes to rest, and what it knows of itself."""
    drawing = prior(np.where(LOOSE & loose, np.inf, TOLERANCE))
    solution, known = relinearised(cast(Problem, given), np.zeros(5), drawing, name, scaling, tuning)
    assert solution.status is Status.CONVERGED and known is not None
    return given.p + STEP * solution.t, known


def drawn_to(given: Linear, pull: Array) -> Array:
    """Least squares beside ``pull`` (5, 5) times the departure from the drawing, by normal equations."""
    slopes = given.slopes
    right = slopes.T @ (given.offset + slopes @ DRAWN)
    return DRAWN - np.linalg.solve(slopes.T @ slopes + pull, right)


@pytest.mark.parametrize("loose", [False, True])
def test_ridge_of_one_is_the_estimate_under_tolerances(loose: bool) -> None:
    """Wherever the search starts; a parameter without a tolerance is pulled nowhere."""
    pull = np.diag(np.where(LOOSE & loose, 0.0, TOLERANCE**-2.0))
    for k in (1.0, 7.0):
        found, known = solved(problem(), "ridge", tuning=k, loose=loose)
        np.testing.assert_allclose(found, drawn_to(problem(), k * pull), rtol=1e-9)
        assert known.tuning == k


@pytest.mark.parametrize("scaling", ["raw", "unit"])
def test_the_unit_of_the_columns_is_what_ridge_compares_with_one(scaling: Scaling) -> None:
    """Raw: mm and rad, readings in the unit of the first channel; unit: columns of length one."""
    given, k = problem(), 0.3
    column = np.linalg.norm(given.slopes, axis=0) if scaling == "unit" else np.full(5, 1.0 / SIGMAS[0])
    found, _ = solved(given, "ridge", scaling, k)
    np.testing.assert_allclose(found, drawn_to(given, k * np.diag(column**2)), rtol=1e-9)


@pytest.mark.parametrize("loose", [False, True])
@pytest.mark.parametrize(("name", "tuning"), [("ols", None), ("liu", 0.4), ("ridge", 2.0), ("pcr", 2.0)])
def test_the_root_is_that_of_what_noise_does(name: str, tuning: float | None, loose: bool) -> None:
    """Covariance: squares of how each reading, of unit noise, moves the estimate; unseen there is nothing."""
    given = problem()
    here, known = solved(given, name, tuning=tuning, loose=loose)
    moved = []
    for row in range(READINGS):
        other = problem()
        other.offset = given.offset + np.eye(READINGS)[row]
        moved.append(solved(other, name, tuning=tuning, loose=loose)[0] - here)
    by_reading = np.array(moved).T
    root = known.root * STEP[:, None]
    np.testing.assert_allclose(root @ root.T, by_reading @ by_reading.T, rtol=1e-6, atol=1e-9)
    assert known.unknown.shape == (0, 5)
    # readings used up: how much each prediction follows its own reading
    assert known.effective == pytest.approx(-float(np.trace(given.slopes @ by_reading)), rel=1e-6)


@pytest.mark.parametrize("loose", [False, True])
@pytest.mark.parametrize("scaling", ["tolerance", "unit", "raw"])
def test_least_squares_know_themselves_alike_in_every_unit(scaling: Scaling, loose: bool) -> None:
    """Their covariance is the inverse of the readings' information, whatever columns and readings are counted in."""
    given = problem()
    _, known = solved(given, "ols", scaling, loose=loose)
    slopes = given.slopes * STEP
    np.testing.assert_allclose(known.root @ known.root.T, np.linalg.inv(slopes.T @ slopes), rtol=1e-8)
    assert known.effective == pytest.approx(5.0)


def test_what_no_reading_sees_stays_at_the_drawing_and_is_called_unknown() -> None:
    for name in ("ols", "ridge"):
        found, known = solved(problem(blind=True), name)
        assert found[4] == pytest.approx(DRAWN[4], abs=1e-9)
        np.testing.assert_allclose(np.abs(known.unknown), [[0.0, 0.0, 0.0, 0.0, 1.0]], atol=1e-12)


def test_what_tolerances_and_readings_leave_open_stays_where_the_search_starts() -> None:
    given = problem(blind=True)
    solution, known = relinearised(
        cast(Problem, given), np.zeros(5), prior(np.append(TOLERANCE[:4], np.inf)), "ridge", "tolerance", 1.0
    )
    assert known is not None and solution.t[4] == 0.0
    np.testing.assert_allclose(np.abs(known.unknown), [[0.0, 0.0, 0.0, 0.0, 1.0]], atol=1e-12)


def test_the_rule_of_ridge_counts_the_readings_that_loose_parameters_leave() -> None:
    """Hoerl, Kennard and Baldwin: rank * noise / |least squares|^2, of the problem with the loose column projected out."""
    given = problem()
    along = given.slopes[:, 3] / np.linalg.norm(given.slopes[:, 3])
    across = np.eye(READINGS) - np.outer(along, along)
    h = (across @ given.slopes * TOLERANCE)[:, ~LOOSE]
    y = -across @ (given.offset + given.slopes @ DRAWN)
    b = np.linalg.lstsq(h, y, rcond=None)[0]
    noise = float(np.sum((y - h @ b) ** 2)) / (READINGS - 5)
    _, known = solved(given, "ridge", loose=True)
    assert known.tuning == pytest.approx(4.0 * noise / float(b @ b), rel=1e-6)


def test_the_end_is_told_as_it_was() -> None:
    """Half the sum of squares at rest; readings that end at the start are a failure, and on the way a halt."""
    given, drawing = problem(), prior(TOLERANCE)
    solution, _ = relinearised(cast(Problem, given), np.zeros(5), drawing, "ols")
    assert solution.cost == pytest.approx(
        0.5 * float(np.sum(given.residual(given.p + STEP * solution.t) ** 2))
    )
    assert solution.iterations == 2 and np.max(np.abs(solution.movement)) < 1e-9
    for last, status in ((0, Status.FAILED), (1, Status.STALLED)):
        found, known = relinearised(cast(Problem, Ending(problem(), last)), np.zeros(5), drawing, "ols")
        assert found.status is status and (known is None) is (last == 0)


def test_what_nothing_determines_has_a_variance_of_1e30_steps() -> None:
    """Along a direction that neither readings nor tolerances know; beside it the covariance is that of the readings."""
    slopes = problem().slopes * STEP
    slopes[:, 3] = 2.0 * slopes[:, 2]
    factor = np.zeros((6, 6))
    factor[:5, :5] = np.asarray(np.linalg.qr(slopes, mode="r"))
    flat, nothing = prior(np.full(5, np.inf)), np.zeros(5)
    solution, _ = relinearised(cast(Problem, problem()), nothing, prior(TOLERANCE), "ols")
    fit = Estimate(
        cast(Machine, None),
        cast(Recording, None),
        (),
        flat,
        DRAWN,
        nothing,
        nothing,
        nothing > 0.0,
        nothing,
        factor,
        solution,
        (),
    )
    blind, sighted = np.array([0.0, 0.0, 2.0, -1.0, 0.0]) / np.sqrt(5.0), np.eye(5)[0]
    covariance = fit.covariance / np.outer(STEP, STEP)
    assert blind @ covariance @ blind == pytest.approx(1e30, rel=1e-6)
    rest = slopes[:, [0, 1, 2, 4]]
    assert sighted @ covariance @ sighted == pytest.approx(np.linalg.inv(rest.T @ rest)[0, 0], rel=1e-6)


@pytest.mark.parametrize("bend", [1.0, 30.0])
def test_least_squares_rest_where_readings_pull_nowhere(bend: float) -> None:
    """Where one parameter is far from linear and all the others are found at the first step."""
    given = problem(bend=bend)
    found, _ = solved(given, "ols")
    slopes = given.slopes.copy()
    slopes[-1, -1] += 2.0 * bend * found[-1]
    scale = np.linalg.norm(slopes, axis=0) * np.linalg.norm(given.residual(found))
    assert np.max(np.abs(slopes.T @ given.residual(found)) / scale) < 1e-7


@pytest.mark.parametrize("name", ["ols", "liu", "ridge"])
def test_at_rest_no_parameter_moves_by_a_ten_millionth_of_its_sigma(name: str) -> None:
    """The step that is left where the search says that it rests, over many problems: few leave nearly that much."""
    left = []
    for seed in range(1, 13):
        for bend in np.geomspace(0.02, 5.0, 9):
            given = problem(seed, bend)
            solution, known = relinearised(cast(Problem, given), np.zeros(5), prior(TOLERANCE), name)
            assert solution.status is Status.CONVERGED and known is not None
            left.append(np.max(np.abs(solution.movement) / np.linalg.norm(known.root, axis=1)))
    assert max(left) < 1e-7 * (1.0 + 1e-4)  # steps of 1e-12 are rounding
    assert max(left) > 0.5e-7


def test_columns_are_made_one_long_and_nothing_of_nothing() -> None:
    h = np.array([[3.0, 0.0, 1e-5], [4.0, 0.0, 0.0]])
    np.testing.assert_allclose(column_scale(h), [0.2, 1.0, 1e5])


@pytest.mark.parametrize("mu", [0.0, 0.5, 20.0])
def test_a_wide_problem_takes_the_steps_of_a_narrow_one(mu: float) -> None:
    """Damping by the length of each column (Marquardt), whichever way it is solved."""
    rng, n = np.random.default_rng(4), WIDE_PROBLEM + 5
    factor = np.triu(rng.standard_normal((n + 1, n + 1))) + 20.0 * np.eye(n + 1)
    factor[:, :n] *= np.geomspace(1e-3, 1e3, n)
    j, r = factor[:, :n], factor[:, n]
    damped = j.T @ j + mu * np.diag(np.sum(j**2, axis=0))
    length = np.linalg.norm(j, axis=0)
    expected = -np.linalg.solve(damped / np.outer(length, length), (j.T @ r) / length)
    np.testing.assert_allclose(
        leastsquares.Linear(factor, n).step(mu) * length, expected, rtol=1e-8, atol=1e-10
    )
