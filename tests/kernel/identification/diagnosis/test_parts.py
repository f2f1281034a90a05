"""Laws of a diagnosis' parts: alarms on residuals of a known make, what is left and its form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2, kstest
from scipy.stats import f as fisher

from support.sensor_bench import Bench
from truepose.identification.diagnosis import alarms
from truepose.identification.diagnosis import alarms as structure_sums
from truepose.identification.diagnosis.alarms import replicate_noise, residual_alarm, structure_alarm
from truepose.identification.diagnosis.findings import remainder_of_residuals
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.machine.sensor import Channel

Array = NDArray[np.float64]
Case = tuple[Estimate, Recording]


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A fit of an arm and its recording, every pose repeated; the tests replace the residuals."""
    bench = Bench(tmp_path_factory.mktemp("case"), "arm")

    def twice(frame: pd.DataFrame) -> None:
        half = len(frame) // 2
        frame.iloc[half:] = frame.iloc[:half].to_numpy()

    bench.recording()
    rows = pd.read_csv(bench.folder / "recording.csv")
    twice(rows)
    rows.to_csv(bench.folder / "recording.csv", index=False)
    recording = load(bench, bench.folder / "recording.csv")
    return estimate(bench.machine, recording), recording


def load(bench: Bench, path: Path) -> Recording:
    return load_recording(bench.machine, [path])


def noise(case: Case, seed: int, size: float = 1.0) -> Array:
    return size * np.random.default_rng(seed).standard_normal(case[0].residual.shape)


def left(case: Case, residual: Array) -> Estimate:
    return replace(case[0], residual=residual)


# -- alarms --------------------------------------------------------------------------------------------


def test_a_misfit_is_judged_by_what_repeats_scatter(
    case: Case,
) -> None:
    """Readings scattered five times the stated sigma are noise; what repeats share is none."""
    fit, recording = case
    alarms = [residual_alarm(left(case, noise(case, seed, 5.0)), recording) for seed in range(100)]
    assert {a.about for a in alarms} == {"replicates"}
    p = np.array([a.p for a in alarms])
    # residuals of a fit are a little smaller; drawn ones are not: the misfit looks larger by their share
    share = 1.0 - fit.effective_parameters / fit.n_observations
    assert np.mean([a.statistic for a in alarms]) == pytest.approx(25.0 / share, rel=0.03)
    assert 0.01 < np.mean(p < 0.1) < 0.6 and np.mean(p < 1e-4) < 0.02
    pose = np.random.default_rng(1).standard_normal((len(recording) // 2, fit.residual.shape[1]))
    off = np.concatenate([pose, pose]) * 10.0
    assert residual_alarm(left(case, noise(case, 1) + off), recording).p < 1e-6


def test_without_repeats_the_misfit_is_judged_by_the_stated_sigma(case: Case) -> None:
    fit, recording = case
    alone = replace(recording, pose=np.arange(len(recording), dtype=np.int64))
    dof = fit.n_observations - fit.effective_parameters
    for size, seen in ((1.0, False), (1.4, True)):
        residual = noise(case, 3)
        residual *= size * np.sqrt(dof / np.sum(residual**2))
        alarm = residual_alarm(left(case, residual), alone)
        assert alarm.about == "stated sigma" and alarm.statistic == pytest.approx(size**2)
        assert alarm.raised is seen
    assert residual_alarm(left(case, residual / 1.4), alone).p == pytest.approx(0.5, abs=0.05)


SHAPES: Mapping[tuple[str, int], Callable[[Array], Array]] = {
    ("linear", 0): lambda t: t,
    ("quadratic", 0): lambda t: 3.0 * t**2 + 0.5 * t,
    ("periodic", 1): lambda t: np.sin(np.pi * t + 0.7),
    ("periodic", 2): lambda t: np.sin(2.0 * np.pi * t + 0.7),
    ("periodic", 4): lambda t: np.sin(4.0 * np.pi * t + 0.7),
}


@pytest.mark.parametrize("form", SHAPES)
def test_what_is_left_is_described_by_its_driver_and_form(case: Case, form: tuple[str, int]) -> None:
    _, recording = case
    q2 = recording.q[:, recording.joints.index("q2")]
    t = 2.0 * (q2 - q2.min()) / np.ptp(q2) - 1.0
    error = noise(case, 4, 0.3)
    error[:, 1] += 2.0 * SHAPES[form](t)
    found = left(case, error)
    structure = structure_alarm(found, recording)
    assert structure.about == "q2" or form[1] > 2  # waves are looked for up to two over the range
    told = remainder_of_residuals(found, recording, replace(structure, about="q2"))
    assert (told.form.kind, told.form.cycles, told.form.share) == (*form, structure.share)
    assert told.place == ("q2",) and told.driver == "q2"
    assert told.size_sigma == pytest.approx(float(np.sqrt(found.chi2_per_dof)))


def test_structure_is_seen_and_shares_what_it_explains(case: Case) -> None:
    _, recording = case
    q3 = recording.q[:, recording.joints.index("q3")]
    t = 2.0 * (q3 - q3.min()) / np.ptp(q3) - 1.0
    plain = noise(case, 5)
    for channel in range(plain.shape[1]):
        plain[:, channel] += 2.0 * np.sqrt(2.0) * np.sin(np.pi * t)
    found = structure_alarm(left(case, plain), recording)
    assert found.raised and found.p < 1e-4 and found.about == "q3"
    assert 0.6 < found.share < 0.95  # four fifths of the variance
    one, other = (structure_alarm(left(case, scale * plain), recording) for scale in (1.0, 7.0))
    assert one.p == pytest.approx(other.p) and one.share == pytest.approx(other.share)


def test_neighbours_in_time_that_agree_are_structure_in_the_order_of_rows(case: Case) -> None:
    _, recording = case
    clocked = replace(recording, time=np.random.default_rng(6).permutation(len(recording)).astype(float))
    slow = noise(case, 7, 0.3)
    rank = np.argsort(np.argsort(clocked.time if clocked.time is not None else []))
    slow += np.repeat(np.random.default_rng(8).standard_normal((len(rank) // 5 + 1, 3)), 5, axis=0)[rank]
    found = structure_alarm(left(case, slow), clocked)
    assert found.raised and found.about == "order"
    told = remainder_of_residuals(left(case, slow), clocked, found)
    assert told.form.kind == "order" and told.place == ()
    assert structure_alarm(left(case, slow), recording).about != "order"  # in another order nothing agrees


def test_a_driver_of_few_values_makes_steps(case: Case) -> None:
    _, recording = case
    side = np.where(np.arange(len(recording)) % 3 == 0, 1.0, -1.0)
    sided = replace(recording, drivers={**recording.drivers, "approach.q1": side})
    error = noise(case, 9, 0.3) + side[:, None]
    structure = structure_alarm(left(case, error), sided)
    assert structure.about == "approach.q1"
    told = remainder_of_residuals(left(case, error), sided, structure)
    assert told.form.kind == "steps" and told.place == ("q1",)


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
    error = noise(case, seed) + 0.5 * np.sin(4.0 * clocked.q[:, [1]])
    by_rows = structure_alarm(left(case, error), clocked)
    monkeypatch.setattr(alarms, "LARGEST_PROJECTION", 0)
    monkeypatch.setattr(structure_sums, "TOGETHER", 7 + seed)
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
    pose = np.arange(n, dtype=np.int64)
    half = n // 2
    pose[half : half + 3] = pose[:3]
    gone = np.zeros(fit.residual.shape, dtype=bool)
    gone[:lost, 0] = True
    residual = np.where(gone, 0.0, noise(case, 12, 3.0))
    found = replace(fit, residual=residual, lost=gone if lost else None)
    repeated = replace(recording, pose=pose)
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
