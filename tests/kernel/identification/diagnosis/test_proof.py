"""Laws of proofs and of what is held out: linear predictions, injected effects, blocks, intervals, notes of tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from support.effects import with_effect
from support.sensor_bench import Bench
from truepose.arrays import Array
from truepose.identification.diagnosis import proof as black_box_module
from truepose.identification.diagnosis.holdout import ratio_interval
from truepose.identification.diagnosis.proof import Waves, black_box, injected_recovered, linear_test
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.selection_problem import selection_problem
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.state import State
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.linearisation import Linearisation
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

Case = tuple[Estimate, Recording]


# -- linear predictions ----------------------------------------------------------------------------------


def test_held_out_rows_are_judged_by_the_posterior_of_the_others(case: Case) -> None:
    """One linear step under tolerances from where the fit stands; what is added has a tolerance of ten."""
    fit, _ = case
    rng, n, rows, channels, extra = np.random.default_rng(1), len(case[0].prior.free), 40, 3, 2
    design = rng.standard_normal((rows, channels, n + extra))
    waves = Waves(rng.standard_normal((rows, extra)), np.array([2, 0]), rng.random((rows, channels)) < 0.1)
    design[:, :, n:] = 0.0
    assert waves.lost is not None
    for k, channel in enumerate(waves.channel):
        design[:, channel, n + k] = np.where(waves.lost[:, channel], 0.0, waves.values[:, k])
    residual = rng.standard_normal((rows, channels))
    fit = replace(fit, residual=residual)
    train = np.arange(rows) % 3 > 0
    away = (fit.p - fit.prior.mean)[fit.prior.free] / fit.prior.scale[fit.prior.free]
    tau = np.append(fit.prior.sigma[fit.prior.free] / fit.prior.scale[fit.prior.free], np.full(extra, 10.0))
    assert np.all(np.isfinite(tau))
    # readings at the drawing: a Gaussian of tolerances and unit noise, conditioned on the rows of training
    h, y = design[train].reshape(-1, n + extra), residual[train].ravel()
    y = y - h[:, :n] @ away
    departure = -np.linalg.solve(h.T @ h + np.diag(tau**-2.0), h.T @ y)
    expected = residual[~train] + design[~train] @ (departure - np.append(away, np.zeros(extra)))
    found = linear_test(design[:, :, :n], fit, train, ~train, waves)
    np.testing.assert_allclose(found, np.sum(expected**2, axis=1), rtol=1e-8)


def test_a_black_box_does_as_well_in_whatever_steps_parameters_are_counted(case: Case) -> None:
    """Free waves follow noise alone: they predict worse than none, and as badly in any scale."""
    fit, recording = case
    none, outliers = SimpleNamespace(effects=()), np.zeros(len(recording), dtype=bool)
    after = SimpleNamespace(effects=(SimpleNamespace(coefficients=range(12)),))
    assert black_box(fit, cast(Estimate, none), recording, outliers) == pytest.approx(1.0)
    ratio = black_box(fit, cast(Estimate, after), recording, outliers)
    assert ratio is not None and 1.01 < ratio < 1.5
    scale = fit.prior.scale * np.random.default_rng(7).uniform(0.05, 20.0, len(fit.prior.scale))
    scaled = replace(fit, prior=replace(fit.prior, scale=scale))
    assert black_box(scaled, cast(Estimate, after), recording, outliers) == pytest.approx(ratio, rel=1e-6)


def test_of_too_many_rows_evenly_spread_ones_are_asked(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    fit, recording = case
    outliers, after = (
        np.zeros(len(recording), dtype=bool),
        SimpleNamespace(effects=(SimpleNamespace(coefficients=range(4)),)),
    )
    whole = black_box(fit, cast(Estimate, after), recording, outliers)
    columns = len(fit.prior.free) + 4
    monkeypatch.setattr(black_box_module, "LARGEST_PROJECTION", fit.residual.size * columns - 1)
    some = black_box(fit, cast(Estimate, after), recording, outliers)
    assert some is not None
    assert some != whole
    assert 0.9 < some < 1.6


def test_a_black_box_does_as_well_wherever_encoders_have_their_zero(case: Case) -> None:
    """What the readings lose, the offsets of the joints gain: the same poses, the same errors, the same waves."""
    fit, recording = case
    after = cast(Estimate, SimpleNamespace(effects=(SimpleNamespace(coefficients=range(12)),)))
    outliers = np.zeros(len(recording), dtype=bool)
    turned = np.random.default_rng(8).uniform(-2.0, 2.0, len(recording.joints))
    offset = np.zeros(len(fit.p))
    offset[[fit.prior.names.index(f"{joint}.theta") for joint in recording.joints]] = turned
    moved = replace(fit, p=fit.p + offset, prior=replace(fit.prior, mean=fit.prior.mean + offset))
    found = black_box(moved, after, replace(recording, q=recording.q - turned), outliers)
    assert found == pytest.approx(black_box(fit, after, recording, outliers), rel=1e-6)


# -- an injected effect ----------------------------------------------------------------------------------


ROWS = 400


def injected(
    placed: Sequence[PlacedEffect], columns: Array, size: float, priors: Sequence[float], noise: float = 1.0
) -> bool:
    """Whether the first of these candidates, of this size in scales, is found again; columns (ROWS, 1 + C)."""
    stacked = np.column_stack([columns, np.zeros(ROWS)])
    slices = tuple(slice(k, k + 1) for k in range(len(placed)))
    parts, departure = (PartClass("length"),), np.zeros(len(placed) + 1)
    lin = Linearisation(
        (stacked.T @ stacked,), (ROWS,), 1, slices, departure, np.ones(1), parts, tuple(placed)
    )
    (coefficient,) = placed[0].coefficients
    fitted = placed[0].with_values([size * coefficient.scale])
    after = SimpleNamespace(fitted_effects=lambda: (fitted,))
    cat = Catalogue(tuple(placed), tuple(priors), ())
    problem = selection_problem(lin, cat, max(noise, 1.0))
    at = int(np.argmin(np.abs(np.log(np.array(problem.spike_slab.unknowns.noise[0].values) / noise))))
    found = SimpleNamespace(
        problem=problem, catalogue=cat, linearisation=lin, mode=State((), GridPoint((at,), 0), 0.0)
    )
    return injected_recovered(cast(Estimate, after), cast(Found, found), 0)


def test_an_injected_effect_is_found_again_where_nothing_else_says_the_same(arm: Machine) -> None:
    """It, at any of its settings, is as good as the best; another place of the same effect is another effect."""
    q2, q3 = (with_effect(arm, "zero-shift", (joint,), {"session": 1.0}) for joint in ("q2", "q3"))
    again = with_effect(arm, "zero-shift", ("q2",), {"session": 2.0})
    axes = np.linalg.qr(np.random.default_rng(3).standard_normal((ROWS, 4)))[0]
    apart = axes[:, :3] * [1.0, 50.0, 50.0]
    same = np.column_stack([axes[:, 0], 50.0 * axes[:, 1], 50.0 * axes[:, 1]])
    for size in (1.0, -1.0):
        assert injected((q2, q3), apart, size, (-2.0, -2.0))
    # what shows alike and is likelier from the start is named instead, unless it is the same cause
    assert not injected((q2, q3), same, 1.0, (-12.0, -2.0))
    assert injected((q2, q3), same, 1.0, (-4.0, -2.0))  # the data prefer neither
    assert injected((q2, again), same, 1.0, (-12.0, -2.0))
    # what can only give way is found as it gives way
    yields = with_effect(arm, "joint-compliance", ("q2",))
    assert yields.coefficients[0].lower == 0.0
    assert injected((yields, q3), apart, 1.0, (-2.0, -2.0))
    # what the noise after the fit hides is not found against a likelier rival
    assert injected((q2, q3), apart, 0.3, (-12.0, -2.0))
    assert not injected((q2, q3), apart, 0.3, (-12.0, -2.0), noise=30.0)
    # nor is one that nothing can show, though no rival is likelier
    for alone in ((q2, q3), (q2,)):
        assert not injected(alone, apart[:, : 1 + len(alone)], 1e-3, (-2.0, -2.0)[: len(alone)])


# -- rows held out, and intervals --------------------------------------------------------------------------


def test_the_interval_holds_the_ratio_of_a_large_sample() -> None:
    """95 in 100 times; it narrows as rows are more, and one ratio for all rows has none."""
    rng, held, widths = np.random.default_rng(5), 0, []
    for _ in range(60):
        before, after = rng.chisquare(3, 80), 0.25 * rng.chisquare(3, 80)
        _, (low, high) = ratio_interval(before, after)
        held += low <= 0.5 <= high
        widths.append(high - low)
    assert 52 <= held <= 60
    many, low_high = ratio_interval(rng.chisquare(3, 8000), 0.25 * rng.chisquare(3, 8000))
    assert many == pytest.approx(0.5, abs=0.02)
    assert (low_high[1] - low_high[0]) == pytest.approx(np.mean(widths) / 10.0, rel=0.3)
    ratio, interval = ratio_interval(before, 0.09 * before)
    assert (ratio, *interval) == pytest.approx((0.3,) * 3)


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A fit of an arm and its recording; the tests replace what is in them."""
    bench = Bench(tmp_path_factory.mktemp("case"), "arm")
    recording = bench.recording()
    return estimate(bench.machine, recording), recording


def test_a_prediction_is_exact_where_readings_are_linear_and_the_drawing_is_true(case: Case) -> None:
    """Readings of ten times the noise that a free wave explains vanish once it is among the columns."""
    rng, rows = np.random.default_rng(2), 60
    fit = replace(case[0], p=case[0].prior.mean.copy())
    n = len(fit.prior.free)
    jacobian, wave = 1e-3 * rng.standard_normal((rows, 3, n)), rng.standard_normal((rows, 3))
    fit = replace(fit, residual=10.0 * wave)
    train = rng.permutation(rows) < 40
    without = linear_test(jacobian, fit, train, ~train)
    box = linear_test(jacobian, fit, train, ~train, Waves(wave, np.arange(3), None))
    assert np.mean(box) < 1e-6 * np.mean(without)
