"""Figures of a report: the numbers themselves are drawn, on scales that hold them and beside what they are judged by."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from support.reports import NAN, of, summary
from truepose.identification.diagnosis.result import Proof
from truepose.identification.report.curves import Curve
from truepose.identification.report.figures.effects import curve_charts, matrix
from truepose.identification.report.figures.evidence import evidence_map, squeeze
from truepose.identification.report.figures.fit import fit_bars, proof_plot
from truepose.identification.report.figures.parameters import Departures, correlation_map, dot_plot
from truepose.identification.report.fits import FitColumn
from truepose.shown.chart import Band, Bars, Cells, Level, Line, Marks, Span

Array = NDArray[np.float64]


# -- fits and proofs -----------------------------------------------------------------------------------


def fitted(name: str, sigma: tuple[float | None, float | None], rms: float, held: float | None) -> FitColumn:
    own = replace(
        summary(1.0, 1.0), rms={"position": rms}, validation_rms=None if held is None else {"position": held}
    )
    return FitColumn(name, name, name, sigma, own)


def test_bars_of_fits_stand_beside_the_stated_noise() -> None:
    columns = [fitted("free", (1.0, 1.5), 0.010, 0.015), fitted("before", (3.0, NAN), 0.030, 0.040)]
    sigmas, position = fit_bars(columns, {"position": 0.0173}, {"position": "mm"})
    calibration, validation = of(sigmas.layers, Bars)
    np.testing.assert_array_equal(calibration.length, [1.0, 3.0])
    np.testing.assert_array_equal(validation.length, [1.5])
    np.testing.assert_allclose(cast(Array, calibration.at), [-0.18, 0.82])
    np.testing.assert_allclose(cast(Array, validation.at), [0.18])
    assert [level.value for level in of(sigmas.layers, Level)] == [1.0] and sigmas.x.high == pytest.approx(
        1.25 * 3.0
    )
    assert position.x.title == "rms residual [µm]" and position.x.low == 0.0
    np.testing.assert_allclose(of(position.layers, Bars)[0].length, [10.0, 30.0])
    np.testing.assert_allclose(of(position.layers, Bars)[1].length, [15.0, 40.0])
    assert of(position.layers, Bars)[1].texts == ["15.0", "40.0"]
    assert of(position.layers, Level)[0].value == pytest.approx(17.3)
    assert position.x.high == pytest.approx(1.25 * 40.0)
    assert list(position.y.names) == ["free", "before"]


def test_bars_alone_stand_on_their_line() -> None:
    columns = [fitted("free", (0.5, None), 0.001, None)]
    sigmas, position = fit_bars(columns, {"position": 0.0173}, {"position": "mm"})
    (bars,) = of(sigmas.layers, Bars)
    np.testing.assert_array_equal(cast(Array, bars.at), [0.0])
    assert sigmas.x.high == 1.25 and position.x.high == pytest.approx(1.25 * 17.3)  # the noise is in sight
    hollow = [fitted("free", (None, None), NAN, None)]
    for chart in fit_bars(hollow, {}, {"position": "mm"}):
        assert not of(chart.layers, Bars)
    (_, bare) = fit_bars(hollow, {}, {"position": "mm"})
    assert not of(bare.layers, Level) and bare.x.high == 1.25


def test_panels_grow_by_a_line_for_each_fit() -> None:
    fits = [fitted(name, (1.0, None), 0.01, None) for name in ("free", "before", "after")]
    noise, own = {"position": 0.0173}, {"position": "mm"}
    heights = [[chart.height for chart in fit_bars(fits[:n], noise, own)] for n in (1, 2, 3)]
    assert heights == [[64.0 + 36.0 * n] * 2 for n in (1, 2, 3)]
    proof = Proof("role", (), 0.4, (0.3, 0.5), None, None, None)
    assert [proof_plot(replace(proof, black_box_ratio=box)).height for box in (None, 0.8)] == [94.0, 124.0]


def test_kinds_of_reading_have_a_panel_each_whichever_fit_has_them() -> None:
    """A fit without a kind has no bar there, and the unit is that of the largest that is known."""
    one, two = fitted("free", (1.0, None), 0.5, None), fitted("after", (2.0, None), 3.0, None)
    two = replace(two, summary=replace(two.summary, rms={"position": 3.0, "rotation": 2e-3}))
    _, position, rotation = fit_bars([one, two], {}, {"position": "mm", "rotation": "rad"})
    assert position.x.title == "rms residual [mm]" and rotation.x.title == "rms residual [µrad]"
    np.testing.assert_array_equal(of(position.layers, Bars)[0].length, [0.5, 3.0])
    (bars,) = of(rotation.layers, Bars)
    np.testing.assert_allclose(bars.length, [2000.0])
    np.testing.assert_array_equal(cast(Array, bars.at), [1.0])
    lost = fitted("free", (1.0, None), NAN, None)
    (_, blank) = fit_bars([lost], {"position": 0.5}, {"position": "mm"})
    assert blank.x.title == "rms residual [mm]" and of(blank.layers, Level)[0].value == 0.5


@pytest.mark.parametrize(
    ("ratio", "interval", "box", "top"),
    [
        (0.4, (0.3, 0.5), 0.8, 1.0),
        (0.4, (0.3, 2.0), 0.8, 2.0),
        (0.4, (0.3, 0.5), 3.0, 3.0),
        (0.4, (NAN, NAN), None, 1.0),
    ],
)
def test_a_proof_is_drawn_beside_a_black_box(
    ratio: float, interval: tuple[float, float], box: float | None, top: float
) -> None:
    chart = proof_plot(Proof("role", (), ratio, interval, None, box, None))
    bars = of(chart.layers, Bars)
    assert [bar.length.tolist() for bar in bars] == ([[ratio]] if box is None else [[ratio], [box]])
    assert [cast(Array, bar.at).tolist() for bar in bars] == [[0.0], [1.0]][: len(bars)]
    assert list(chart.y.names) == ["named physics", "black box"][: len(bars)]
    (ends,) = of(chart.layers, Marks)
    np.testing.assert_array_equal(ends.x, interval)
    np.testing.assert_array_equal(ends.y, [0.0, 0.0])
    assert chart.x.low == 0.0 and chart.x.high == pytest.approx(1.15 * top)
    assert [level.value for level in of(chart.layers, Level)] == [1.0]


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


def test_a_map_of_correlations_leaves_out_what_each_is_with_itself() -> None:
    whole = np.array([[1.0, -0.5], [-0.5, 1.0]])
    chart = correlation_map(["short", "a-very-long-name-of-a-constant"], whole)
    (cells,) = of(chart.layers, Cells)
    np.testing.assert_array_equal(cells.values, [[0.0, -0.5], [-0.5, 0.0]])
    assert cells.largest == 1.0
    assert list(chart.x.names) == list(chart.y.names) == ["short", "a-ver\u2026onstant"]
    thirteen = "x" * 13
    assert next(iter(correlation_map([thirteen, "b"], whole).x.names)) == thirteen
    heights = [correlation_map(["a"] * n, np.eye(n)).height for n in (2, 5, 6, 10, 20)]
    assert heights[0] == heights[1] == 180.0 and heights[3] - heights[2] == 4 * 15.5
    assert heights[4] - heights[3] == 10 * 15.5


# -- evidence and effects ------------------------------------------------------------------------------


def test_evidence_is_squeezed_alike_on_both_sides_of_zero() -> None:
    values = np.array([0.0, 0.5, 3.0, 99.0, 1e6])
    squeezed = np.array([squeeze(v) for v in values])
    assert squeezed[0] == 0.0 and squeezed[3] == pytest.approx(2.0) and (np.diff(squeezed) > 0).all()
    np.testing.assert_array_equal([squeeze(-v) for v in values], -squeezed)


def test_evidence_is_drawn_best_first_and_places_of_findings_stand_out() -> None:
    evidence = {f"q{k}": float(k) for k in range(30)} | {"base": NAN, "tool": float("-inf")}
    chart = evidence_map(evidence, {"q29", "q12"})
    assert list(chart.y.names) == [f"q{k}" for k in range(29, 5, -1)]
    named, others = of(chart.layers, Bars)
    assert (named.name, others.name) == ("place of a finding", "other places")
    assert cast(Array, named.at).tolist() == [0.0, 17.0]
    np.testing.assert_allclose(named.length, [squeeze(29.0), squeeze(12.0)])
    assert list(named.texts) == ["29.0", "12.0"]
    assert len(others.length) == 22 and 0.0 not in cast(Array, others.at)
    assert [level.value for level in of(chart.layers, Level)] == [0.0, pytest.approx(squeeze(3.0))]
    low, high = cast(float, chart.x.low), cast(float, chart.x.high)
    span = squeeze(29.0) - squeeze(-1.0)
    assert low == pytest.approx(squeeze(-1.0) - 0.03 * span)
    assert high == pytest.approx(squeeze(29.0) + 0.1 * span)
    assert [text for _, text in chart.x.ticks] == ["\u22121", "0", "3", "10"]
    only = evidence_map({"q1": -400.0, "q2": 0.5}, set())
    assert len(of(only.layers, Bars)) == 1
    ticks = only.x.ticks
    assert [text for _, text in ticks] == [
        "\u2212100",
        "\u221210",
        "\u22121",
        "3",
    ]  # 0 would touch its neighbours
    for value, text in ticks:
        assert value == pytest.approx(squeeze(float(text.replace("\u2212", "-"))))
    huge = [text for _, text in evidence_map({"q1": 9e5}, set()).x.ticks]
    assert huge[-1] == "1,000,000" and "100,000" in huge
    assert (
        evidence_map({f"q{k}": 1.0 for k in range(9)}, ()).height - evidence_map({"q": 1.0}, ()).height
        == 6 * 19.0
    )


def test_ticks_of_evidence_keep_apart_and_within_its_range() -> None:
    """At least 0.13 of the range between two; none far beyond the ends."""
    for low, high in ((-0.5, 2.0), (-5.0, 50.0), (-3000.0, 7.0), (-0.1, 3e5)):
        chart = evidence_map({"a": low, "b": high}, ())
        ends = squeeze(min(low, -1.0)), squeeze(max(high, 3.0))
        at = np.array([value for value, _ in chart.x.ticks])
        assert len(at) >= 2 and np.min(np.diff(at)) > 0.13 * (ends[1] - ends[0])
        assert at[0] >= ends[0] - 1e-12 and at[-1] <= squeeze(1.5 * max(high, 3.0))
    assert [text for _, text in evidence_map({"a": 70.0}, ()).x.ticks][-1] == "100"  # 70 is two thirds of it
    assert [text for _, text in evidence_map({"a": 60.0}, ()).x.ticks][-1] == "10"


@pytest.mark.parametrize("power", range(7))
def test_every_power_of_ten_has_its_tick(power: int) -> None:
    """Up to a million; below zero to a thousand."""
    size = 10.0**power
    *_, (at, text) = evidence_map({"a": size}, ()).x.ticks
    assert (at, text) == ((squeeze(size), f"{size:,.0f}") if power else (squeeze(3.0), "3"))
    (at, text), *_ = evidence_map({"a": -size}, ()).x.ticks
    assert (at, text) == (squeeze(-min(size, 1e3)), f"\u2212{min(size, 1e3):,.0f}")


def test_a_map_without_evidence_has_its_axis_and_room_for_three() -> None:
    charts = [evidence_map({f"q{k}": 1.0 for k in range(count)}, ()) for count in (0, 1, 3, 4)]
    assert [chart.height for chart in charts] == [127.0, 127.0, 127.0, 146.0]
    for chart in charts:
        zero, notable = of(chart.layers, Level)
        assert (zero.value, zero.axis, zero.dashed) == (0.0, "x", False)
        assert (notable.axis, notable.dashed, notable.tone) == ("x", True, "accent")
    assert not of(charts[0].layers, Bars)


def curve(**more: Any) -> Curve:
    x = np.linspace(0.0, 10.0, 11)
    plain = Curve(
        x, 2.0 * x, np.full(11, 0.5), np.array([1.0, 4.0]), "q1 [°]", "shift [µm]", "displacement of q1"
    )
    return replace(plain, **more)


def test_a_function_is_drawn_with_its_95_per_cent_band_and_what_rows_say() -> None:
    rows = np.array([2.5, NAN])
    (chart,) = curve_charts([curve(rows=rows)])
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
    (scattered,) = curve_charts([curve(x=empty, y=empty, std=empty, rows=rows, fitted=np.array([2.0, 8.0]))])
    assert not of(scattered.layers, Band) and not of(scattered.layers, Line)
    assert [mark.name for mark in of(scattered.layers, Marks)] == ["each row", "identified, in each row"]
    (bare,) = curve_charts([curve()])
    (ticks,) = of(bare.layers, Marks)
    assert ticks.shape == "tick" and bare.y.low is bare.y.high is None
    np.testing.assert_allclose(ticks.y, -0.98)
    np.testing.assert_array_equal(ticks.x, [1.0, 4.0])


def test_lines_and_bands_stand_in_their_order_from_below() -> None:
    """Zero, the band, rows, the function: what is above hides what is below; the fit's own rows come last."""
    (full,) = curve_charts([curve(rows=np.array([2.5, 8.0]), fitted=np.array([2.0, 8.0]))])
    assert [type(layer) for layer in full.layers] == [Level, Band, Marks, Line, Marks]
    zero = full.layers[0]
    assert isinstance(zero, Level) and (zero.value, zero.axis, zero.dashed) == (0.0, "y", False)
    rows, fitted_rows = of(full.layers, Marks)
    assert rows.by_row and fitted_rows.by_row and (rows.tone, fitted_rows.tone) == ("before", "after")
    np.testing.assert_array_equal(fitted_rows.y, [2.0, 8.0])
    np.testing.assert_array_equal(fitted_rows.x, [1.0, 4.0])
    assert len(curve_charts([curve()] * 3)) == 3 and curve_charts([]) == []


def test_a_function_below_zero_has_its_scale_and_its_ticks_below() -> None:
    x = np.linspace(0.0, 10.0, 11)
    below = curve(y=-2.0 * x - 3.0)
    (bare,) = curve_charts([below])
    (ticks,) = of(bare.layers, Marks)
    np.testing.assert_allclose(ticks.y, -23.0 - 0.98)
    (told,) = curve_charts([replace(below, rows=np.array([-5.0, -11.0]))])
    assert told.y.low == pytest.approx(-23.98 - 0.08 * 23.98) and told.y.high == pytest.approx(0.08 * 23.98)
    above = curve(y=2.0 * x + 3.0)
    np.testing.assert_allclose(of(curve_charts([above])[0].layers, Marks)[0].y, 0.0)


def test_a_scale_of_rows_leaves_out_the_wildest() -> None:
    rows = np.concatenate([np.linspace(-50.0, 50.0, 999), [1e6]])
    measured = np.linspace(0.0, 10.0, 1000)
    (chart,) = curve_charts([curve(rows=rows, measured=measured)])
    assert chart.y.high == pytest.approx(49.1 + 0.08 * 98.1, abs=0.2) and chart.y.low == pytest.approx(
        -49.0 - 0.08 * 98.1, abs=0.2
    )
    nothing = np.full(1000, NAN)
    (flat,) = curve_charts(
        [curve(x=np.zeros(0), y=np.zeros(0), std=np.zeros(0), rows=nothing, measured=measured)]
    )
    assert flat.y.low == -1.0 and flat.y.high == 1.0


@pytest.mark.parametrize(("columns", "texts"), [(8, True), (9, False)])
def test_a_matrix_has_its_numbers_where_there_is_room(columns: int, texts: bool) -> None:
    values = np.arange(2.0 * columns).reshape(2, columns)
    chart = matrix("t", values, ["a", "b"], [f"q{k}" for k in range(columns)], ("across", "up"))
    (cells,) = of(chart.layers, Cells)
    np.testing.assert_array_equal(cells.values, values)
    assert [list(line) for line in cells.texts] == (
        [[f"{v:.2g}" for v in line] for line in values] if texts else []
    )
    assert (chart.x.title, chart.y.title) == ("across", "up") and list(chart.y.names) == ["a", "b"]
    many = [
        matrix("t", np.zeros((n, columns)), ["a"] * n, ["q"] * columns, ("", "")).height
        for n in (2, 4, 5, 12, 24)
    ]
    line = 22.0 if texts else 25.0
    assert (
        many[0] == many[1]
        and many[2] - many[1] == pytest.approx(line)
        and many[3] == pytest.approx(70.0 + 12 * line)
    )
    assert many[4] == pytest.approx(70.0 + (24 * 22.0 if texts else 300.0))  # a large one keeps its size
