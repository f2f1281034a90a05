"""Rows that nothing smooth explains: where they lie, how far off they would be by themselves, and which are told."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import comb
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from support.recordings import rows_of
from support.sensor_bench import STAGE, STAGE_HEAD, Bench
from support.signature_rows import columns_at
from truepose.arrays import Array
from truepose.errors import ConvergenceError
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.null_fits import (
    bridges,
    clustered,
    far_rows,
    free_fit,
    fringes_by_row,
    miscounted_fringes,
    outlying_rows,
    recording_coordinates,
)
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimate import FREE_WIDENING, estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.report.results import diagnosis_json
from truepose.identification.signatures.signatures import Signatures

Case = tuple[Estimate, Recording]

Mask = NDArray[np.bool_]


def quiet(shape: tuple[int, ...]) -> Array:
    """Residuals of which none is far."""
    return np.clip(np.random.default_rng(4).standard_normal(shape), -1.5, 1.5)


def limit(rows: int, channels: int) -> float:
    """One and a half times what chance passes in one recording of a thousand, root mean square of a row."""
    return float(1.5 * np.sqrt(chi2.isf(1e-3 / rows, channels) / channels))


# -- where far rows lie -------------------------------------------------------------------------------------------


def lie_together(at: Array, far: Mask) -> bool:
    """The four nearest of each far row, one by one, and the chance of so many far ones among them."""
    n, count = len(far), int(far.sum())
    share, least = (count - 1) / (n - 1), 1.0
    views = [at, *at.T[:, :, None]]
    for view in views:
        hits = tries = 0
        for k in np.flatnonzero(far):
            distance = np.sqrt(np.sum((view - view[k]) ** 2, axis=1))
            distance[k] = np.inf
            near = np.argsort(distance)[:4]
            hits, tries = hits + int(far[near].sum()), tries + len(near)
        if hits > 0.3 * tries:
            chance = [
                comb(tries, j) * share**j * (1.0 - share) ** (tries - j) for j in range(hits, tries + 1)
            ]
            least = min(least, sum(chance))
    return count >= 4 and len(views) * least < 1e-3


def test_far_rows_lie_together_where_their_neighbours_are_far_beyond_chance() -> None:
    """In all coordinates at once or in any one of them; from none of the far rows in a stretch to all of them."""
    rng, said = np.random.default_rng(1), list[bool]()
    for count in (3, 4, 5, 8, 14):
        for share in np.linspace(0.0, 1.0, 11):
            at = rng.uniform(-1.0, 1.0, (150, 3))
            along = np.argsort(at[:, 1])
            together = along[: round(count * share)]
            rest = rng.choice(along[count:], count - len(together), replace=False)
            far = np.isin(np.arange(150), [*together, *rest])
            assert far.sum() == count
            said.append(clustered(at, far))
            assert said[-1] == lie_together(at, far)
    assert 10 < sum(said) < len(said) - 10


def test_where_rows_lie_is_told_in_standard_deviations_of_what_varies() -> None:
    """Joints, the order of acquisition where rows have one, and all that was logged; of the rows that are asked for."""
    rng, n = np.random.default_rng(2), 40
    time = rng.permutation(n).astype(float)
    recording = rows_of(
        np.column_stack([rng.uniform(-3.0, 5.0, n), np.full(n, 0.7)]),
        drivers={"payload": rng.uniform(0.0, 9.0, n)},
        time=time,
    )
    some = np.arange(5, 35)
    at = recording_coordinates(recording, some)
    # q2 stands still; the rows' order and their time go together
    expected = np.column_stack([recording.q[:, 0], time, recording.drivers["payload"], time])[some]
    np.testing.assert_allclose(at, (expected - expected.mean(axis=0)) / expected.std(axis=0))
    bare = replace(recording, time=None, shuffled=True)
    assert recording_coordinates(bare, some).shape == (30, 2)


# -- how far off a row is -----------------------------------------------------------------------------------------


def test_a_row_that_the_fit_follows_is_judged_as_if_it_had_not_been_fitted(
    case: Case,
) -> None:
    """r' (1 - H)^-1 r by the whole hat matrix, H the share that the row has in its own prediction."""
    fit, recording = case
    signatures = Signatures(fit.nominal, recording, ())
    rows = columns_at(signatures, fit)
    lin = signatures.linearise(fit)
    j = rows[:, : lin.free]
    inverse = np.linalg.inv(j.T @ j + np.diag(lin.weight**2))
    n, m = fit.residual.shape
    hats = [own @ inverse @ own.T for own in j.reshape(n, m, -1)]
    row = int(np.argmax([np.trace(hat) for hat in hats]))
    residual = quiet((n, m))
    direction = np.array([0.6, -1.0, 0.3])
    size = float(np.sqrt(direction @ np.linalg.solve(np.eye(m) - hats[row], direction) / m))
    assert size > 1.1 * np.sqrt(np.mean(direction**2))  # the fit follows it a good part of the way
    for share, outlying in ((0.98, []), (1.02, [row])):
        residual[row] = share * limit(n, m) / size * direction
        found = outlying_rows(replace(fit, residual=residual), recording, np.ones(n, dtype=bool))
        assert np.flatnonzero(found).tolist() == outlying
        # what was not fitted is as far off as it is
        unused = replace(fit, residual=residual, used=np.arange(n) != row)
        assert not outlying_rows(unused, recording, np.ones(n, dtype=bool)).any()


def test_nothing_is_said_of_fewer_than_ten_rows_or_of_rows_that_are_no_candidates(
    case: Case,
) -> None:
    fit, recording = case
    n, m = fit.residual.shape
    residual = quiet((n, m))
    residual[3] = 40.0
    found = replace(fit, residual=residual)
    for candidates, outlying in ((9, []), (10, [3]), (n, [3])):
        asked = np.arange(n) < candidates
        assert np.flatnonzero(outlying_rows(found, recording, asked)).tolist() == outlying
    assert not outlying_rows(found, recording, np.arange(n) > 3).any()
    residual[3, 1] = np.nan  # a row that cannot be assembled is left out anyway
    assert not outlying_rows(found, recording, np.ones(n, dtype=bool)).any()


def test_lost_readings_count_neither_for_nor_against_a_row(case: Case) -> None:
    """A row of one reading is judged by the limit of one channel; a row without any is not judged."""
    fit, recording = case
    n, m = fit.residual.shape
    lost = np.zeros((n, m), dtype=bool)
    lost[3, 1:], lost[7] = True, True
    for share, outlying in ((0.97, False), (1.03, True)):
        residual = np.where(lost, 0.0, quiet((n, m)))
        residual[3, 0] = share * limit(n - 1, 1)
        found = replace(fit, residual=residual, lost=lost, used=np.arange(n) != 3)
        assert outlying_rows(found, recording, np.ones(n, dtype=bool))[3] == outlying


# -- which are told -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("times", "told"), [(1.9, False), (2.1, True)])
def test_rows_are_told_that_are_twice_as_far_as_all_others(tmp_path: Path, times: float, told: bool) -> None:
    """The farthest first, by file and row of data; others may be large where physics was left out."""
    bench = Bench(tmp_path, "stage")
    recording = bench.recording()
    fit = estimate(bench.machine, recording)
    n, m = fit.residual.shape
    residual = quiet((n, m))
    large = 0.95 * limit(n, m)
    residual[20], residual[40], residual[60] = large, -times * large, 3.0 * large
    found = SimpleNamespace(
        fit=replace(fit, residual=residual), recording=recording, only=(), method={"estimator": "huber"}
    )
    rows = far_rows(cast(Calibration, found))
    expected = [(61, 3.0 * large), (41, times * large)][: 1 + told]
    assert [(row.file, row.row) for row in rows] == [(recording.files[0], row) for row, _ in expected]
    assert [row.sigma for row in rows] == pytest.approx([sigma for _, sigma in expected])
    held_out = replace(recording, validation=np.arange(n) == 60)
    of_others = far_rows(cast(Calibration, SimpleNamespace(**vars(found) | {"recording": held_out})))
    assert [row.row for row in of_others] == ([41] if told else [])


@pytest.mark.parametrize("most", [1000.0, 60.0, 20.0, 1.0])
def test_an_ordinary_fit_without_a_bottom_is_sought_with_ever_narrower_tolerances(
    case: Case, monkeypatch: pytest.MonkeyPatch, most: float
) -> None:
    """From a hundred times the stated ones to ten times; the fit under the stated ones stands in for the rest."""
    before, recording = case
    tried: list[float] = []
    starts: list[object] = []

    def fails(*_: object, start: object, widen: float, **__: object) -> str:
        tried.append(widen)
        starts.append(start)
        if widen > most:
            raise ConvergenceError("no minimum")
        return "converged"

    monkeypatch.setattr("truepose.identification.diagnosis.null_fits.estimate", fails)
    start, far = np.zeros(3), np.zeros(len(recording), dtype=np.bool_)
    found: object = free_fit(before.nominal, recording, before, far, start)
    widths = [FREE_WIDENING * share for share in (1.0, 1.0 / 3.0, 0.1)]
    count = next((k for k, w in enumerate(widths, start=1) if w <= most), 3)
    assert tried == pytest.approx(widths[:count])
    assert found == "converged" if widths[-1] <= most else found is before
    assert starts[0] is start and all(s is before.p for s in starts[1:])


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Estimate:
    """A fit whose residuals the tests replace."""
    bench = Bench(tmp_path_factory.mktemp("fit"), "stage")
    return estimate(bench.machine, bench.recording())


def leaving(fit: Estimate, residual: Array) -> Estimate:
    """The fit with these residuals (n, m) of rows that were all used."""
    return replace(fit, residual=residual, used=np.ones(len(residual), dtype=bool))


def anywhere(n: int) -> Recording:
    """A recording of n poses that have nothing to do with the order of rows."""
    return rows_of(np.random.default_rng(9).uniform(-1.0, 1.0, (n, 3)))


@pytest.mark.parametrize("noise", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_row_is_outlying_beyond_one_and_a_half_gaussian_limits(
    fit: Estimate, noise: float, channels: int
) -> None:
    """The limit that chance passes in one recording of a thousand, by the larger of the stated noise and the rows' own."""
    rng, n, row = np.random.default_rng(2), 400, 123
    quiet = rng.standard_normal((n, channels))
    size = np.sqrt(np.mean(quiet**2, axis=1))
    quiet *= (np.minimum(size, 2.0) / size)[:, None]  # nothing far by chance
    own = float(np.median(np.minimum(size, 2.0))) / np.sqrt(chi2.median(channels) / channels)
    limit = max(1.0, noise * own) * np.sqrt(chi2.ppf((1.0 - 1e-3) ** (1.0 / n), channels) / channels)
    for share, outlying in ((1.45, False), (1.55, True)):
        residual = noise * quiet
        residual[row] = share * limit
        found = np.flatnonzero(outlying_rows(leaving(fit, residual), anywhere(n), np.ones(n, dtype=bool)))
        assert found.tolist() == ([row] if outlying else [])


def test_many_far_rows_are_a_wrong_model_and_no_outliers(fit: Estimate) -> None:
    rng, n = np.random.default_rng(3), 200
    order = rng.permutation(n)
    for far, marked in ((20, 20), (21, 0)):  # one in ten is the most
        residual = np.clip(rng.standard_normal((n, 2)), -2.0, 2.0)
        residual[order[:far]] = 50.0
        found = outlying_rows(leaving(fit, residual), anywhere(n), np.ones(n, dtype=bool))
        assert found.sum() == found[order[:far]].sum() == marked


@pytest.mark.parametrize("where", ["time", "pose", "payload"])
def test_far_rows_that_lie_together_are_physics_and_no_outliers(fit: Estimate, where: str) -> None:
    """The heaviest loads, folded poses, a stretch of time: what is far there has a cause, and is kept."""
    rng, n = np.random.default_rng(5), 300
    order = rng.permutation(n)
    recording = rows_of(rng.uniform(-1.0, 1.0, (n, 3)), drivers={"payload": rng.uniform(0.0, 12.0, n)})
    score = {
        "time": np.arange(n, dtype=float),
        "pose": recording.q @ np.ones(3),
        "payload": np.asarray(recording.drivers["payload"]),
    }[where]
    for far, kept in ((np.argsort(score)[-12:], True), (order[:12], False)):
        residual = np.clip(rng.standard_normal((n, 2)), -2.0, 2.0)
        residual[far] = 50.0
        found = outlying_rows(leaving(fit, residual), recording, np.ones(n, dtype=bool))
        assert found.sum() == (0 if kept else 12)


@pytest.mark.parametrize(("ties", "alone"), [(1, True), (3, True), (4, False)])
def test_few_rows_that_tie_two_sessions_together_are_told_from_many(ties: int, alone: bool) -> None:
    """A shift between the sessions would stand in these few rows only; of many, one that is far is an error of its own."""
    n = 20
    origin = np.maximum(np.arange(n) - 1, 0)
    origin[10 : 10 + ties] = 9  # the first rows of the second session are read against the last of the first
    recording = replace(anywhere(n), from_row=origin, session=np.repeat([1, 2], n // 2))
    assert np.flatnonzero(bridges(recording)).tolist() == (list(range(10, 10 + ties)) if alone else [])
    part = recording.subset([0, 3, 10, 15])
    assert bridges(part).tolist() == [False, False, True, False]  # whatever rows are left out
    assert not bridges(replace(recording, from_row=None)).any()


UM = 1e3
HALF = 1.56e-3 / 2
RIGID = (STAGE_HEAD + STAGE).replace("length: 1, angle: 0.05", "length: 0, angle: 0")
"""The stage without tolerances of its own: what is unknown is where the beam and the mirror are."""


@pytest.fixture(scope="module")
def benches(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Bench]:
    return {name: Bench(tmp_path_factory.mktemp(name), name) for name in ("arm", "stage")}


def longer(column: str, rows: Mapping[int, float], unit: float) -> Callable[[pd.DataFrame], None]:
    """What makes the readings of some rows too long, mm; ``unit``: how many of the file's units are a mm."""

    def change(frame: pd.DataFrame) -> None:
        values = frame[column].to_numpy(dtype=float).copy()
        for row, mm in rows.items():
            values[row] += unit * mm
        frame[column] = values

    return change


def _without(bench: Bench, recording: Recording, rows: list[int]) -> tuple[Estimate, NDArray[np.bool_]]:
    far = np.zeros(len(recording), dtype=np.bool_)
    far[rows] = True
    return estimate(bench.machine, recording, exclude=far), far


@pytest.mark.parametrize("counts", [{7: 1, 31: -2}, {11: 5, 13: -1, 65: 1}])
def test_whole_half_wavelengths_are_counted_with_their_sign(
    benches: Mapping[str, Bench], counts: dict[int, int]
) -> None:
    bench = benches["stage"]
    change = longer("dL", {row: k * HALF for row, k in counts.items()}, UM)
    recording = bench.recording(change=change)
    fit, far = _without(bench, recording, list(counts))
    assert miscounted_fringes(fit, recording, far) == counts
    numbers = [row + 1 for row in counts]
    assert fringes_by_row(fit, recording, numbers) == {row + 1: k for row, k in counts.items()}


@pytest.mark.parametrize("part", [0.3, 0.5, 0.8, 0.0, 2.4])
def test_other_outliers_are_no_fringes(benches: Mapping[str, Bench], part: float) -> None:
    bench = benches["stage"]
    recording = bench.recording(change=longer("dL", {9: part * HALF}, UM))
    assert miscounted_fringes(*_arguments(bench, recording, [9])) == {}


def _arguments(
    bench: Bench, recording: Recording, rows: list[int]
) -> tuple[Estimate, Recording, NDArray[np.bool_]]:
    fit, far = _without(bench, recording, rows)
    return fit, recording, far


def test_noise_as_large_as_a_fringe_names_none(tmp_path: Path) -> None:
    coarse = Bench(tmp_path, "stage", RIGID.replace("distance: 0.002", "distance: 0.1"))
    recording = coarse.recording(seed=None, change=longer("dL", {9: 2 * HALF}, UM))
    assert miscounted_fringes(*_arguments(coarse, recording, [9])) == {}


def test_sensors_without_light_have_no_fringes(benches: Mapping[str, Bench]) -> None:
    bench = benches["arm"]
    recording = bench.recording(change=longer("x", {9: HALF}, 1.0))
    assert miscounted_fringes(*_arguments(bench, recording, [9])) == {}


def test_a_diagnosis_tells_fringes_from_other_rows(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "stage", RIGID.replace("distance: 0.002", "distance: 0.01"))
    change = longer("dL", {11: HALF, 41: -3 * HALF, 21: 0.4 * HALF}, UM)
    found = diagnosis_json(diagnose(bench.machine, bench.recording(change=change)))
    assert found["verdict"] == "adequate"
    assert [(f["effect"], f["place"]) for f in found["findings"]] == [
        ("fringe-miscount", ["12", "42"]),
        ("outliers", ["22"]),
    ]
    assert "row 12: +1, row 42: -3" in found["findings"][0]["explanation"]
