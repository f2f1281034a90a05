"""Axes of charts: ends that leave room, ticks as many as there is room for, names that are cut or stand on end."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from truepose.shown.chart import Axis, Band, Bars, Cells, Chart, Layer, Level, Line, Marks, Span
from truepose.shown.chart_axes import WIDTH
from truepose.shown.chart_svg import svg
from truepose.shown.scale import ends, ticks, written

NUMBER = r"-?\d+(?:\.\d+)?"
LETTER = 6.6
"""Width of a letter, about, at the font's 12 px."""
NONE = np.zeros(0)


def drawn(*layers: Layer, x: Axis | None = None, y: Axis | None = None, **more: Any) -> ET.Element:
    return ET.fromstring(svg(Chart("", x or Axis("across"), y or Axis("up"), layers, **more)))


def frame(root: ET.Element) -> tuple[float, float, float, float]:
    """Left, top, floor and right."""
    (way,) = [one.get("d", "") for one in root.iter("path") if one.get("class") == "axis"]
    found = re.fullmatch(rf"M({NUMBER}) ({NUMBER})V({NUMBER})H({NUMBER})", way)
    assert found is not None
    left, top, floor, right = map(float, found.groups())
    return left, top, floor, right


def texts(root: ET.Element, anchor: str) -> list[tuple[float, float, str]]:
    return [
        (float(one.get("x", "nan")), float(one.get("y", "nan")), one.text or "")
        for one in root.iter("text")
        if one.get("text-anchor") == anchor and one.get("class") is None and one.get("x")
    ]


@pytest.mark.parametrize(
    ("values", "low", "high", "expected"),
    [
        ([0.0, 10.0], None, None, (-0.4, 10.4)),
        ([0.0, 10.0], 0.0, None, (0.0, 10.4)),
        ([0.0, 10.0], None, 20.0, (-0.4, 20.0)),
        ([5.0, 5.0], None, None, (2.5, 7.5)),
        ([-5.0], None, None, (-7.5, -2.5)),
        ([0.0], None, None, (-0.5, 0.5)),
        ([], None, None, (-0.04, 1.04)),
        ([], 3.0, None, (1.5, 4.5)),
        ([5.0], None, 2.0, (1.0, 3.0)),
        ([5.0], 9.0, 4.0, (4.5, 13.5)),
        ([1.0, np.inf, np.nan, 3.0], None, None, (0.92, 3.08)),
        ([0.0, 10.0], np.nan, np.inf, (-0.4, 10.4)),
        ([1.0, 1.0 + 1e-12], None, None, (0.5, 1.5)),
    ],
)
def test_an_axis_leaves_a_twenty_fifth_free_and_never_ends_where_it_begins(
    values: list[float], low: float | None, high: float | None, expected: tuple[float, float]
) -> None:
    assert ends([np.array(values)], low, high) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    if not values:
        assert ends([], low, high) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("value", "step", "said"),
    [
        (0.0, 1.0, "0"), (0.5, 0.25, "0.5"), (0.25, 0.25, "0.25"), (2.0, 1.0, "2"), (2.5, 2.5, "2.5"), (250.0, 250.0, "250"),
        (99000.0, 1000.0, "99000"), (100000.0, 1000.0, "1e5"), (101000.0, 1000.0, "1.01e5"), (100000.0, 100.0, "100000"),
        (-200000.0, 50000.0, "\u22122e5"), (0.005, 0.0001, "0.0050"), (0.005, 0.00005, "5e\u22123"),
        (0.01005, 0.00005, "0.01005"), (-0.5, 0.5, "\u22120.5"), (1e-7, 1e-7, "1e\u22127"), (2.5e-7, 2.5e-7, "2.5e\u22127"),
    ],
)  # fmt: skip
def test_a_tick_has_as_many_decimals_as_its_step(value: float, step: float, said: str) -> None:
    assert written(value, step) == said


@pytest.mark.parametrize(
    ("most", "step"),
    [(1, 10.0), (2, 5.0), (3, 5.0), (4, 2.5), (5, 2.0), (9, 2.0), (10, 1.0), (20, 0.5), (100, 0.1)],
)
def test_ticks_are_as_close_as_their_number_allows(most: int, step: float) -> None:
    found = [value for value, _ in ticks(0.0, 10.0, most)]
    np.testing.assert_allclose(found, np.arange(0.0, 10.0 + step / 2, step), atol=1e-9)
    shifted = [value for value, _ in ticks(0.3, 9.8, most)]
    assert all(0.3 <= value <= 9.8 for value in shifted)


LAYERS: list[tuple[Layer, tuple[float, float] | None, tuple[float, float] | None]] = [
    (Marks(np.array([1.0, 2.0]), np.array([3.0, 5.0]), "ink"), (1, 2), (3, 5)),
    (Marks(np.array([1.0, 2.0]), np.array([3.0, 5.0]), "ink", error=np.array([1.0, 2.0])), (1, 2), (2, 7)),
    (Line(np.array([1.0, 2.0]), np.array([3.0, 5.0]), "ink"), (1, 2), (3, 5)),
    (Band(np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.array([5.0, 9.0]), "ink"), (1, 2), (3, 9)),
    (Bars(np.array([3.0, 5.0]), np.array([0.0, 1.0]), "ink"), (0, 5), None),
    (Level(7.0, "y"), None, (3.5, 10.5)),
    (Level(7.0, "x"), (3.5, 10.5), None),
]


@pytest.mark.parametrize(("layer", "across", "up"), LAYERS)
def test_axes_hold_what_each_kind_of_layer_shows(
    layer: Layer, across: tuple[float, float] | None, up: tuple[float, float] | None
) -> None:
    """What is beside a probe of known ends stands where the ends say."""
    names = ("a", "b") if isinstance(layer, Bars) else ()
    root = drawn(layer, y=Axis("up", names=names))
    left, top, floor, right = frame(root)
    grids = [one.get("d", "") for one in root.iter("path") if one.get("class") == "grid"]
    upright = [float(m[1]) for d in grids if (m := re.fullmatch(rf"M({NUMBER}) {NUMBER}V{NUMBER}", d))]
    level = [float(m[1]) for d in grids if (m := re.fullmatch(rf"M{NUMBER} ({NUMBER})H{NUMBER}", d))]
    for wanted, places, said, start, end in (
        (across, upright, texts(root, "middle"), left, right),
        (up, level, texts(root, "end"), floor, top),
    ):
        if wanted is None or not places:
            continue
        low, high = wanted
        if not (isinstance(layer, Level)):
            room = 0.04 * (high - low)
            low, high = low - room, high + room
        values = [float(text.replace("\u2212", "-")) for _, _, text in said if text not in ("across", "up")]
        expected = [start + (end - start) * (value - low) / (high - low) for value in values]
        np.testing.assert_allclose(places, expected, atol=0.06)


def test_the_frame_leaves_room_for_the_numbers_beside_it() -> None:
    """A letter each, thirty at most; the least where there is nothing to say."""
    for names, letters in ((("a",), 1), (("abc", "a"), 3), (("x" * 30,), 30), (("x" * 31,), 30)):
        root = drawn(Bars(np.ones(len(names)), np.arange(float(len(names))), "ink"), y=Axis("", names=names))
        left, top, floor, right = frame(root)
        assert left == pytest.approx(26.0 + LETTER * letters, abs=0.06)
        assert (top, right) == (14.0, WIDTH - 14.0) and floor == 230.0 - 44.0
        shown = [text for _, _, text in texts(root, "end")]
        assert shown == [name if len(name) <= 30 else name[:29] + "\u2026" for name in names]
        assert {x for x, _, _ in texts(root, "end")} == {round(left - 6, 1)}
    tall = frame(drawn(Level(1.0, "y"), height=400.0))
    assert tall[2] == 400.0 - 44.0


def test_the_first_name_stands_on_top_and_names_share_the_height() -> None:
    root = drawn(Bars(np.ones(4), np.arange(4.0), "ink"), y=Axis("", names="abcd"))
    _, top, floor, _ = frame(root)
    shown = texts(root, "end")
    assert [text for _, _, text in shown] == list("abcd")
    expected = top + (floor - top) * (np.arange(4) + 0.5) / 4
    np.testing.assert_allclose([y - 4 for _, y, _ in shown], expected, atol=0.06)
    assert not [one for one in root.iter("path") if one.get("class") == "grid" and "H" in one.get("d", "")]


@pytest.mark.parametrize(
    ("letters", "count", "turned"),
    [(5, 9, False), (6, 9, True), (13, 3, False), (14, 3, False), (13, 4, True)],
)
def test_names_below_stand_on_end_where_they_would_touch(letters: int, count: int, turned: bool) -> None:
    """Beyond four fifths of the width; thirteen letters of each, and the chart's floor makes room for them."""
    names = [f"{k}" + "x" * (letters - 1) for k in range(count)]
    root = drawn(Cells(np.zeros((2, count))), x=Axis("", names=names), y=Axis("", names="ab"))
    left, _, floor, right = frame(root)
    places = left + (right - left) * (np.arange(count) + 0.5) / count
    found = [
        one
        for one in root.iter("text")
        if "rotate(-90)" in (one.get("transform") or "") and one.get("class") is None
    ]
    assert bool(found) is turned
    if not turned:
        assert floor == 230.0 - 44.0
        np.testing.assert_allclose([x for x, _, _ in texts(root, "middle") if x][:count], places, atol=0.06)
        return
    assert floor == pytest.approx(230.0 - 20.0 - LETTER * min(letters, 13), abs=0.06)
    at = [re.match(rf"translate\(({NUMBER}) ({NUMBER})\)", one.get("transform", "")) for one in found]
    np.testing.assert_allclose([float(m[1]) for m in at if m], places + 4, atol=0.06)
    assert {float(m[2]) for m in at if m} == {round(floor + 6, 1)}
    long = [one.text for one in found]
    assert long == [name if letters <= 13 else name[:12] + "\u2026" for name in names]


def test_ticks_across_are_as_many_as_have_room_for_their_numbers() -> None:
    for low, high in (
        (0.0, 1.0),
        (0.0, 8.0),
        (123456.0, 123457.0),
        (-1e-9, 1e-9),
        (1.2345678, 1.2345679),
        (0.0, 1e9),
    ):
        root = drawn(Level(0.0, "y"), x=Axis("", low, high))
        found = [(x, text) for x, y, text in texts(root, "middle") if y < 229.0 - 10.0 and text]
        assert found
        gaps = np.diff([x for x, _ in found])
        widest = max(len(text) for _, text in found)
        assert (gaps[:-1] > (widest + 1) * LETTER).all(), found  # the last may be moved inside
        if widest <= 3:
            assert len(found) >= 5


@pytest.mark.parametrize("low", [1000.0, 123456.0, 98765432.0, -98765432.0])
def test_closer_ticks_than_those_across_would_touch(low: float) -> None:
    """Eight at most are tried; numbers that touch are drawn only where the two farthest apart do."""
    tried = set()
    for span in np.geomspace(0.9, 9.0, 60).tolist():
        high = low + span
        root = drawn(Level(0.0, "y"), x=Axis("", low, high))
        left, _, _, right = frame(root)
        shown = [text for _, y, text in texts(root, "middle") if y < 229.0 - 10.0 and text]
        sets = {most: ticks(low, high, most) for most in range(2, 9)}
        number = max(most for most, own in sets.items() if [text for _, text in own] == shown)
        for most, own in sets.items():
            apart = (own[1][0] - own[0][0]) / span * (right - left) if len(own) > 1 else right - left
            fits = (max(len(text) for _, text in own) + 1.5) * LETTER < apart
            assert fits is False or most <= number
            assert most != number or fits or number == 2
        tried.add(number)
    assert len(tried) > 2


# -- layers --------------------------------------------------------------------------------------------


def paths(root: ET.Element, kind: str) -> list[str]:
    return [one.get("d", "") for one in root.iter("path") if kind in (one.get("class") or "").split()]


def test_level_bars_have_their_numbers_beside_or_where_there_is_no_room_inside() -> None:
    values, said = np.array([1.0, 10.0, -5.0, np.nan]), ["one", "a number", "minus", "none"]
    root = drawn(
        Bars(values, np.arange(4.0), "ink", texts=said), x=Axis("", -10.0, 10.0), y=Axis("", names="abcd")
    )
    left, top, floor, right = frame(root)
    zero = (left + right) / 2
    (way,) = paths(root, "bar")
    found = [
        tuple(map(float, m))
        for m in re.findall(rf"M({NUMBER}) ({NUMBER})H({NUMBER})V({NUMBER})H({NUMBER})Z", way)
    ]
    middles = top + (floor - top) * (np.arange(4) + 0.5) / 4
    tips = [zero + 0.1 * (right - zero), right, zero - 0.5 * (zero - left)]
    expected = [(zero, y - 5, tip, y + 5, zero) for y, tip in zip(middles, tips, strict=False)]
    np.testing.assert_allclose(found, expected, atol=0.06)
    numbers = {one.text: one for one in root.iter("text") if one.get("class") in ("on", "beside")}
    assert set(numbers) == {"one", "a number", "minus"}
    for text, kind, anchor, x, y in (
        ("one", "beside", "start", tips[0] + 4, middles[0] + 4),
        ("a number", "on", "end", right - 4, middles[1] + 4),
        ("minus", "beside", "start", zero + 4, middles[2] + 4),
    ):
        own = numbers[text]
        assert (own.get("class"), own.get("text-anchor")) == (kind, anchor)
        assert (float(own.get("x", "")), float(own.get("y", ""))) == pytest.approx((x, y), abs=0.06)
    few = drawn(
        Bars(values, np.arange(4.0), "ink", texts=said[:1]),
        x=Axis("", -10.0, 10.0),
        y=Axis("", names="abcd"),
    )
    assert [one.text for one in few.iter("text") if one.get("class") in ("on", "beside")] == ["one"]


def test_levels_and_strips_go_through_the_whole_chart_below_everything_else() -> None:
    x, axis = np.array([0.0, 4.0]), Axis("", 0.0, 4.0)
    layers: list[Layer] = [
        Line(x, x, "ink"),
        Level(1.0, "y", dashed=False),
        Level(3.0, "x"),
        Span(1.0, 2.0, "free"),
    ]
    root = drawn(*layers, x=axis, y=axis)
    left, top, floor, right = frame(root)
    quarter = (right - left) / 4
    across, up = paths(root, "level")
    (strip,) = paths(root, "band")
    for way, expected in (
        (across, [left, floor - (floor - top) / 4, right]),
        (up, [left + 3 * quarter, floor, top]),
        (strip, [left + quarter, floor, top, left + 2 * quarter, floor]),
    ):
        np.testing.assert_allclose([float(v) for v in re.findall(NUMBER, way)], expected, atol=0.06)
    kinds = [one.get("class", "") for one in root.iter("path")]
    assert [kind for kind in kinds if "level" in kind] == ["level t-ink", "level dashed t-ink"]
    last = next(k for k, kind in enumerate(kinds) if kind.startswith("line"))
    assert not [kind for kind in kinds[last:] if kind.startswith(("level", "band"))]


def test_cells_fill_the_frame_and_their_numbers_are_light_on_deep_ones() -> None:
    values = np.array([[1.0, -0.004, 0.59], [-1.0, 0.61, -0.006]])
    said = [["a", "b", "c"], ["d", "e", "f"]]
    root = drawn(Cells(values, said), x=Axis("", names="uvw"), y=Axis("", names="xy"))
    left, top, floor, right = frame(root)
    boxes = list(root.iter("rect"))
    places = [tuple(float(one.get(name, "")) for name in ("x", "y", "width", "height")) for one in boxes]
    wide, tall = (right - left) / 3, (floor - top) / 2
    expected = [(left + c * wide, top + r * tall, wide, tall) for r in range(2) for c in range(3)]
    np.testing.assert_allclose(places, expected, atol=0.11)
    assert [one.get("fill-opacity") for one in boxes] == ["1.00", "0.00", "0.59", "1.00", "0.61", "0.01"]
    tones = ["before" if "t-before" in one.get("class", "") else "after" for one in boxes]
    assert tones == ["after", "after", "after", "before", "after", "before"]  # what is not seen has no sign
    on = {one.text for one in root.iter("text") if one.get("class") == "on"}
    assert on == {"a", "d", "e"}
    scaled = drawn(Cells(values, largest=2.0), x=Axis("", names="uvw"), y=Axis("", names="xy"))
    assert next(scaled.iter("rect")).get("fill-opacity") == "0.50"
    deep = drawn(Cells(values, largest=0.1), x=Axis("", names="uvw"), y=Axis("", names="xy"))
    assert next(deep.iter("rect")).get("fill-opacity") == "1.00"


def test_error_bars_reach_as_far_as_their_numbers() -> None:
    x = np.array([1.0, 3.0])
    root = drawn(Marks(x, x, "ink", error=np.array([0.5, 1.0])), x=Axis("", 0.0, 4.0), y=Axis("", 0.0, 4.0))
    left, top, floor, right = frame(root)
    (way,) = paths(root, "error")
    found = [tuple(map(float, m)) for m in re.findall(rf"M({NUMBER}) ({NUMBER})V({NUMBER})", way)]
    across, up = (right - left) / 4, (floor - top) / 4
    np.testing.assert_allclose(
        found,
        [
            (left + across, floor - 0.5 * up, floor - 1.5 * up),
            (left + 3 * across, floor - 2 * up, floor - 4 * up),
        ],
        atol=0.11,
    )
