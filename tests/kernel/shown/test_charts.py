"""Laws of charts: axes show all that is known with round, distinct numbers; marks land where the axes say; always XML."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import Literal
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from support.examples import examples
from truepose.shown.chart import Axis, Band, Chart, Layer, Level, Line, Marks, Shape, legend
from truepose.shown.chart_svg import Scale, ends, svg, ticks

Array = NDArray[np.float64]
LAWS = settings(deadline=None, max_examples=examples(150))
ANY = st.floats(allow_nan=True, allow_infinity=True)
TAME = st.floats(-1e6, 1e6).map(lambda v: round(v, 6))
SHAPES: tuple[Shape, ...] = ("dot", "stroke", "ring", "tick")
BEGIN = {
    "dot": (0.0, 0.0),
    "stroke": (-3.0, 0.0),
    "tick": (0.0, 0.0),
    "ring": (-2.5, 0.0),
}
"""Where the path of a mark begins, from the mark, in pixels."""
NUMBER = r"-?\d+(?:\.\d+)?"


def several(n: int, values: st.SearchStrategy[float] = ANY) -> st.SearchStrategy[Array]:
    return arrays(np.float64, n, elements=values)


@st.composite
def layers(draw: st.DrawFn) -> Layer:
    """A layer of any kind with any numbers in it."""
    n, text = draw(st.integers(0, 5)), draw(st.text(max_size=8))
    x, y, z = (draw(several(n)) for _ in range(3))
    one = draw(ANY)
    kinds: list[Layer] = [
        Marks(x, y, "before", text, draw(st.sampled_from(SHAPES)), draw(st.booleans())),
        Line(x, y, "after", text, draw(st.booleans())),
        Band(x, y, z, "free", text),
        Level(one, draw(st.sampled_from(["x", "y"])), text),
    ]
    return draw(st.sampled_from(kinds))


@st.composite
def axes(draw: st.DrawFn) -> Axis:
    names = draw(st.lists(st.text(max_size=40), max_size=3))
    low, high = (draw(st.none() | ANY) for _ in range(2))
    return Axis(draw(st.text(max_size=9)), low, high, names)


@given(st.lists(layers(), max_size=4), axes(), axes(), st.text(max_size=9))
@LAWS
def test_any_chart_is_well_formed_and_writes_numbers_only(
    shown: list[Layer], x: Axis, y: Axis, title: str
) -> None:
    chart = Chart(title, x, y, shown)
    text = svg(chart)
    root = ET.fromstring(text)
    assert root.tag == "svg"
    for element in root.iter():
        for name in ("d", "x", "y", "width", "height", "transform", "fill-opacity"):
            assert not re.search("nan|inf", element.get(name, "")), element.attrib
        way = element.get("d", "")
        assert not way or way.startswith("M")
    assert svg(replace(chart)) == text


@given(st.lists(layers(), max_size=6))
@LAWS
def test_a_legend_has_each_name_once(shown: list[Layer]) -> None:
    x = Axis("")
    names = [name for _, _, name in legend([Chart("", x, x, shown), Chart("", x, x, shown)])]
    assert names == list(dict.fromkeys(one.name for one in shown if one.name))


@given(st.lists(several(4), max_size=3))
@LAWS
def test_an_axis_shows_all_that_is_known(values: list[Array]) -> None:
    low, high = ends(values, None, None)
    assert np.isfinite([low, high]).all() and low < high
    known = [v for part in values for v in part if abs(v) <= 1e300]
    assert all(low <= v <= high for v in known)
    assert ends(values, -2.0, 3.0) == (-2.0, 3.0)


def number(text: str) -> float:
    return float(text.replace("\u2212", "-"))


@given(several(2), st.integers(2, 9))
@LAWS
def test_ticks_are_round_inside_increasing_and_told_apart(values: Array, most: int) -> None:
    low, high = ends([values], None, None)
    found = ticks(low, high, most)
    places, texts = [value for value, _ in found], [text for _, text in found]
    assert 1 <= len(found) <= most + 1
    assert all(a < b for a, b in pairwise(places))
    slack = 1e-8 * (high - low)
    assert low - slack <= places[0] and places[-1] <= high + slack
    assert len(set(texts)) == len(texts)
    read = [number(text) for text in texts]
    np.testing.assert_allclose(read, places, rtol=1e-9, atol=1e-9 * (high - low))
    if len(read) > 1:
        exact = [Fraction(text.replace("\u2212", "-")) for text in texts]
        steps = {b - a for a, b in pairwise(exact)}
        assert len(steps) == 1, texts
        assert f"{float(steps.pop()):e}".split("e")[0] in ("1.000000", "2.000000", "2.500000", "5.000000")


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (0.0, 1.0, ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        (-1.0, 1.0, ["\u22121.0", "\u22120.5", "0", "0.5", "1.0"]),
        (101300.0, 101340.0, ["101300", "101310", "101320", "101330", "101340"]),
        (0.0, 4e-5, ["0", "1e\u22125", "2e\u22125", "3e\u22125", "4e\u22125"]),
        (0.0, 4e6, ["0", "1e6", "2e6", "3e6", "4e6"]),
        (20.00005, 20.00025, ["20.00005", "20.00010", "20.00015", "20.00020", "20.00025"]),
    ],
)
def test_numbers_read_well(low: float, high: float, said: list[str]) -> None:
    assert [text for _, text in ticks(low, high, 5)] == said


@given(st.tuples(TAME, TAME).filter(lambda v: v[1] - v[0] > 1e-3), several(5, TAME))
@LAWS
def test_a_scale_is_affine(span: tuple[float, float], values: Array) -> None:
    scale = Scale(*span, 30.0, 370.0)
    assert scale.at(span[0]) == 30.0 and scale.at(span[1]) == pytest.approx(370.0)
    assert scale.all(values).tolist() == [scale.at(v) for v in values.tolist()]
    middle = scale.at(0.5 * (span[0] + span[1]))
    assert middle == pytest.approx(200.0, abs=1e-6)


def path_of(root: ET.Element, kind: str) -> ET.Element:
    return next(one for one in root.iter("path") if kind in (one.get("class") or "").split())


def frame_of(root: ET.Element) -> tuple[float, float, float, float]:
    """Left, top, floor and right end of the axes."""
    found = re.fullmatch(rf"M({NUMBER}) ({NUMBER})V({NUMBER})H({NUMBER})", path_of(root, "axis").get("d", ""))
    assert found is not None
    left, top, floor, right = map(float, found.groups())
    return left, top, floor, right


@given(several(6, TAME | st.just(np.nan)), several(6, TAME | st.just(np.nan)), st.sampled_from(SHAPES))
@LAWS
def test_the_kth_mark_is_the_kth_row_and_stands_where_the_axes_say(x: Array, y: Array, shape: Shape) -> None:
    chart = Chart("", Axis("x"), Axis("y"), [Marks(x, y, "after", 'a <b> & "c"', shape, by_row=True)])
    root = ET.fromstring(svg(chart))
    marks = path_of(root, "marks")
    assert marks.get("data-rows") == "" and marks.get("data-name") == 'a <b> & "c"'
    begun = re.findall(rf"M({NUMBER}) ({NUMBER})", marks.get("d", ""))
    assert len(begun) == len(x)
    left, top, floor, right = frame_of(root)
    across, up = Scale(*ends([x], None, None), left, right), Scale(*ends([y], None, None), floor, top)
    off = BEGIN[shape]
    for (a, b), u, v in zip(begun, x.tolist(), y.tolist(), strict=True):
        place = np.array([float(a), float(b)]) - off
        if np.isfinite([u, v]).all():
            np.testing.assert_allclose(place, [across.at(u), up.at(v)], atol=0.11)
            assert left - 0.11 <= place[0] <= right + 0.11 and top - 0.11 <= place[1] <= floor + 0.11
        else:
            assert place[0] < 0  # out of sight, but there: it keeps its number


@given(several(7, st.floats(0.0, 5.0) | st.just(np.nan)))
@LAWS
def test_a_band_is_closed_about_each_known_stretch(y: Array) -> None:
    x = np.arange(7.0)
    way = svg(Chart("", Axis(""), Axis(""), [Band(x, y, y + 1, "free")]))
    known = np.isfinite(y)
    stretches = int(np.sum(np.diff(np.concatenate([[0], known.astype(int)])) == 1))
    found = re.search(r'class="band t-free" d="([^"]*)"', way)
    parts = found[1].split("Z")[:-1] if found else []
    assert len(parts) == stretches
    assert sum(len(re.findall("[ML]", part)) for part in parts) == 2 * int(known.sum())
    assert all(part.count("M") == 1 for part in parts)


@pytest.mark.parametrize("value", [2.0, 0.0, 4.0, 5.732439843310956e305, -1.0, float("inf"), float("nan")])
@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_level_is_drawn_within_its_axis_alone(value: float, axis: Literal["x", "y"]) -> None:
    ends_of = Axis("", 0.0, 4.0)
    root = ET.fromstring(svg(Chart("", ends_of, ends_of, [Level(value, axis)])))
    assert len([one for one in root.iter("path") if "level" in (one.get("class") or "")]) == (
        0.0 <= value <= 4.0
    )


@given(several(9, st.floats(-40.0, 40.0) | st.just(np.nan)))
@LAWS
def test_a_line_goes_through_its_points_however_it_is_written(y: Array) -> None:
    x = np.arange(9.0)
    root = ET.fromstring(svg(Chart("", Axis("", 0.0, 8.0), Axis("", -40.0, 40.0), [Line(x, y, "after")])))
    left, top, floor, right = frame_of(root)
    places = re.findall(rf"[ML]({NUMBER}) ({NUMBER})", path_of(root, "line").get("d", ""))
    found = [(float(a), float(b)) for a, b in places]
    known = np.isfinite(y)
    across, up = Scale(0.0, 8.0, left, right), Scale(-40.0, 40.0, floor, top)
    expected = np.column_stack([across.all(x[known]), up.all(y[known])])
    np.testing.assert_allclose(np.array(found).reshape(-1, 2), expected, atol=0.11)
