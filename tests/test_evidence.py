"""The closed forms of the evidence against dense Gaussian densities written out in full."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm
from truepose.identification.diagnosis.effect_evidence import AMPLITUDES, HOPELESS, log_positive, weigh

from truepose.identification.diagnosis.signatures import Linearisation
from truepose.identification.selection.scales import Grid
from truepose.identification.selection.tolerance_classes import PartClass

Array = NDArray[np.float64]
SIZES = (1, 2, 1, 3)  # coefficients of each candidate
LENGTH, ANGLE = PartClass("length"), PartClass("angle")
PARTS = (LENGTH, LENGTH, ANGLE, PartClass("frame"), ANGLE)
READINGS = 24
ONE = Grid((1.3,), ((2.0, 1.0),), (LENGTH, ANGLE))
SEVERAL = Grid((0.8, 1.0, 1.5), ((1.0, 1.0), (4.0, 1.0), (2.0, 10.0)), (LENGTH, ANGLE))
NARROW_AND_WIDE = ((2.0, 1.0), (4.0, 4.0))
GRIDS = pytest.mark.parametrize("grid", [ONE, SEVERAL], ids=["one point", "several points"])


@dataclass(frozen=True)
class Dense:
    """A small linear problem in full: e at the drawing values, J (n, 5), G (n, 7), tolerances (5,)."""

    e: Array
    j: Array
    g: Array
    tolerance: Array
    columns: tuple[slice, ...]

    def covariance(
        self, noise: float, inflation: Mapping[PartClass, float], spreads: Mapping[int, float]
    ) -> Array:
        """Of e when candidates have amplitudes of these sizes."""
        widened = self.tolerance * [inflation.get(part, 1.0) for part in PARTS]
        out = noise**2 * np.eye(READINGS) + (self.j * widened**2) @ self.j.T
        for candidate, spread in spreads.items():
            own = self.g[:, self.columns[candidate]]
            out = out + spread**2 * own @ own.T
        return np.asarray(out, dtype=float)

    def log_density(
        self, noise: float, inflation: Mapping[PartClass, float], spreads: Mapping[int, float]
    ) -> float:
        """log N(e; 0, covariance) less its constant."""
        full = multivariate_normal.logpdf(self.e, cov=self.covariance(noise, inflation, spreads))
        return float(full + 0.5 * READINGS * np.log(2 * np.pi))

    def linearisation(self, departure: Array) -> Linearisation:
        """What the diagnosis is given: everything at a fit that has departed from the drawing."""
        jg = np.column_stack([self.j, self.g])
        rows = np.column_stack([jg, self.e + jg @ departure])
        return Linearisation(
            gram=rows.T @ rows,
            free=len(PARTS),
            columns=self.columns,
            n_observations=READINGS,
            departure=departure,
            weight=1.0 / self.tolerance,
            parts=PARTS,
            candidates=(),
        )


@pytest.fixture(params=[1, 2, 3])
def dense(request: pytest.FixtureRequest) -> Dense:
    rng = np.random.default_rng(request.param)
    ends = np.cumsum([0, *SIZES])
    columns = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
    j, g = rng.standard_normal((READINGS, len(PARTS))), 5 * rng.standard_normal((READINGS, sum(SIZES)))
    e = rng.standard_normal(READINGS) + j @ rng.standard_normal(len(PARTS)) + 0.4 * g[:, 0]
    return Dense(e, j, g, rng.uniform(0.3, 3.0, len(PARTS)), columns)


@pytest.fixture(params=[0.0, 1.0], ids=["at the drawing", "at a fit"])
def lin(request: pytest.FixtureRequest, dense: Dense) -> Linearisation:
    rng = np.random.default_rng(9)
    return dense.linearisation(request.param * rng.standard_normal(len(PARTS) + sum(SIZES)))


def brute(dense: Dense, grid: Grid, spreads: Mapping[int, float]) -> Array:
    """log density and prior of each grid point."""
    return np.array(
        [
            dense.log_density(noise, dict(zip(grid.classes, inflation, strict=True)), spreads)
            + grid.log_prior(noise, inflation)
            for noise in grid.noise
            for inflation in grid.inflation
        ]
    )


def integrated(dense: Dense, grid: Grid, candidate: int, accepted: Mapping[int, float]) -> float:
    """log evidence of a candidate of any amplitude of the grid."""
    each = [brute(dense, grid, {**accepted, candidate: float(q)}) for q in AMPLITUDES]
    return float(logsumexp(np.array(each) + rarity()[:, None]))


def rarity() -> Array:
    """Log prior of the grid's amplitudes: equal up to 1, beyond it as the inverse square."""
    density = np.array([1.0 if q <= 1.0 else 1.0 / q**2 for q in AMPLITUDES])
    return np.asarray(np.log(density / density.sum()))


ACCEPTED: Sequence[Mapping[int, float]] = ({}, {0: 0.3}, {1: 0.05, 3: 1.0})


@GRIDS
@pytest.mark.parametrize("accepted", ACCEPTED, ids=["none", "one", "two"])
def test_evidence_of_nothing_more(
    dense: Dense, lin: Linearisation, grid: Grid, accepted: Mapping[int, float]
) -> None:
    found = weigh(lin, [], grid, accepted)
    assert found.null == pytest.approx(float(logsumexp(brute(dense, grid, accepted))), abs=1e-6)
    assert found.gain.shape == (0,)


@GRIDS
@pytest.mark.parametrize("accepted", ACCEPTED, ids=["none", "one", "two"])
def test_gain_is_the_log_bayes_factor_of_the_densities(
    dense: Dense, lin: Linearisation, grid: Grid, accepted: Mapping[int, float]
) -> None:
    wanted = [k for k in range(len(SIZES)) if k not in accepted]
    found = weigh(lin, wanted, grid, accepted)
    null = float(logsumexp(brute(dense, grid, accepted)))
    expected = [integrated(dense, grid, candidate, accepted) - null for candidate in wanted]
    np.testing.assert_allclose(found.gain, expected, atol=1e-6)


def test_narrow_tolerances_that_nothing_else_needs_wide_count_with_the_candidate(dense: Dense) -> None:
    """Geometry can stand in for the first candidate, if far out of tolerance: without it, the stated ones are hopeless."""
    rng = np.random.default_rng(4)
    g = dense.g.copy()
    g[:, 0] = 10.0 * (dense.j * dense.tolerance) @ rng.standard_normal(len(PARTS)) + g[:, 0]
    noise_alone = rng.standard_normal(READINGS) + dense.j @ (
        dense.tolerance * rng.standard_normal(len(PARTS))
    )
    mimicked = replace(dense, e=noise_alone + g[:, 0], g=g)
    stated, wide = (brute(mimicked, Grid((1.0,), (point,), SEVERAL.classes), {}) for point in NARROW_AND_WIDE)
    assert wide[0] > stated[0] + 2 * HOPELESS
    grid = Grid((1.0,), NARROW_AND_WIDE, SEVERAL.classes)
    found = weigh(mimicked.linearisation(np.zeros(len(PARTS) + sum(SIZES))), [0], grid, {})
    expected = integrated(mimicked, grid, 0, {}) - float(logsumexp(brute(mimicked, grid, {})))
    assert found.gain[0] == pytest.approx(expected, abs=1e-6)


def test_log_bayes_factors_add_along_any_path(lin: Linearisation) -> None:
    """Candidates taken in one after the other, in whatever order, are worth what they are worth together."""
    spreads = {0: 0.3, 1: 0.05, 3: 1.0}

    def null(*chosen: int) -> float:
        return weigh(lin, [], SEVERAL, {k: spreads[k] for k in chosen}).null

    together = null(0, 1, 3) - null()
    assert null(3, 0, 1) - null() == pytest.approx(together, abs=1e-7)
    assert (null(1) - null()) + (null(1, 3) - null(1)) + (null(1, 3, 0) - null(1, 3)) == pytest.approx(
        together
    )


def test_the_order_of_what_is_wanted_does_not_matter(lin: Linearisation) -> None:
    forth, back = weigh(lin, [0, 1, 2, 3], SEVERAL, {}), weigh(lin, [3, 2, 1, 0], SEVERAL, {})
    np.testing.assert_allclose(forth.gain, back.gain[::-1], rtol=1e-12)
    for k in range(len(SIZES)):
        np.testing.assert_allclose(forth.amplitude[k], back.amplitude[-1 - k])


@pytest.mark.parametrize("accepted", ACCEPTED, ids=["none", "one", "two"])
def test_amplitudes_are_those_of_the_gaussian_posterior(
    dense: Dense, lin: Linearisation, accepted: Mapping[int, float]
) -> None:
    """At the best amplitude's prior size: c ~ N(0, q^2), e ~ N(G c, C)."""
    wanted = [k for k in range(len(SIZES)) if k not in accepted]
    found = weigh(lin, wanted, ONE, accepted)
    (noise,), (inflation,) = ONE.noise, ONE.inflation
    c = dense.covariance(noise, dict(zip(ONE.classes, inflation, strict=True)), accepted)
    for place, candidate in enumerate(wanted):
        each = [brute(dense, ONE, {**accepted, candidate: float(q)})[0] for q in AMPLITUDES]
        size = AMPLITUDES[int(np.argmax(each + rarity()))]
        g = dense.g[:, dense.columns[candidate]]
        precision = g.T @ np.linalg.solve(c, g) + np.eye(g.shape[1]) / size**2
        # e is prediction less reading: a shift of the prediction by g c must cancel it
        mean = -np.linalg.solve(precision, g.T @ np.linalg.solve(c, dense.e))
        assert found.spread[place] == pytest.approx(size)
        np.testing.assert_allclose(found.amplitude[place], mean, atol=1e-7)
        np.testing.assert_allclose(found.std[place], np.sqrt(np.diag(np.linalg.inv(precision))), rtol=1e-6)
        assert found.best_noise[place] == noise


def test_amplitudes_are_told_at_the_likeliest_noise_and_tolerances(dense: Dense, lin: Linearisation) -> None:
    """Readings and what is expected of noise and tolerances both count; sizes are those of that point alone."""
    wanted = list(range(len(SIZES)))
    found = weigh(lin, wanted, SEVERAL, {})
    points = [(noise, inflation) for noise in SEVERAL.noise for inflation in SEVERAL.inflation]
    for place in wanted:
        each = np.array([brute(dense, SEVERAL, {place: float(q)}) for q in AMPLITUDES])
        noise, inflation = points[int(np.argmax(logsumexp(each + rarity()[:, None], axis=0)))]
        alone = weigh(lin, wanted, Grid((noise,), (inflation,), SEVERAL.classes), {})
        assert found.best_noise[place] == noise
        assert found.spread[place] == alone.spread[place]
        np.testing.assert_allclose(found.amplitude[place], alone.amplitude[place], rtol=1e-9)
        np.testing.assert_allclose(found.std[place], alone.std[place], rtol=1e-9)


def test_noise_and_inflation_are_those_of_the_posterior(dense: Dense, lin: Linearisation) -> None:
    found = weigh(lin, [0], SEVERAL, {})
    logs = brute(dense, SEVERAL, {})
    weight = np.exp(logs - logsumexp(logs))
    noise = np.repeat(SEVERAL.noise, len(SEVERAL.inflation))
    assert found.noise == pytest.approx(float(np.exp(weight @ np.log(noise))), rel=1e-6)
    inflation = np.tile(SEVERAL.inflation, (len(SEVERAL.noise), 1))
    np.testing.assert_allclose(found.inflation, np.exp(weight @ np.log(inflation)), rtol=1e-6)


def test_what_is_there_is_found_and_what_is_not_is_not(dense: Dense) -> None:
    """With much data the sign and the size of an amplitude are right, and idle candidates cost evidence."""
    strong = Dense(
        dense.e + 3.0 * dense.g[:, dense.columns[2]].sum(axis=1),
        dense.j,
        dense.g,
        dense.tolerance,
        dense.columns,
    )
    found = weigh(strong.linearisation(np.zeros(len(PARTS) + sum(SIZES))), [2], ONE, {})
    assert found.gain[0] > 10.0
    assert -5.0 < found.amplitude[0][0] < -0.5
    quiet = Dense(0.0 * dense.e, dense.j, dense.g, dense.tolerance, dense.columns)
    nothing = weigh(quiet.linearisation(np.zeros(len(PARTS) + sum(SIZES))), [0, 1, 2, 3], ONE, {})
    assert np.all(nothing.gain < 0.0)


def test_a_parameter_without_a_tolerance_is_one_of_a_very_wide_one(dense: Dense) -> None:
    """An improper prior leaves Bayes factors what they are in the limit."""
    wide = Dense(dense.e, dense.j, dense.g, np.array([1e5, *dense.tolerance[1:]]), dense.columns)
    none = Dense(dense.e, dense.j, dense.g, np.array([np.inf, *dense.tolerance[1:]]), dense.columns)
    zero = np.zeros(len(PARTS) + sum(SIZES))
    gains = [weigh(problem.linearisation(zero), [0, 1, 2, 3], ONE, {}).gain for problem in (wide, none)]
    np.testing.assert_allclose(gains[0], gains[1], atol=1e-5)


@pytest.mark.parametrize(("mean", "std"), [(0.0, 1.0), (2.0, 0.5), (-1.0, 0.7), (-30.0, 1.0)])
def test_a_one_sided_amplitude_is_worth_twice_its_chance(mean: float, std: float) -> None:
    assert log_positive(mean, std) == pytest.approx(np.log(2.0) + norm.logsf(0.0, mean, std))
