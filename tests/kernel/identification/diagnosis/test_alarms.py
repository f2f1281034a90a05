"""Laws of how a model is judged: noise, tolerances, fits of last resort, rows and drivers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import chi2, kstest
from scipy.stats import f as fisher

from support.recordings import rows_of
from truepose.arrays import Array
from truepose.identification.diagnosis import alarms
from truepose.identification.diagnosis.alarms import (
    alarms_of,
    conflict_with_tolerances,
    replicate_noise,
    residual_alarm,
    structure_alarm,
)
from truepose.identification.diagnosis.result import Alarm
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Linearisation
from truepose.identification.signatures.signatures import Signatures
from truepose.identification.signatures.untestable import why_untestable
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.sensor import Channel


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
    fit, recording = case
    lin = Signatures(fit.nominal, recording, []).linearise(fit)
    found = alarms_of(leaving(fit, noise**2), fit, lin, recording)
    expected = conflict_with_tolerances(lin, max(noise, 1.0))
    conflict = found["prior_conflict"]
    assert (conflict.statistic, conflict.p) == pytest.approx((expected.statistic, expected.p))
    # the noise tells: at another one the statistic is another
    other = conflict_with_tolerances(lin, 1.1 * max(noise, 1.0))
    assert abs(other.statistic / expected.statistic - 1.0) > 1e-3


def test_random_residuals_are_projected_on_what_a_fit_leaves_unless_that_is_too_large_to_hold(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fit under tolerances leaves less of everything that its parameters can follow."""
    fit, recording = case
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


# -- fits ----------------------------------------------------------------------------------------------------


# -- rows and drivers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["velocity.q2", "temperature.air", "payload"])
def test_what_never_differs_from_zero_moves_nothing_unless_it_is_a_payload(case: Case, name: str) -> None:
    """No payload is a load like others: the masses say what else hangs there. What is constant has its effect."""
    _, recording = case
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


@pytest.mark.parametrize("repeats", [(2,), (2, 3, 7), (5, 1, 1)])
def test_the_variance_of_replicates_is_unbiased(case: Case, repeats: tuple[int, ...]) -> None:
    """Whatever the model leaves out of a pose: its repeats share it, and each pose costs one mean a channel."""
    rng = np.random.default_rng(1)
    pose = np.repeat(np.arange(4 * len(repeats), dtype=np.int64), 4 * repeats)
    recording = rows_of(pose[:, None].astype(float), pose=pose)
    squares, dof = [], 0
    for _ in range(400):
        left_out = rng.normal(0.0, 50.0, (int(pose.max()) + 1, 2))[pose]
        residual = left_out + 3.0 * rng.standard_normal(left_out.shape)
        fit = replace(case[0], residual=residual, used=np.ones(len(pose), dtype=bool))
        noise, dof = replicate_noise(fit, recording)
        squares.append(noise**2)
    assert dof == 2 * (len(pose) - len(np.unique(pose)))
    assert np.mean(squares) == pytest.approx(9.0, abs=4.0 * 9.0 * np.sqrt(2.0 / dof / len(squares)))


Case = tuple[Estimate, Recording]


def noise(case: Case, seed: int, size: float = 1.0) -> Array:
    return size * np.random.default_rng(seed).standard_normal(case[0].residual.shape)


def left(case: Case, residual: Array) -> Estimate:
    return replace(case[0], residual=residual)


# -- figures and notes ---------------------------------------------------------------------------------


def test_rms_is_of_the_norm_of_each_kind() -> None:
    """Positions of two points and a rotation; a row that cannot be assembled does not count."""
    rng = np.random.default_rng(11)
    channels = [Channel(f"{p}.{a}", "mm", 0.5, "position", p) for p in ("P1", "P2") for a in "xyz"]
    channels += [Channel(f"r{a}", "rad", 0.01, "rotation", "tool") for a in "xyz"]
    error = rng.standard_normal((50, 9))
    whitened = error / [c.sigma for c in channels]
    found = rms_by_kind(np.vstack([whitened, np.full(9, np.nan)]), channels)
    points = np.sqrt(np.mean([np.sum(error[:, at] ** 2, axis=1) for at in (slice(0, 3), slice(3, 6))]))
    assert found == pytest.approx(
        {"position": float(points), "rotation": float(np.sqrt(np.mean(np.sum(error[:, 6:] ** 2, axis=1))))}
    )
    assert np.isnan(rms_by_kind(np.full((2, 9), np.nan), channels)["position"])


@pytest.mark.parametrize("seed", range(3))
def test_sums_over_very_many_rows_tell_the_same_of_structure(
    case: Case, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The statistics are the same numbers; what chance makes is drawn another way, and of white noise p is uniform."""
    _, recording = case
    clocked = replace(recording, time=np.arange(len(recording), dtype=float))
    if seed == 2:  # rows that do not follow one another in time
        clocked = replace(clocked, time=np.random.default_rng(seed).permutation(len(recording)).astype(float))
    error = noise(case, seed) + 0.5 * np.sin(4.0 * clocked.q[:, [1]])
    by_rows = structure_alarm(left(case, error), clocked)
    monkeypatch.setattr(alarms, "LARGEST_PROJECTION", 0)
    monkeypatch.setattr(alarms, "TOGETHER", 7 + seed)
    by_sums = structure_alarm(left(case, error), clocked)
    assert by_sums.about == by_rows.about
    assert (by_sums.statistic, by_sums.share) == pytest.approx((by_rows.statistic, by_rows.share), rel=1e-9)
    assert by_sums.p == pytest.approx(by_rows.p, abs=0.1)
    chance = [structure_alarm(left(case, noise(case, 100 * seed + k)), clocked).p for k in range(60)]
    assert kstest(chance, "uniform").pvalue > 1e-3


# -- how sure alarms are ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lost", "about"), [(0, "replicates"), (1, "replicates"), (2, "stated sigma")])
def test_eight_degrees_of_freedom_of_repeats_say_how_large_the_noise_is(
    case: Case, lost: int, about: str
) -> None:
    """Three repeats of three channels, of which some readings were lost: an F test of what they leave to the others."""
    fit, recording = case
    n = len(recording)
    pose, q, half = np.arange(n, dtype=np.int64), recording.q.copy(), n // 2
    pose[half : half + 3], q[half : half + 3] = pose[:3], q[:3]
    gone = np.zeros(fit.residual.shape, dtype=bool)
    gone[:lost, 0] = True
    residual = np.where(gone, 0.0, noise(case, 12, 3.0))
    found = replace(fit, residual=residual, lost=gone if lost else None)
    repeated = replace(recording, pose=pose, q=q)
    alarm = residual_alarm(found, repeated)
    assert alarm.about == about
    dof = found.n_observations - found.effective_parameters
    assert alarm.statistic == pytest.approx(found.chi2 / dof)
    spread, repeats = replicate_noise(found, repeated)
    assert repeats == 9 - lost
    if about == "stated sigma":
        assert alarm.p == pytest.approx(chi2.sf(found.chi2, dof))
    else:
        rest = dof - repeats
        lack = (found.chi2 - spread**2 * repeats) / rest
        assert alarm.p == pytest.approx(fisher.sf(lack / spread**2, rest, repeats))


def test_beyond_what_is_drawn_structure_is_judged_by_all_its_tests(case: Case) -> None:
    """Bonferroni over the drivers and, where rows have an order, their neighbours; else a share of three hundred draws."""
    _, recording = case
    q3 = recording.q[:, recording.joints.index("q3")]
    t = 2.0 * (q3 - q3.min()) / np.ptp(q3) - 1.0
    error = noise(case, 5) + 3.0 * np.sin(np.pi * t)[:, None]
    for shuffled in (False, True):
        asked = replace(recording, shuffled=shuffled, time=None)
        found = structure_alarm(left(case, error), asked)
        tests = len(asked.columns()) + (0 if shuffled else 1)
        assert found.about == "q3" and found.p == pytest.approx(10.0**-found.statistic * tests, rel=1e-6)
    quiet = structure_alarm(left(case, noise(case, 21)), recording)
    assert quiet.p > 1.0 / 301.0 and quiet.p * 301.0 == pytest.approx(round(quiet.p * 301.0))


@pytest.mark.parametrize("driver", ["q2", "order"])
def test_statistics_of_structure_are_logs_of_chi_square(case: Case, driver: str) -> None:
    """Of all channels together, each of unit rms, far values pulled in: three powers and two waves, or neighbours."""
    _, recording = case
    asked = replace(recording, time=np.arange(len(recording), dtype=float))
    q2 = asked.q[:, asked.joints.index("q2")]
    t = 2.0 * (q2 - q2.min()) / np.ptp(q2) - 1.0
    slow = np.repeat(np.random.default_rng(2).standard_normal((len(t) // 5 + 1, 3)), 5, axis=0)[: len(t)]
    error = noise(case, 6) + (3.0 * np.sin(2.0 * np.pi * t)[:, None] if driver == "q2" else 3.0 * slow)
    error[4, 1] = 60.0
    found = structure_alarm(left(case, error), asked)
    assert found.about == driver
    r = np.clip(error / np.sqrt(np.mean(error**2, axis=0)), -3.5, 3.5)
    if driver == "order":
        lag = float(np.sum(r[1:] * r[:-1])) / np.sqrt(r[1:].size)
        assert found.statistic == pytest.approx(-np.log10(chi2.sf(lag**2, 1)), rel=1e-6)
        assert found.share == 0.0
        return
    waves = [f(np.pi * k * t) for k in (1, 2) for f in (np.sin, np.cos)]
    basis = np.linalg.qr(np.column_stack([np.ones(len(t)), t, t**2, t**3, *waves]))[0][:, 1:]
    along = float(np.sum((basis.T @ r) ** 2))
    assert found.statistic == pytest.approx(-chi2.logsf(along, 7 * 3) / np.log(10), rel=1e-6)
    assert found.share == pytest.approx(along / float(np.sum(r**2)))


READINGS, FREE = 60, 12


def linear(rng: np.random.Generator, *, noise: float = 1.0, departure: float = 1.0) -> Linearisation:
    """A linear machine drawn from its tolerances (``departure`` times as wide as stated), seen with noise."""
    jacobian = rng.normal(size=(READINGS, FREE)) * np.geomspace(20, 1e-2, FREE)
    e = jacobian @ rng.normal(scale=departure, size=FREE) + noise * rng.normal(size=READINGS)
    rows = np.column_stack([jacobian, e])
    return Linearisation(
        grams=(rows.T @ rows,),
        counts=(READINGS,),
        free=FREE,
        columns=(),
        departure=np.zeros(FREE),
        weight=np.ones(FREE),
        parts=(PartClass("length"),) * FREE,
        candidates=(),
    )


def free_noise(lin: Linearisation) -> float:
    """Noise scale that a free fit leaves, at least the stated one."""
    inside, across = lin.gram[:FREE, :FREE], lin.gram[:FREE, FREE]
    left = lin.gram[FREE, FREE] - across @ np.linalg.solve(inside, across)
    return max(1.0, float(np.sqrt(left / (READINGS - FREE))))


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_p_of_true_models_is_uniform_or_cautious(noise: float) -> None:
    rng = np.random.default_rng(4)
    p = []
    for _ in range(300):
        lin = linear(rng, noise=noise)
        p.append(conflict_with_tolerances(lin, free_noise(lin)).p)
    for level in (0.01, 0.1, 0.5):  # three standard errors of a share of 300
        assert np.mean(np.array(p) < level) < level + 3 * np.sqrt(level * (1 - level) / 300)
    assert np.mean(np.array(p) < 0.5) > 0.3  # and not blind


@pytest.mark.parametrize(("noise", "departure", "error"), [(1.0, 3.0, 1.0), (2.0, 4.0, 2.0), (1.0, 1.0, 1.6)])
def test_far_beyond_what_is_drawn_p_is_twice_the_smaller_one_of_two_chi2(
    noise: float, departure: float, error: float
) -> None:
    """What a least-squares fit departs by against its own spread, and the readings against theirs, both in full."""
    rng = np.random.default_rng(11)
    sensitivity = rng.normal(size=(READINGS, FREE)) * np.geomspace(20, 1, FREE)
    e = sensitivity @ rng.normal(scale=departure, size=FREE) + error * rng.normal(size=READINGS)
    away, tolerance = rng.normal(size=FREE + 2), rng.uniform(0.5, 2.0, FREE)
    open_ = 3  # without a tolerance
    effects = rng.normal(
        size=(READINGS, 2)
    )  # which stay in the model: only geometry is taken back to the drawing
    rows = np.column_stack([sensitivity, effects, e + sensitivity @ away[:FREE]])
    weight = np.where(np.arange(FREE) == open_, 0.0, 1.0 / tolerance)
    parts, columns = (PartClass("length"),) * FREE, (slice(0, 1), slice(1, 2))
    lin = Linearisation((rows.T @ rows,), (READINGS,), FREE, columns, away, weight, parts, ())
    # readings freed of the open parameter; geometry in tolerances
    keep = null_space(sensitivity[:, [open_]].T)
    j, seen = keep.T @ np.delete(sensitivity * tolerance, open_, axis=1), keep.T @ e
    fitted = np.linalg.pinv(j) @ seen
    spread = np.eye(FREE - 1) + noise**2 * np.linalg.inv(j.T @ j)
    statistic = float(fitted @ np.linalg.solve(spread, fitted))
    whole = float(seen @ np.linalg.solve(j @ j.T + noise**2 * np.eye(READINGS - 1), seen))
    smaller = min(chi2.sf(statistic, FREE - 1), chi2.sf(whole, READINGS - 1))
    found = conflict_with_tolerances(lin, noise)
    assert found.statistic == pytest.approx(statistic, rel=1e-6)
    assert 2.0 * smaller < 1e-3
    assert found.p == pytest.approx(2.0 * smaller, rel=1e-4)


def test_wrong_tolerances_are_seen_and_widening_them_reconciles() -> None:
    lin = linear(np.random.default_rng(5), departure=6.0)
    noise = free_noise(lin)
    assert conflict_with_tolerances(lin, noise).p < 1e-3
    wide = replace(lin, weight=lin.weight / 6.0)
    assert conflict_with_tolerances(wide, noise).p > 0.01


def test_parameters_without_tolerance_are_projected_out() -> None:
    rng = np.random.default_rng(6)
    lin = linear(rng)
    weight = np.ones(FREE)
    weight[0] = 0.0
    far = lin.gram.copy()
    shift = 1e3 * lin.gram[:, 0]  # the unknown parameter stands anywhere
    far[:, FREE] += shift
    far[FREE, :FREE] = far[:FREE, FREE]
    far[FREE, FREE] = lin.gram[FREE, FREE] + 2e3 * lin.gram[0, FREE] + 1e6 * lin.gram[0, 0]
    found = [
        conflict_with_tolerances(
            Linearisation((gram,), (READINGS,), FREE, (), np.zeros(FREE), weight, lin.parts, ()), 1.0
        )
        for gram in (lin.gram, far)
    ]
    assert found[0].statistic == pytest.approx(found[1].statistic, rel=1e-4)


def test_an_alarm_without_cause_is_raised_once_in_a_hundred() -> None:
    """p of a true model is uniform."""
    p = (np.arange(5000) + 0.5) / 5000
    assert sum(Alarm(1.0, float(value)).raised for value in p) == 50
