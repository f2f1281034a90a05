"""Laws of how a model is judged: noise, tolerances, fits of last resort, what names leave and what stands without one."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.optimize import brentq
from truepose.identification.diagnosis.classes import WIDENINGS, _settings_doubt, flip_inflation
from truepose.identification.diagnosis.effect_evidence import Evidence
from truepose.identification.diagnosis.effect_selection import Ranking, Selection
from truepose.identification.diagnosis.unnamed import Unnamed

from support.effect_machines import READINGS, read_machines
from support.effects import DRIVERS, shift_slopes, with_effect
from support.sensor_bench import Bench
from truepose.errors import ConvergenceError
from truepose.identification.diagnosis import alarms, classes, engine, naming
from truepose.identification.diagnosis import effect_selection as selection
from truepose.identification.diagnosis.candidates import Catalogue, _untestable
from truepose.identification.diagnosis.conflict import conflict_with_tolerances
from truepose.identification.diagnosis.holdout import ratio_interval
from truepose.identification.diagnosis.judgement import judged
from truepose.identification.diagnosis.remainder import of_pile
from truepose.identification.diagnosis.result import Finding
from truepose.identification.diagnosis.signatures import Linearisation, Signatures
from truepose.identification.fit.estimate import FREE_WIDENING, Estimate, estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.selection.scales import Grid
from truepose.identification.selection.tolerance_classes import PartClass
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine import Machine

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


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    folder: Path = tmp_path_factory.getbasetemp() / "judgement_laws"
    return read_machines(folder)["arm"]


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
    found = judged(leaving(fit, noise**2), fit, lin, {}, recording)
    expected = conflict_with_tolerances(lin, max(noise, 1.0))
    conflict = found.alarms["prior_conflict"]
    assert (conflict.statistic, conflict.p) == pytest.approx((expected.statistic, expected.p))
    assert found.stubborn == pytest.approx(expected.p)
    # the noise tells: at another one the statistic is another
    other = conflict_with_tolerances(lin, 1.1 * max(noise, 1.0))
    assert abs(other.statistic / expected.statistic - 1.0) > 1e-3


def test_a_conflict_that_wider_tolerances_explain_is_not_stubborn(case: Case) -> None:
    """Tolerances that look narrower than stated do not count."""
    fit, recording, lin = case
    far = replace(lin, departure=30.0 * np.ones(len(lin.departure)))
    stated, narrow, wide = (
        judged(fit, fit, far, dict.fromkeys(lin.parts, width), recording) for width in (1.0, 0.3, 100.0)
    )
    assert stated.alarms["prior_conflict"].p == wide.alarms["prior_conflict"].p < 1e-3
    assert stated.stubborn == narrow.stubborn < 1e-3
    assert wide.stubborn > 0.01
    assert stated.fails and stated.leaves and not wide.fails


def test_a_clear_misfit_of_the_ordinary_fit_is_something_left(case: Case) -> None:
    fit, recording, lin = case
    for chi2, left, failed in ((1.0, False, False), (2.0, True, False), (16.0, True, True)):
        found = judged(leaving(fit, chi2), leaving(fit, 1.0), lin, {}, recording)
        assert (found.leaves, found.fails) == (left, failed)


def test_a_conflict_with_tolerances_does_not_hang_on_where_the_fit_stands() -> None:
    """Effects of the fit stay in the model: only geometry is taken back to the drawing."""
    rng, readings, free, extra = np.random.default_rng(2), 50, 6, 2
    j, g = rng.standard_normal((readings, free)), rng.standard_normal((readings, extra))
    e = rng.standard_normal(readings) + 2.0 * j @ rng.standard_normal(free)

    def at(departure: Array) -> tuple[float, float]:
        rows = np.column_stack([j, g, e + j @ departure[:free]])
        lin = Linearisation(
            rows.T @ rows,
            free,
            (slice(0, 1), slice(1, 2)),
            readings,
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
    left = alarms._projector(fit, recording)(noise)
    assert np.sum(left**2) < np.sum(noise**2)
    taken = np.sum(noise * (noise - left))  # that of about as many directions as the fit has free parameters
    assert taken == pytest.approx(fit.effective_parameters, abs=4.0 * np.sqrt(2.0 * len(fit.prior.free)))
    steps = fit.prior.scale * np.random.default_rng(5).uniform(0.05, 20.0, len(fit.prior.scale))
    stepped = replace(fit, prior=replace(fit.prior, scale=steps))  # in whatever steps parameters are counted
    np.testing.assert_allclose(alarms._projector(stepped, recording)(noise), left, atol=1e-6)
    monkeypatch.setattr(alarms, "LARGEST_PROJECTION", size - 1)
    np.testing.assert_array_equal(alarms._projector(fit, recording)(noise), noise)


@pytest.mark.parametrize(("readings", "count"), [(100, 300), (49_999, 300), (50_000, 60), (400_000, 60)])
def test_what_the_alarms_draw_stays_small(readings: int, count: int) -> None:
    """A fifth of the draws from 50,000 residuals on, 15 million numbers until then; a projector within 256 MiB."""
    assert alarms._draws(np.zeros((readings, 1))) == alarms._draws(np.zeros((1, readings))) == count
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

    monkeypatch.setattr(engine, "estimate", fails)
    start, far = np.zeros(3), np.zeros(len(recording), dtype=bool)
    found: object = engine._free(before.machine, recording, before, far, start)
    widths = [FREE_WIDENING * share for share in (1.0, 1.0 / 3.0, 0.1)]
    count = next((k for k, w in enumerate(widths, start=1) if w <= most), 3)
    assert tried == pytest.approx(widths[:count])
    assert found == "converged" if widths[-1] <= most else found is before
    assert starts[0] is start and all(s is before.p for s in starts[1:])


# -- names ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("chi2", "unexplained"), [(50.0, 0.0), (100.0, 0.0), (90.0, 0.0), (400.0, 37.5)])
def test_what_no_model_explains_is_the_excess_of_the_misfit_at_its_own_noise(
    case: Case, monkeypatch: pytest.MonkeyPatch, chi2: float, unexplained: float
) -> None:
    """Half of chi-square beyond its degrees of freedom, in units of the scatter; every term but the stated has a class."""
    fit = SimpleNamespace(chi2=chi2, chi2_per_dof=chi2 / 100.0, n_observations=110, effective_parameters=10.0)
    heard: list[tuple[int, float]] = []

    def name_term(*given: object) -> int:
        term, left = cast(tuple[int, float], given[-2:])
        heard.append((term, left))
        return term

    monkeypatch.setattr(classes, "name_term", name_term)
    found = SimpleNamespace(
        fit=fit,
        catalogue=SimpleNamespace(stated=(4,)),
        linearisation=None,
        grid=None,
        accepted={3: 1.0, 4: 1.0, 7: 1.0},
    )
    assert cast(list[int], naming._classes(cast(Selection, found))) == [3, 7]
    assert [term for term, _ in heard] == [3, 7]
    assert [left for _, left in heard] == pytest.approx([unexplained] * 2)


def test_one_name_that_is_withheld_is_told_with_its_place() -> None:
    """A single name that explains little is withheld as well."""
    name = cast(Finding, SimpleNamespace(effect="backlash", place=("q2", "q3")))
    structure = cast(alarms.Structure, SimpleNamespace(driver="q1"))
    told = of_pile([name], cast(Estimate, SimpleNamespace(chi2_per_dof=9.0)), structure)
    assert (told.place, told.driver, told.size_sigma) == (("q2", "q3"), "q1", 3.0)
    assert told.form.kind == "pile" and told.form.causes == (("backlash", ("q2", "q3")),)


def test_how_much_wider_tolerances_must_be_is_told_within_a_factor_of_two(arm: Machine) -> None:
    """Against the width at which the odds of the term cross the threshold, wherever that is."""
    cat = Catalogue((with_effect(arm, "zero-shift", ("q2",), {"session": 1.0}),), (-2.0,), ())
    noise = (1.0,)
    crossed = []
    for size in np.geomspace(5.0, 3000.0, 48):
        axes = np.linalg.qr(np.random.default_rng(4).standard_normal((60, 2)))[0]
        along = np.cos(0.2) * axes[:, 0] + np.sin(0.2) * axes[:, 1]
        rows = np.column_stack([2.0 * axes[:, 0], 50.0 * along, -size * axes[:, 0]])
        lin = Linearisation(
            rows.T @ rows, 1, (slice(0, 1),), 60, np.zeros(2), np.ones(1), (LENGTH,), cat.candidates
        )

        def beyond(log_width: float, lin: Linearisation = lin) -> float:
            grid = Grid(noise, ((float(np.exp(log_width)),),), (LENGTH,))
            return float(selection.rank(lin, cat, grid, {}, [0]).odds[0]) - selection.THRESHOLD

        told = flip_inflation(lin, cat, Grid(noise, ((1.0,),), (LENGTH,)), {}, 0, selection.THRESHOLD)
        if beyond(np.log(100.0)) >= 0.0:
            assert told is None
            continue
        assert told is not None
        if beyond(0.0) > 0.0:
            width = float(np.exp(brentq(beyond, 0.0, np.log(100.0))))
            assert width <= told * (1 + 1e-9) and told <= max(2.0 * width, WIDENINGS[0])
            crossed.append(width)
    assert min(crossed) < 2.0 and max(crossed) > 20.0
    assert max(np.diff(np.log(crossed))) < 0.25  # none between two widenings is left out


def test_settings_that_data_do_not_choose_are_a_doubt_in_the_unit_of_the_coefficient(arm: Machine) -> None:
    """Lags of one place: rms distance from the coefficient told, by their odds, whatever its scale."""
    warm = [
        with_effect(arm, "thermal-expansion", (place,), {"lag": lag})
        for place, lag in (("link1", 0.0), ("link1", 900.0), ("link1", 2700.0), ("link2", 900.0))
    ]
    cat, odds = Catalogue(tuple(warm), (-2.0,) * 4, ()), np.log([2.0, 1.0, 1.0, 50.0])
    size = np.array([0.5, 0.9, -0.1, 30.0])
    one = tuple(np.ones(1) for _ in odds)
    found = Evidence(0.0, odds, tuple(size[:, None]), one, np.ones(4), 1.0, (1.0,), np.ones(4))
    ranking = Ranking((0, 1, 2, 3), odds, odds, found)
    (coefficient,) = warm[0].coefficients
    assert coefficient.scale != 1.0
    value = size * coefficient.scale
    for own in range(3):
        expected = np.sqrt(np.average((value[:3] - value[own]) ** 2, weights=[2.0, 1.0, 1.0]))
        assert _settings_doubt(cat, ranking, own) == pytest.approx((expected,))
    assert _settings_doubt(cat, ranking, 3) == (0.0,)


def test_so_many_rows_need_no_interval() -> None:
    rng = np.random.default_rng(5)
    before, after = rng.chisquare(3, 20_000), 0.25 * rng.chisquare(3, 20_000)
    ratio, interval = ratio_interval(before, after)
    assert interval == (ratio, ratio) and ratio == pytest.approx(0.5, abs=0.02)
    _, (low, high) = ratio_interval(before[:5000], after[:5000])
    assert low < high


@pytest.mark.parametrize("name", ["velocity.q2", "temperature.air", "payload"])
def test_what_never_differs_from_zero_moves_nothing_unless_it_is_a_payload(case: Case, name: str) -> None:
    """No payload is a load like others: the masses say what else hangs there. What is constant has its effect."""
    _, recording, _ = case
    placed = cast(PlacedEffect, SimpleNamespace(drivers=(name,)))
    n = len(recording)
    constant: list[tuple[float, bool]] = [(0.0, name == "payload"), (2.0, True)]
    for value, told in constant:
        why = _untestable(placed, replace(recording, drivers={name: np.full(n, value)}))
        assert why is None if told else why == f"{name} never differs from zero"
    assert _untestable(placed, replace(recording, drivers={})) == f"no {name} column"
    held_out = np.arange(n) >= n // 2  # what moves there alone moves nothing that is fitted
    split = replace(recording, validation=held_out, drivers={name: np.where(held_out, 3.0, 0.0)})
    assert (_untestable(placed, split) is None) == (name == "payload")


# -- without a name ------------------------------------------------------------------------------------------


def unnamed_of(arm: Machine) -> tuple[Unnamed, dict[str, float]]:
    """Curves over a recording, colder than the tests' pose, and where that stands in each source's -1 ... 1.

    Validation rows are far out.
    """
    rng, n = np.random.default_rng(6), 50
    validation = np.arange(n) >= 40
    q = rng.uniform([0.1, -1.2, 0.5], [1.1, 0.3, 1.5], (n, 3))
    drivers = {"time": 4000.0 + 3000.0 * rng.random(n), "temperature.air": rng.uniform(20.0, 25.0, n)}
    given = dict(zip(("q1", "q2", "q3"), READINGS["arm"], strict=True))
    given |= {"time": DRIVERS["time"], "temperature.air": DRIVERS["temperature"]}
    where = {}
    for name, values in {**dict(zip(given, q.T, strict=False)), **drivers}.items():
        low, high = values[~validation].min(), values[~validation].max()
        where[name] = (given[name] - low) / (high - low) * 2.0 - 1.0
    q[validation] += 50.0
    drivers = {name: values + 1e4 * validation for name, values in drivers.items()}
    whole = np.zeros(n, dtype=np.int64)
    recording = Recording(
        joints=("q1", "q2", "q3"),
        q=q,
        observations={name: rng.standard_normal(n) for name in ("x", "y", "z")},
        labels={},
        drivers=drivers,
        files=("a.csv",),
        source_file=whole,
        source_row=np.arange(1, n + 1),
        session=whole + 1,
        session_recorded=whole == 0,
        validation=validation,
        time=drivers["time"],
    )
    return Unnamed(arm, recording), where


def slopes(arm: Machine, unnamed: Unnamed, place: str) -> dict[tuple[str, str], dict[str, Array]]:
    """By what each form at a place is a function of, and its kind: the derivative of each port's shift."""
    placed = [
        PlacedEffect.at(unnamed, arm, (place,), s) for s in unnamed.settings(arm, (place,), _NoRecording())
    ]
    return {unnamed.describe(p.settings_map): shift_slopes(arm, p) for p in placed}


class _NoRecording:
    n_sessions = 1

    def driver(self, name: str) -> None:
        return None


def test_what_has_no_name_is_a_curve_of_degree_four_over_the_fitted_range_of_its_source(arm: Machine) -> None:
    """Chebyshev polynomials from the first on, in the joint's own reading from the second on; a product of two joints.

    Beyond the range a source stands at its end.
    """
    unnamed, where = unnamed_of(arm)
    held = {name: np.clip(t, -1.0, 1.0) for name, t in where.items()}
    assert any(abs(t) > 1.0 for t in where.values()) and any(abs(t) < 1.0 for t in where.values())
    found = slopes(arm, unnamed, "q2")
    pairs = list(itertools.combinations(("q1", "q2", "q3"), 2))
    assert set(found) == {*((n, "curve") for n in where), *((f"{a} and {b}", "product") for a, b in pairs)}
    for source, t in held.items():
        powers: Sequence[int] = range(2 if source == "q2" else 1, 5)
        (slope,) = found[source, "curve"].values()
        np.testing.assert_allclose(
            slope, [chebyshev.chebval(t, np.eye(5)[power]) for power in powers], atol=1e-9
        )
    for a, b in pairs:
        (slope,) = found[f"{a} and {b}", "product"].values()
        assert slope == pytest.approx(held[a] * held[b])


def test_a_mount_without_a_name_moves_in_each_direction_by_a_line_and_a_parabola(arm: Machine) -> None:
    """Every coefficient moves one direction of its own; the source is no joint."""
    unnamed, where = unnamed_of(arm)
    found = slopes(arm, unnamed, "tool")
    assert {source for source, _ in found} == set(where) - {"q1", "q2", "q3"}
    for (source, _), by_port in found.items():
        rows = np.array(list(by_port.values()))
        t = np.clip(where[source], -1.0, 1.0)
        assert rows.shape == (6, 12)
        assert np.all(np.sum(rows != 0.0, axis=0) == 1)
        for row in rows:
            assert sorted(row[row != 0.0]) == pytest.approx(sorted([t, 2.0 * t**2 - 1.0]))
