"""Rows that nothing smooth explains: where they lie, how far off they would be by themselves, and which are told."""

from __future__ import annotations

from dataclasses import replace
from math import comb
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from support.recordings import rows_of
from support.sensor_bench import Bench
from support.signature_rows import columns_at
from truepose.identification.diagnosis.null_fits import (
    clustered,
    far_rows,
    outlying_rows,
    recording_coordinates,
)
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.signatures import Signatures

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Estimate, Recording]:
    bench = Bench(tmp_path_factory.mktemp("arm"), "arm")
    recording = bench.recording()
    return estimate(bench.machine, recording), recording


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
    arm: tuple[Estimate, Recording],
) -> None:
    """r' (1 - H)^-1 r by the whole hat matrix, H the share that the row has in its own prediction."""
    fit, recording = arm
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
    arm: tuple[Estimate, Recording],
) -> None:
    fit, recording = arm
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


def test_lost_readings_count_neither_for_nor_against_a_row(arm: tuple[Estimate, Recording]) -> None:
    """A row of one reading is judged by the limit of one channel; a row without any is not judged."""
    fit, recording = arm
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
