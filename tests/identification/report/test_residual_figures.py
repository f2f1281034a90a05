"""Figures of residuals: rows drawn as they are, sizes by driver, distributions beside normal ones."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from support.reports import NAN, of
from truepose.identification.report.drivers import Column
from truepose.identification.report.figures.residuals import (
    Drawn,
    component_panels,
    distribution,
    picked,
    row_sizes,
    size_panels,
)
from truepose.shown.chart import Bars, Level, Line, Marks, Tone

Array = NDArray[np.float64]


@pytest.mark.parametrize(
    ("rows", "series", "drawn"),
    [
        (10_000, 0, 10_000),
        (30_000, 1, 30_000),
        (30_001, 1, 30_000),
        (10_000, 30, 1_000),
        (10_000, 10_000, 150),
        (150, 10_000, 150),
        (0, 3, 0),
    ],
)
def test_a_page_draws_thirty_thousand_points_but_a_hundred_and_fifty_rows_in_any_case(
    rows: int, series: int, drawn: int
) -> None:
    found = picked(rows, series)
    assert len(found) == drawn and (np.diff(found) > 0).all()
    if drawn:
        assert (found[0], found[-1]) == (0, rows - 1)
        assert np.ptp(np.diff(found)) <= 1


def test_the_size_of_a_row_is_the_rms_of_what_it_read() -> None:
    """A reading that was lost is none, one that refers to itself is none."""
    residual = np.array([[3.0, 4.0], [3.0, NAN], [-3.0, 0.0], [NAN, NAN], [0.0, 0.0]])
    np.testing.assert_allclose(row_sizes(residual), [np.sqrt(12.5), 3.0, 3.0, NAN, NAN])


def fit(residual: Array, tone: Tone = "before", counts: NDArray[Any] | None = None) -> Drawn:
    known = np.ones(len(residual), dtype=bool) if counts is None else np.asarray(counts, dtype=bool)
    return Drawn(tone, tone, residual, known)


def column(values: Array, name: str = "q1") -> Column:
    return Column(name, f"{name} [°]", values)


def test_sizes_reach_as_far_as_the_rows_that_count() -> None:
    x = np.arange(5.0)
    one = fit(np.array([[1.0], [2.0], [5.0], [90.0], [NAN]]), counts=np.array([1, 1, 1, 0, 1]))
    two = fit(np.array([[3.0], [0.5], [0.5], [0.5], [0.5]]), "after")
    (chart,) = size_panels([column(x)], [one, two], np.array([0, 2, 3]))
    assert chart.y.low == 0.0 and chart.y.high == pytest.approx(1.08 * 5.0)
    first, second = of(chart.layers, Marks)
    np.testing.assert_array_equal(first.x, [0.0, 2.0, 3.0])
    np.testing.assert_array_equal(first.y, [1.0, 5.0, 90.0])
    np.testing.assert_array_equal(second.y, [3.0, 0.5, 0.5])
    assert [m.by_row for m in (first, second)] == [True, True] and [m.shape for m in (first, second)] == [
        "stroke",
        "dot",
    ]
    (noise,) = of(chart.layers, Level)
    assert (noise.value, noise.axis, noise.dashed) == (1.0, "y", True)
    (small,) = size_panels([column(x)], [fit(np.full((5, 1), 0.2))], np.arange(5))
    assert small.y.high == pytest.approx(1.08)  # noise as stated is always in sight


def test_the_trend_is_told_to_those_who_do_not_see_the_chart() -> None:
    x = np.arange(6.0)
    up, even = np.array([[1.0], [2.0], [3.0], [4.0], [5.0], [NAN]]), np.ones((6, 1))
    down = np.array([[6.0], [5.0], [4.0], [3.0], [2.0], [1.0]])
    for fits, told in (
        ([up, down], "first series: correlation 1.00; second series: correlation -1.00"),
        ([up, even], "first series: correlation 1.00"),
        ([even, down], "second series: correlation -1.00"),
        ([even], ""),
    ):
        (chart,) = size_panels([column(x)], [fit(one) for one in fits], np.arange(6))
        assert chart.told == told
    (still,) = size_panels([column(np.ones(6))], [fit(up)], np.arange(6))
    few = np.where(np.arange(6)[:, None] < 2, up, NAN)
    (short,) = size_panels([column(x)], [fit(few)], np.arange(6))
    assert still.told == short.told == ""


def test_components_stand_at_their_driver_and_side_by_side_where_it_has_few_values() -> None:
    """With 20 values or fewer two fits are set apart, evenly about the value; one fit never is."""
    rng = np.random.default_rng(3)
    residual = rng.normal(size=(42, 3))
    groups = {"x": [0, 2], "y": [1]}
    steps, many = np.tile(np.linspace(0.0, 10.0, 20), 3)[:42], np.linspace(0.0, 10.0, 42)
    for values, dodge in ((steps, 0.22), (many, 0.0), (np.tile(np.linspace(0.0, 10.0, 21), 2), 0.0)):
        fits = [fit(residual), fit(2.0 * residual, "after")]
        first, second = component_panels(column(values), groups, fits, np.arange(42))
        assert (first.title, second.title) == ("x", "y")
        a, c, b, d = of(first.layers, Marks)
        for mark, side, own in (
            (a, -0.5, residual[:, 0]),
            (c, -0.5, residual[:, 2]),
            (b, 0.5, 2 * residual[:, 0]),
        ):
            np.testing.assert_allclose(mark.x, values + side * dodge, atol=1e-12)
            np.testing.assert_array_equal(mark.y, own)
            assert mark.by_row
        assert d.tone == b.tone == "after"
        assert (
            first.y.high
            == pytest.approx(max(3.5, 1.05 * 2 * np.max(np.abs(residual))))
            == -cast(float, first.y.low)
        )
        (zero,) = of(first.layers, Level)
        assert (zero.value, zero.axis, zero.dashed) == (0.0, "y", False)
        (alone,) = component_panels(column(values), {"y": [1]}, fits[:1], np.arange(42))
        np.testing.assert_array_equal(of(alone.layers, Marks)[0].x, values)
    (calm,) = component_panels(column(many), {"y": [1]}, [fit(0.1 * residual)], np.arange(42))
    assert calm.y.high == 3.5
    wild = residual.copy()
    wild[0] = 70.0
    (aside,) = component_panels(
        column(many), {"y": [1]}, [fit(wild, counts=np.arange(42) > 0)], np.arange(42)
    )
    assert cast(float, aside.y.high) < 10.0  # a row that does not count sets no scale


@pytest.mark.parametrize(("count", "bins"), [(400, 18), (401, 36), (3, 18), (0, 18)])
def test_a_histogram_is_a_density_beside_the_normal_one(count: int, bins: int) -> None:
    """Its area is one with everything beyond the ends in the last bars; so is the curve's."""
    values = np.random.default_rng(5).normal(scale=3.0, size=(count, 1))
    drawn, _ = distribution([fit(values)])
    (bars,), (curve,) = of(drawn.layers, Bars), of(drawn.layers, Line)
    assert bars.edges is not None and len(bars.length) == bins
    assert (bars.edges[0], bars.edges[-1]) == (-4.5, 4.5)
    assert np.sum(bars.length * np.diff(bars.edges)) == pytest.approx(1.0 if count else 0.0)
    assert np.trapezoid(curve.y, curve.x) == pytest.approx(1.0, abs=1e-4)
    assert curve.y[len(curve.y) // 2] == pytest.approx(np.max(curve.y)) and curve.dashed
    assert (drawn.title, drawn.y.low) == ("histogram, before", 0.0)


def test_the_normal_plot_of_normal_residuals_is_the_line() -> None:
    values = np.random.default_rng(6).normal(size=(20_000, 1))
    gone = np.vstack([values, [[NAN], [0.0]]])  # neither is a reading
    *_, plot = distribution([fit(gone), fit(2.0 * values, "after")])
    (line,) = of(plot.layers, Line)
    np.testing.assert_array_equal(line.x, line.y)
    assert line.x.tolist() == [-3.5, 3.5] and line.dashed and plot.x.high == -cast(float, plot.x.low) == 3.6
    one, two = of(plot.layers, Marks)
    assert len(one.x) == len(two.x) == 300
    inner = np.abs(one.x) < 2.0
    np.testing.assert_allclose(one.y[inner], one.x[inner], atol=0.08)
    np.testing.assert_allclose(two.y, 2.0 * one.y, atol=1e-9)
    np.testing.assert_allclose(one.x, -one.x[::-1], atol=0.01)  # as many above as below
    largest = 2.0 * np.max(np.abs(values))
    assert plot.y.high == pytest.approx(1.05 * largest) == -cast(float, plot.y.low)
    for scale, reach in ((0.1, 4.0), (900.0, 12.0)):
        assert distribution([fit(scale * values)])[-1].y.high == reach
    assert not of(distribution([fit(np.zeros((3, 1)))])[-1].layers, Marks)
    few = of(distribution([fit(np.array([[1.0], [-1.0]]))])[-1].layers, Marks)[0]
    np.testing.assert_allclose(few.x, [-0.6745, 0.6745], atol=1e-4)  # quartiles
    np.testing.assert_array_equal(few.y, [-1.0, 1.0])
