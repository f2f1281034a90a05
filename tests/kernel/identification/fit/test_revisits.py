"""Laws of visits to one place: they tell the noise of a row, whatever the model leaves out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.sensor_bench import Bench
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.repeatability import FEWEST, revisits
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.recording.recording import Recording, frozen
from truepose.identification.report.notes import held_out_notes, repeat_notes
from truepose.identification.report.phrases import measure

PLACES = 120


@pytest.fixture(scope="module")
def visited(tmp_path_factory: pytest.TempPathFactory) -> tuple[Estimate, Recording]:
    """A fit of an arm, its rows twice in another order, residuals of 3 sigma that follow the place and noise of 1 sigma."""
    bench = Bench(tmp_path_factory.mktemp("visits"), "arm")
    fit, recording = estimate(bench.machine, bench.recording()), bench.recording()
    rng = np.random.default_rng(4)
    place = rng.integers(0, len(recording), PLACES)
    rows = np.concatenate([place, rng.permutation(place)])
    q = recording.q[rows] + 1e-3 * rng.standard_normal((2 * PLACES, recording.q.shape[1]))
    q[:PLACES] = rng.uniform(-1.0, 1.0, (PLACES, q.shape[1]))
    there = rng.permutation(PLACES)
    q[PLACES:] = q[:PLACES][there] + 1e-5 * rng.uniform(-1.0, 1.0, q[:PLACES].shape)
    model = 3.0 * rng.standard_normal((PLACES, fit.residual.shape[1]))
    residual = np.concatenate([model, model[there]]) + rng.standard_normal(
        (2 * PLACES, fit.residual.shape[1])
    )
    two = replace(recording.subset(rows), q=frozen(q), source_row=frozen(np.arange(2 * PLACES)))
    return replace(fit, residual=residual, used=np.ones(2 * PLACES, dtype=bool), lost=None), two


def test_visits_tell_the_noise_of_a_row(visited: tuple[Estimate, Recording]) -> None:
    """1 sigma of three channels, to a few 1-sigma of 120 pairs (4 %); what the model leaves is sqrt(10) times that."""
    fit, recording = visited
    seen = revisits(fit, recording)
    assert seen is not None and FEWEST <= seen.pairs <= PLACES
    sigma = np.sqrt(sum(c.sigma**2 for c in fit.nominal.channels if c.kind == "position"))
    assert seen.scatter["position"] == pytest.approx(sigma, rel=0.15)
    assert seen.left["position"] == pytest.approx(np.sqrt(10.0) * sigma, rel=0.2)
    assert 0.0 < seen.apart["turn"] <= 2e-5
    (note,) = repeat_notes(fit, recording)
    assert f"{seen.pairs} pairs of rows" in note and "repeats to" in note


def test_an_arm_that_stands_still_or_never_comes_back_tells_nothing(
    visited: tuple[Estimate, Recording],
) -> None:
    fit, recording = visited
    first = np.arange(PLACES)
    once = replace(fit, residual=fit.residual[:PLACES], used=fit.used[:PLACES])
    assert (
        revisits(once, recording.subset(first)) is None and repeat_notes(once, recording.subset(first)) == []
    )
    still = np.repeat(first, 2)  # every row twice, one after the other
    same = replace(recording.subset(still), source_row=frozen(np.arange(len(still))))
    twice = replace(fit, residual=fit.residual[still], used=np.ones(len(still), dtype=bool))
    assert revisits(twice, same) is None


def test_rows_held_out_that_no_model_explains_are_told_apart(visited: tuple[Estimate, Recording]) -> None:
    """Three of 120 rows are a hundred sigma off in one channel; the others are off as before."""
    fit, recording = visited
    held = np.arange(len(recording)) >= PLACES
    apart = replace(recording, validation=frozen(held))
    used = replace(fit, used=~held)
    assert held_out_notes(used, apart) == []
    wild = fit.residual.copy()
    wild[[PLACES + 7, PLACES + 40, PLACES + 95], 0] += 100.0
    (note,) = held_out_notes(replace(used, residual=wild), apart)
    without = np.delete(np.arange(PLACES, 2 * PLACES), [7, 40, 95])
    rms = rms_by_kind(fit.residual[without], fit.nominal.channels)
    assert f"3 of the {PLACES} rows" in note and measure(rms["position"], "mm") in note
