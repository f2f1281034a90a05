"""Figures of a report: the numbers themselves are drawn, on scales that hold them and beside what they are judged by."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from support.reports import NAN, of
from truepose.identification.report.constants import Departures, dot_plot
from truepose.identification.report.curves import Curve
from truepose.identification.report.finding_cards import curve_chart
from truepose.shown.chart import Band, Level, Line, Marks, Span

Array = NDArray[np.float64]


# -- constants -----------------------------------------------------------------------------------------


def test_constants_are_drawn_farthest_first_twenty_a_panel_sixty_at_most() -> None:
    size = 70
    away = np.random.default_rng(8).permutation(np.arange(1.0, size + 1.0)) / 20.0
    names = [f"c{k}" for k in range(size)]
    free = Departures("free fit", "free", "tick", 100.0 * away[::-1], clipped=True)
    own = Departures("calibrated", "after", "dot", -away)
    charts = dot_plot(names, [free, own], 3.1)
    order = np.argsort(-away)[:60]
    assert [len(chart.y.names) for chart in charts] == [20, 20, 20]
    assert [name for chart in charts for name in chart.y.names] == [names[k] for k in order]
    reach = 1.12 * 3.5
    for k, chart in enumerate(charts):
        rows = order[20 * k : 20 * k + 20]
        clipped, mine = of(chart.layers, Marks)
        np.testing.assert_allclose(mine.x, -away[rows])
        np.testing.assert_array_equal(mine.y, np.arange(20))
        np.testing.assert_allclose(clipped.x, np.clip(100.0 * away[::-1][rows], None, 0.99 * reach))
        assert chart.x.high == pytest.approx(reach) == -cast(float, chart.x.low)
        assert sorted(level.value for level in of(chart.layers, Level)) == [-3.1, 0.0, 3.1]
        assert [(span.low, span.high) for span in of(chart.layers, Span)] == [(-1.0, 1.0)]


@pytest.mark.parametrize(
    ("values", "allowed", "reach"),
    [(0.1, None, 2.0), (0.1, 3.0, 3.0), (5.0, 3.0, 5.0), (0.1, NAN, 2.0), (NAN, None, 2.0)],
)
def test_the_scale_of_constants_holds_what_is_allowed_and_what_is_there(
    values: float, allowed: float | None, reach: float
) -> None:
    (chart,) = dot_plot(["a"], [Departures("x", "after", "dot", np.array([-values]))], allowed)
    assert chart.x.high == pytest.approx(1.12 * reach)
    limits = [level for level in of(chart.layers, Level) if level.value != 0.0]
    assert len(limits) == (2 if allowed == 3.0 else 0)
    taller = dot_plot(["a", "b"], [Departures("x", "after", "dot", np.array([1.0, 2.0]))], allowed)[0]
    assert taller.height - chart.height == 17.0  # a line's height


def test_what_is_missing_of_a_fit_moves_no_constant_on_its_scale() -> None:
    """Rank by the largest of all fits that are not clipped; equal ones keep their order."""
    one = Departures("a", "before", "dot", np.array([0.5, -3.0, NAN, 0.5]))
    two = Departures("b", "after", "dot", np.array([0.1, 0.2, 1.0, -0.1]))
    (chart,) = dot_plot(["w", "x", "y", "z"], [one, two], None)
    assert list(chart.y.names) == ["x", "y", "w", "z"]
    assert chart.x.high == pytest.approx(1.12 * 3.0) and chart.height == 62.0 + 4 * 17.0
    (zero,) = of(chart.layers, Level)
    assert (zero.value, zero.axis, zero.dashed) == (0.0, "x", False)
    rounding = Departures("c", "after", "dot", np.array([1.0, 1.0 + 1e-9]))
    assert list(dot_plot(["p", "q"], [rounding], None)[0].y.names) == ["p", "q"]
    clipped = Departures("free", "free", "tick", np.array([-900.0, 0.0, 0.0, 0.0]), clipped=True)
    shown = of(dot_plot(["w", "x", "y", "z"], [clipped, two], None)[0].layers, Marks)[0].x
    assert np.min(shown) == pytest.approx(-0.99 * 1.12 * 2.0)


@pytest.mark.parametrize(
    ("count", "panels"), [(20, [20]), (21, [20, 1]), (60, [20, 20, 20]), (61, [20, 20, 20])]
)
def test_constants_fill_one_panel_after_another(count: int, panels: list[int]) -> None:
    own = Departures("x", "after", "dot", np.linspace(3.0, 1.0, count))
    charts = dot_plot([f"c{k}" for k in range(count)], [own], None)
    assert [len(chart.y.names) for chart in charts] == panels


# -- what findings add ---------------------------------------------------------------------------------


def curve(**more: Any) -> Curve:
    x = np.linspace(0.0, 10.0, 11)
    plain = Curve(
        x, 2.0 * x, np.full(11, 0.5), np.array([1.0, 4.0]), "q1 [°]", "shift [µm]", "displacement of q1"
    )
    return replace(plain, **more)


def test_a_function_is_drawn_with_its_95_per_cent_band_and_what_rows_say() -> None:
    rows = np.array([2.5, NAN])
    chart = curve_chart(curve(rows=rows))
    (band,), (line,), (marks,) = of(chart.layers, Band), of(chart.layers, Line), of(chart.layers, Marks)
    np.testing.assert_allclose(band.high - line.y, 1.96 * 0.5)
    np.testing.assert_allclose(line.y - band.low, 1.96 * 0.5)
    np.testing.assert_array_equal(line.y, 2.0 * line.x)
    np.testing.assert_array_equal(marks.y, rows)
    assert marks.by_row and (chart.title, chart.x.title) == ("displacement of q1", "q1 [°]")
    low, high = -0.98, 20.98
    room = 0.08 * (high - low)
    assert chart.y.low == pytest.approx(low - room) and chart.y.high == pytest.approx(high + room)
    empty = np.zeros(0)
    scattered = curve_chart(curve(x=empty, y=empty, std=empty, rows=rows, fitted=np.array([2.0, 8.0])))
    assert not of(scattered.layers, Band) and not of(scattered.layers, Line)
    assert [mark.name for mark in of(scattered.layers, Marks)] == ["each row", "identified, in each row"]
    assert not of(curve_chart(curve()).layers, Marks)


def test_lines_and_bands_stand_in_their_order_from_below() -> None:
    """Zero, the band, rows, the function: what is above hides what is below; the fit's own rows come last."""
    full = curve_chart(curve(rows=np.array([2.5, 8.0]), fitted=np.array([2.0, 8.0])))
    assert [type(layer) for layer in full.layers] == [Level, Band, Marks, Line, Marks]
    rows, fitted_rows = of(full.layers, Marks)
    assert rows.by_row and fitted_rows.by_row and (rows.tone, fitted_rows.tone) == ("before", "after")
    np.testing.assert_array_equal(fitted_rows.y, [2.0, 8.0])


def test_a_scale_of_rows_leaves_out_the_wildest() -> None:
    rows = np.concatenate([np.linspace(-50.0, 50.0, 999), [1e6]])
    measured = np.linspace(0.0, 10.0, 1000)
    chart = curve_chart(curve(rows=rows, measured=measured))
    assert chart.y.high == pytest.approx(49.1 + 0.08 * 98.1, abs=0.2)
    assert chart.y.low == pytest.approx(-49.0 - 0.08 * 98.1, abs=0.2)
    empty = np.zeros(0)
    flat = curve_chart(curve(x=empty, y=empty, std=empty, rows=np.full(1000, NAN), measured=measured))
    assert flat.y.low == -1.0 and flat.y.high == 1.0
