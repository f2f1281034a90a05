"""Figures of residuals: rows drawn as they are, sizes by driver, distributions beside normal ones."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from support.reports import NAN, of
from truepose.identification.recording.recording import Recording
from truepose.identification.report.drivers import Column
from truepose.identification.report.residuals import (
    Drawn,
    component_panels,
    normal_plot,
    row_sizes,
    size_chart,
)
from truepose.shown.chart import Level, Line, Marks, Tone

Array = NDArray[np.float64]


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
    rows = cast(Recording, range(5))
    one = fit(np.array([[1.0], [2.0], [5.0], [90.0], [NAN]]), counts=np.array([1, 1, 1, 0, 1]))
    two = fit(np.array([[3.0], [0.5], [0.5], [0.5], [0.5]]), "after")
    chart = size_chart(rows, [one, two], np.array([0, 2, 3]))
    assert chart.y.low == 0.0 and chart.y.high == pytest.approx(1.08 * 5.0)
    first, second = of(chart.layers, Marks)
    np.testing.assert_array_equal(first.x, [1.0, 3.0, 4.0])
    np.testing.assert_array_equal(first.y, [1.0, 5.0, 90.0])
    np.testing.assert_array_equal(second.y, [3.0, 0.5, 0.5])
    assert [m.by_row for m in (first, second)] == [True, True] and [m.shape for m in (first, second)] == [
        "stroke",
        "dot",
    ]
    (noise,) = of(chart.layers, Level)
    assert (noise.value, noise.axis, noise.dashed) == (1.0, "y", True)
    small = size_chart(rows, [fit(np.full((5, 1), 0.2))], np.arange(5))
    assert small.y.high == pytest.approx(1.08)  # noise as stated is always in sight


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


def test_the_normal_plot_of_normal_residuals_is_the_line() -> None:
    values = np.random.default_rng(6).normal(size=(20_000, 1))
    gone = np.vstack([values, [[NAN], [0.0]]])  # neither is a reading
    plot = normal_plot([fit(gone), fit(2.0 * values, "after")])
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
        assert normal_plot([fit(scale * values)]).y.high == reach
    assert not of(normal_plot([fit(np.zeros((3, 1)))]).layers, Marks)
    few = of(normal_plot([fit(np.array([[1.0], [-1.0]]))]).layers, Marks)[0]
    np.testing.assert_allclose(few.x, [-0.6745, 0.6745], atol=1e-4)  # quartiles
    np.testing.assert_array_equal(few.y, [-1.0, 1.0])
