"""Tests of structure from sums over rows: those of orthonormal functions written out, and what chance makes of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2, kstest

from truepose.identification.diagnosis import alarms as structure_sums
from truepose.identification.diagnosis.alarms import Functions, StructureSums

Array = NDArray[np.float64]
ROWS, CHANNELS = 57, 2


def functions(rng: np.random.Generator) -> Mapping[str, Functions]:
    """A line and a parabola in one driver, a wave in another that goes with it."""
    t = rng.uniform(-1.0, 1.0, ROWS)
    return {
        "a": Functions(t, 3, lambda v: [v, v**2, v**3]),
        "b": Functions(t + 0.3 * rng.standard_normal(ROWS), 2, lambda v: [np.sin(2.0 * v), np.cos(2.0 * v)]),
    }


def columns(one: Functions) -> Array:
    """(n, width - 1) orthonormal, without the constant."""
    every = np.column_stack([np.ones(ROWS), *one.made(one.values)])[:, : one.width]
    return np.asarray(np.linalg.qr(every)[0][:, 1:])


def cases(
    together: int, monkeypatch: pytest.MonkeyPatch
) -> tuple[Array, Mapping[str, Functions], NDArray[np.intp]]:
    monkeypatch.setattr(structure_sums, "TOGETHER", together)
    rng = np.random.default_rng(3)
    told = functions(rng)
    residual = rng.standard_normal((ROWS, CHANNELS)) + 0.5 * told["a"].values[:, None]
    return residual, told, rng.permutation(ROWS).astype(np.intp)


@pytest.mark.parametrize("together", [1, 7, 56, 57, 1000])
def test_tests_are_those_of_functions_and_neighbours_written_out(
    together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However many rows are looked at together."""
    residual, told, order = cases(together, monkeypatch)
    found = StructureSums(residual, told, order).tests()
    expected = {}
    for name, one in told.items():
        squares = float(np.sum((columns(one).T @ residual) ** 2))
        expected[name] = -np.log10(chi2.sf(squares, (one.width - 1) * CHANNELS))
    pairs = [residual[order[k]] * residual[order[k + 1]] for k in range(ROWS - 1)]
    lag = np.sum(pairs) / np.sqrt(np.size(pairs))
    expected["order"] = -np.log10(chi2.sf(lag**2, 1))
    assert found == pytest.approx(expected, rel=1e-9)
    without = StructureSums(residual, told, None).tests()
    assert without == pytest.approx({name: expected[name] for name in told}, rel=1e-9)


def test_sums_keep_how_functions_of_two_drivers_go_together(monkeypatch: pytest.MonkeyPatch) -> None:
    residual, told, order = cases(10, monkeypatch)
    found = StructureSums(residual, told, order)
    q = np.hstack([columns(one) for one in told.values()])
    assert found.spans == {"a": slice(0, 2), "b": slice(2, 3)}
    np.testing.assert_allclose(np.abs(found.among), np.abs(q.T @ q), atol=1e-9)
    np.testing.assert_allclose(found.along**2, (q.T @ residual) ** 2, atol=1e-9)


def test_chance_is_drawn_as_white_residuals_make_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The largest test of each draw, of drivers that go together and of neighbours: as of residuals drawn row by row."""
    _, told, order = cases(20, monkeypatch)
    rng = np.random.default_rng(8)
    noise = rng.standard_normal((400, ROWS, CHANNELS))
    for places in (order, None):
        sums = [StructureSums(one, told, places) for one in noise]
        largest = [max(one.tests().values()) for one in sums]
        null = sums[0].null(2000, 1)
        assert null.shape == (2000,)
        np.testing.assert_array_equal(null, sums[0].null(2000, 1))
        rank = np.searchsorted(np.sort(null), largest) / len(null)
        assert kstest(rank, "uniform").pvalue > 0.01
