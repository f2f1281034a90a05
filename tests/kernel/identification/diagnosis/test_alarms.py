"""Laws of how a model is judged: noise, tolerances, fits of last resort, rows and drivers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from support.sensor_bench import Bench
from truepose.errors import ConvergenceError
from truepose.identification.diagnosis import alarms, null_fits
from truepose.identification.diagnosis.alarms import alarms_of, conflict_with_tolerances, misfits
from truepose.identification.diagnosis.holdout import ratio_interval
from truepose.identification.fit.estimate import FREE_WIDENING, estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Linearisation
from truepose.identification.signatures.signatures import Signatures
from truepose.identification.signatures.untestable import why_untestable
from truepose.models.effects.base import PlacedEffect

Array = NDArray[np.float64]
Case = tuple[Estimate, Recording, Linearisation]
LENGTH = PartClass("length")


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A fit of an arm, its recording and its linearisation; the tests replace the residuals."""
    bench = Bench(tmp_path_factory.mktemp("case"), "arm")
    recording = bench.recording()
    fit = estimate(bench.machine, recording)
    return fit, recording, Signatures(bench.machine, recording, []).linearise(fit)


def leaving(fit: Estimate, chi2_per_dof: float) -> Estimate:
    """The fit with white residuals of this size."""
    residual = np.random.default_rng(1).standard_normal(fit.residual.shape)
    dof = fit.n_observations - fit.effective_parameters
    return replace(fit, residual=residual * np.sqrt(chi2_per_dof * dof / np.sum(residual**2)))


# -- alarms --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.4, 1.0, 1.5, 3.0])
def test_tolerances_are_judged_at_the_noise_of_the_ordinary_fit_and_never_below_the_stated_one(
    case: Case, noise: float
) -> None:
    fit, recording, lin = case
    found = alarms_of(leaving(fit, noise**2), fit, lin, recording)
    expected = conflict_with_tolerances(lin, max(noise, 1.0))
    conflict = found["prior_conflict"]
    assert (conflict.statistic, conflict.p) == pytest.approx((expected.statistic, expected.p))
    # the noise tells: at another one the statistic is another
    other = conflict_with_tolerances(lin, 1.1 * max(noise, 1.0))
    assert abs(other.statistic / expected.statistic - 1.0) > 1e-3


def test_a_conflict_with_tolerances_alone_is_no_misfit(case: Case) -> None:
    fit, recording, lin = case
    far = replace(lin, departure=30.0 * np.ones(len(lin.departure)))
    found = alarms_of(fit, fit, far, recording)
    assert found["prior_conflict"].p < 1e-3
    assert not misfits(found)


def test_a_misfit_of_the_ordinary_fit_counts_beyond_what_a_misstated_sigma_would_make(case: Case) -> None:
    fit, recording, lin = case
    for chi2, seen, failed in ((1.0, False, False), (2.0, True, False), (16.0, True, True)):
        found = alarms_of(leaving(fit, chi2), leaving(fit, 1.0), lin, recording)
        assert (found["residual"].p < 1e-3, misfits(found)) == (seen, failed)


def test_a_conflict_with_tolerances_does_not_hang_on_where_the_fit_stands() -> None:
    """Effects of the fit stay in the model: only geometry is taken back to the drawing."""
    rng, readings, free, extra = np.random.default_rng(2), 50, 6, 2
    j, g = rng.standard_normal((readings, free)), rng.standard_normal((readings, extra))
    e = rng.standard_normal(readings) + 2.0 * j @ rng.standard_normal(free)

    def at(departure: Array) -> tuple[float, float]:
        rows = np.column_stack([j, g, e + j @ departure[:free]])
        lin = Linearisation(
            (rows.T @ rows,),
            (readings,),
            free,
            (slice(0, 1), slice(1, 2)),
            0,
            departure,
            np.ones(free),
            (LENGTH,) * free,
            (),
        )
        found = conflict_with_tolerances(lin, 1.2)
        return found.statistic, found.p

    drawing = at(np.zeros(free + extra))
    for _ in range(3):
        assert at(rng.standard_normal(free + extra)) == pytest.approx(drawing, rel=1e-8)
    # the statistic by dense algebra: least-squares steps against tolerances and noise
    step = -np.linalg.lstsq(j, e, rcond=None)[0]
    covariance = np.eye(free) + 1.2**2 * np.linalg.inv(j.T @ j)
    assert drawing[0] == pytest.approx(float(step @ np.linalg.solve(covariance, step)))


def test_random_residuals_are_projected_on_what_a_fit_leaves_unless_that_is_too_large_to_hold(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fit under tolerances leaves less of everything that its parameters can follow."""
    fit, recording, _ = case
    noise = np.random.default_rng(3).standard_normal(fit.residual[fit.used].shape)
    size = fit.n_observations * len(fit.prior.free)
    monkeypatch.setattr(alarms, "LARGEST_PROJECTION", size)
    left = alarms.projector(fit, recording)(noise)
    assert np.sum(left**2) < np.sum(noise**2)
    taken = np.sum(noise * (noise - left))  # that of about as many directions as the fit has free parameters
    assert taken == pytest.approx(fit.effective_parameters, abs=4.0 * np.sqrt(2.0 * len(fit.prior.free)))
    steps = fit.prior.scale * np.random.default_rng(5).uniform(0.05, 20.0, len(fit.prior.scale))
    factor = fit.factor * np.append((steps / fit.prior.scale)[fit.prior.free], 1.0)
    # in whatever steps parameters are counted
    stepped = replace(fit, prior=replace(fit.prior, scale=steps), factor=factor)
    np.testing.assert_allclose(alarms.projector(stepped, recording)(noise), left, atol=1e-6)
    monkeypatch.setattr(alarms, "LARGEST_PROJECTION", size - 1)
    np.testing.assert_array_equal(alarms.projector(fit, recording)(noise), noise)


@pytest.mark.parametrize(("readings", "count"), [(100, 300), (49_999, 300), (50_000, 60), (400_000, 60)])
def test_what_the_alarms_draw_stays_small(readings: int, count: int) -> None:
    """A fifth of the draws from 50,000 residuals on, 15 million numbers until then; a projector within 256 MiB."""
    assert alarms.draws_for(np.zeros((readings, 1))) == alarms.draws_for(np.zeros((1, readings))) == count
    assert 8 * alarms.LARGEST_PROJECTION < 2**28


# -- fits ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("most", [1000.0, 60.0, 20.0, 1.0])
def test_an_ordinary_fit_without_a_bottom_is_sought_with_ever_narrower_tolerances(
    case: Case, monkeypatch: pytest.MonkeyPatch, most: float
) -> None:
    """From a hundred times the stated ones to ten times; the fit under the stated ones stands in for the rest."""
    before, recording, _ = case
    tried: list[float] = []
    starts: list[object] = []

    def fails(*_: object, start: object, widen: float, **__: object) -> str:
        tried.append(widen)
        starts.append(start)
        if widen > most:
            raise ConvergenceError("no minimum")
        return "converged"

    monkeypatch.setattr(null_fits, "estimate", fails)
    start, far = np.zeros(3), np.zeros(len(recording), dtype=bool)
    found: object = null_fits.free_fit(before.nominal, recording, before, far, start)
    widths = [FREE_WIDENING * share for share in (1.0, 1.0 / 3.0, 0.1)]
    count = next((k for k, w in enumerate(widths, start=1) if w <= most), 3)
    assert tried == pytest.approx(widths[:count])
    assert found == "converged" if widths[-1] <= most else found is before
    assert starts[0] is start and all(s is before.p for s in starts[1:])


# -- rows and drivers ---------------------------------------------------------------------------------------


def test_of_very_many_rows_the_interval_is_the_limit_of_the_bootstrap() -> None:
    rng = np.random.default_rng(5)
    before, after = rng.chisquare(3, 20_000), 0.25 * rng.chisquare(3, 20_000)
    ratio, interval = ratio_interval(before, after)
    drawn, bootstrap = ratio_interval(before[1:], after[1:])
    assert ratio == pytest.approx(0.5, abs=0.02)
    assert drawn == pytest.approx(ratio, rel=1e-3)
    assert interval == pytest.approx(bootstrap, rel=2e-3)
    assert np.ptp(interval) == pytest.approx(np.ptp(bootstrap), rel=0.15)  # of 1000 draws


@pytest.mark.parametrize("name", ["velocity.q2", "temperature.air", "payload"])
def test_what_never_differs_from_zero_moves_nothing_unless_it_is_a_payload(case: Case, name: str) -> None:
    """No payload is a load like others: the masses say what else hangs there. What is constant has its effect."""
    _, recording, _ = case
    placed = cast(PlacedEffect, SimpleNamespace(drivers=(name,)))
    n = len(recording)
    constant: list[tuple[float, bool]] = [(0.0, name == "payload"), (2.0, True)]
    for value, told in constant:
        why = why_untestable(placed, replace(recording, drivers={name: np.full(n, value)}))
        assert why is None if told else why == f"{name} never differs from zero"
    assert why_untestable(placed, replace(recording, drivers={})) == f"no {name} column"
    held_out = np.arange(n) >= n // 2  # what moves there alone moves nothing that is fitted
    split = replace(recording, validation=held_out, drivers={name: np.where(held_out, 3.0, 0.0)})
    assert (why_untestable(placed, split) is None) == (name == "payload")
