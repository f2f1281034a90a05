"""Small pictures: every number stands where its axis says, beside its name, and nothing upon anything else."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from truepose.shown.drawing import BLUE, GREEN, MOST, ORANGE, bars, dots, lines, strips

NUMBER = r"-?\d+(?:\.\d+)?"
LETTER = 6.6
"""Width of a letter at the pictures' 11 px, about."""
WIDTH = 560.0


def drawn(svg: str, tag: str) -> list[dict[str, str]]:
    """Attributes of elements, and their text."""
    return [
        {**one.attrib, "text": one.text or ""}
        for one in ET.fromstring(svg).iter()
        if one.tag.endswith(f"}}{tag}")
    ]


def number(element: dict[str, str], *names: str) -> tuple[float, ...]:
    return tuple(float(element[name]) for name in names)


def inside(svg: str) -> bool:
    """Whether all texts are within the picture, as far as their letters tell."""
    left, top, wide, tall = map(float, ET.fromstring(svg).attrib["viewBox"].split())
    assert (left, top) == (0.0, -16.0)
    assert (
        ET.fromstring(svg).attrib["width"] == f"{wide:.0f}"
        and ET.fromstring(svg).attrib["height"] == f"{tall:.0f}"
    )
    for one in drawn(svg, "text"):
        (x, y), long = number(one, "x", "y"), LETTER * len(one["text"])
        start = x if one["text-anchor"] == "start" else x - long
        if not (start >= 0.0 and start + long <= wide and top < y < top + tall):
            return False
    return True


@pytest.mark.parametrize("limit", [None, 1.0, 4.0])
@pytest.mark.parametrize("values", [(0.5, 2.0, 0.25), (0.5, -2.0, 0.0), (-0.5, -1.0, -2.0)])
def test_bars_are_as_long_as_their_numbers_from_one_line(
    values: tuple[float, ...], limit: float | None
) -> None:
    """To the left of it where they are negative, then with room on both sides; the limit is marked at its own size."""
    named = {f"value {k}": value for k, value in enumerate(values)}
    svg = bars(named, title="sizes", limit=limit)
    signed = min(values) < 0
    *marks, zero = drawn(svg, "line")
    base, top, floor = number(zero, "x1", "y1", "y2")
    assert zero["x1"] == zero["x2"] and "stroke-dasharray" not in zero
    assert base == (365.0 if signed else 170.0)
    largest = max([abs(v) for v in values] + [limit or 0.0])
    # a twelfth of the room is free beyond the largest, and 60 px for its number
    scale = (195.0 - 60.0 if signed else 390.0 - 60.0) / (1.08 * largest)
    boxes, texts = drawn(svg, "rect"), drawn(svg, "text")
    assert texts[0]["text"] == "sizes" and len(texts) == 1 + 2 * len(values)
    for k, (value, box) in enumerate(zip(values, boxes, strict=True)):
        x, y, wide, tall = number(box, "x", "y", "width", "height")
        assert wide == pytest.approx(max(scale * abs(value), 0.5), abs=0.06)
        assert x == pytest.approx(base + min(scale * value, 0.0), abs=0.06)
        middle = y + tall / 2
        assert (tall, middle) == (10.0, 27.0 + 18.0 * k) and top < y < y + tall < floor
        name, size = texts[1 + 2 * k : 3 + 2 * k]
        assert (name["text"], name["text-anchor"], *number(name, "x", "y")) == (
            f"value {k}",
            "end",
            162.0,
            middle + 4,
        )
        assert size["text"] == f"{value:.3g}" and size["text-anchor"] == ("start" if value >= 0 else "end")
        gap = 4.0 if value >= 0 else -4.0
        assert number(size, "x", "y") == pytest.approx((base + scale * value + gap, middle + 4), abs=0.06)
    sides = [] if limit is None else [1.0, -1.0] if signed else [1.0]
    assert [float(mark["x1"]) for mark in marks] == pytest.approx(
        [base + s * scale * (limit or 0.0) for s in sides], abs=0.06
    )
    assert all(mark["stroke-dasharray"] == "4 3" and mark["x1"] == mark["x2"] for mark in marks)
    assert all(number(mark, "y1", "y2") == (top, floor) for mark in marks)
    assert inside(svg)


def test_bars_of_nothing_and_of_zeros_are_a_line() -> None:
    for empty in ({}, {"a": math.nan}):
        assert not drawn(bars(empty, title="t"), "rect") and len(drawn(bars(empty, title="t"), "line")) == 1
    (box,) = drawn(bars({"a": 0.0}, title="t"), "rect")
    assert box["width"] == "0.5"


@pytest.mark.parametrize("count", [1, 3])
def test_bars_have_a_line_each_and_half_a_line_of_air_and_zeros_need_no_other_side(count: int) -> None:
    values = {f"c{k}": float(k) for k in range(count)}
    svg = bars(values, title="t")
    assert ET.fromstring(svg).attrib["height"] == f"{18 * (count + 1.5) + 16:.0f}"
    (zero,) = drawn(svg, "line")
    assert zero["x1"] == "170.0"  # beside the names: nothing is negative
    (zero,) = drawn(bars({**values, "less": -1e-3}, title="t"), "line")
    assert zero["x1"] == "365.0"


@pytest.mark.parametrize(
    ("letters", "shown"), [(26, "x" * 26), (27, "x" * 23 + "..."), (90, "x" * 23 + "...")]
)
def test_a_long_name_is_cut_where_it_would_leave_the_picture(letters: int, shown: str) -> None:
    for svg in (
        bars({"x" * letters: 1.0}, title="t"),
        strips({"x" * letters: [1.0]}, {"x" * letters: (0, 2)}, title="t"),
    ):
        assert shown in [one["text"] for one in drawn(svg, "text")]


@pytest.mark.parametrize(
    ("values", "decades"),
    [
        ((0.02, 0.5, 3.0), ["0.01", "0.1", "1", "10"]),
        ((1.0,), ["1", "10"]),
        ((200.0, 300.0), ["100", "1000"]),
        ((1e-9, 1.0), ["1e-6", "1e-5", "1e-4", "0.001", "0.01", "0.1", "1"]),
        ((2e4, 3e5), ["1e4", "1e5", "1e6"]),
        ((), ["1", "10"]),
    ],
)
def test_dots_stand_by_row_on_a_scale_of_decades(values: tuple[float, ...], decades: list[str]) -> None:
    """All of them, six decades at most; what is smaller stands on the floor."""
    svg = dots({"before": values}, title="sizes")
    across, up = drawn(svg, "line")
    left, floor, right, level = number(across, "x1", "y1", "x2", "y2")
    assert level == floor and number(up, "x1", "y1", "x2", "y2") == (left, 30.0, left, floor)
    title, *ticks, name, row = drawn(svg, "text")
    assert [tick["text"] for tick in ticks] == decades
    heights = [float(tick["y"]) - 4.0 for tick in ticks]
    np.testing.assert_allclose(heights, np.linspace(floor, 30.0, len(decades)), atol=0.06)
    assert {(tick["x"], tick["text-anchor"]) for tick in ticks} == {(f"{left - 5:.1f}", "end")}
    (path,) = drawn(svg, "path")
    places = [(float(a), float(b)) for a, b in re.findall(rf"M({NUMBER}) ({NUMBER})h0", path["d"])]
    rows = np.arange(len(values)) + 0.5
    above = [max(math.log10(v / float(decades[0])), 0.0) / (len(decades) - 1) for v in values]
    across_ = left + (right - left) * rows / max(len(values), 1)
    expected = np.column_stack([across_, floor - (floor - 30.0) * np.array(above)])
    np.testing.assert_allclose(np.array(places).reshape(-1, 2), expected, atol=0.06)
    assert (title["text"], name["text"], row["text"]) == ("sizes", "before", "row")
    assert number(row, "x", "y") == (right, 184.0) and float(name["y"]) == 184.0
    assert inside(svg)


def test_dots_of_several_series_share_their_scale_and_differ_in_colour() -> None:
    series = {
        "one": [1.0, math.nan, 100.0],
        "two": [0.0, -3.0, 10.0, math.inf],
        "three": [5.0],
        "four": [1.0],
    }
    svg = dots(series, title="t")
    paths = drawn(svg, "path")
    assert [path["stroke"] for path in paths] == [ORANGE, BLUE, GREEN, ORANGE]
    assert [path["d"].count("M") for path in paths] == [2, 1, 1, 1]
    firsts = {path["d"].split()[0] for k, path in enumerate(paths) if k != 1}
    assert len(firsts) == 1  # the first row of each, above each other
    names = [one for one in drawn(svg, "text") if one["text"] in series]
    assert [one["fill"] for one in names] == [ORANGE, BLUE, GREEN, ORANGE]
    places = [float(one["x"]) for one in names]
    assert [b - a for a, b in pairwise(places)] == [120.0] * 3 and places[0] == 70.0
    assert inside(svg)


@pytest.mark.parametrize(
    ("count", "left"), [(MOST, MOST), (MOST + 1, MOST // 2 + 1), (3 * MOST, MOST), (3 * MOST + 1, 226)]
)
def test_of_many_marks_every_so_many_th_is_drawn_from_the_first_on(count: int, left: int) -> None:
    many = [float(1 + k % 7) for k in range(count)]
    for svg in (dots({"a": many}, title="t"), strips({"a": many}, {"a": (0.0, 9.0)}, title="t")):
        (path,) = drawn(svg, "path")
        assert path["d"].count("M") == left
    few, whole = (strips({"a": many[:k]}, {"a": (0.0, 9.0)}, title="t") for k in (1, count))
    assert drawn(whole, "path")[0]["d"].startswith(drawn(few, "path")[0]["d"])


def test_strips_have_a_tick_for_each_value_between_the_ends() -> None:
    values = {"q1": [-90.0, 0.0, 45.0, math.nan], "q2": [3.0], "still": [5.0]}
    ends = {"q1": (-90.0, 90.0), "q2": (1.0, 5.0), "still": (5.0, 5.0)}
    svg = strips(values, ends, title="ranges")
    rules, paths = drawn(svg, "line"), drawn(svg, "path")
    _, *texts = drawn(svg, "text")
    shares = [[0.0, 0.5, 0.75], [0.5], [0.0]]
    for k, (rule, path, share) in enumerate(zip(rules, paths, shares, strict=True)):
        left, y, right, level = number(rule, "x1", "y1", "x2", "y2")
        assert y == level == 27.0 + 18.0 * k and (left, right) == (170.0, 490.0)
        found = re.findall(rf"M({NUMBER}) ({NUMBER})v12", path["d"])
        assert [float(x) for x, _ in found] == pytest.approx(
            [left + s * (right - left) for s in share], abs=0.06
        )
        assert {float(top) for _, top in found} == {y - 6.0}
        name, span = texts[2 * k : 2 * k + 2]
        assert (name["text"], *number(name, "x", "y")) == (list(values)[k], 162.0, y + 4)
        assert number(span, "x", "y") == (right + 5, y + 4) and span["text-anchor"] == "start"
    assert [texts[k]["text"] for k in (1, 3, 5)] == ["-90 .. 90", "1 .. 5", "5 .. 5"]
    assert ET.fromstring(svg).attrib["width"] == "620" and inside(svg)


SQUARE = [((0.0, 0.0), (2.0, 0.0)), ((2.0, 0.0), (2.0, 1.0))]


@pytest.mark.parametrize("height", [240.0, 300.0])
@pytest.mark.parametrize("stretch", [(1.0, 1.0), (1.0, 8.0), (9.0, 1.0), (1.0, 0.0), (0.0, 1.0)])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (-70.0, 30.0)])
def test_segments_keep_their_shape_and_fill_the_picture(
    stretch: tuple[float, float], shift: tuple[float, float], height: float
) -> None:
    """One scale for both directions, up is up, the middle in the middle; a margin of 60 px aside, of 30 above and below."""

    def moved(point: tuple[float, float]) -> tuple[float, float]:
        return stretch[0] * point[0] + shift[0], stretch[1] * point[1] + shift[1]

    segments = [(moved(a), moved(b)) for a, b in SQUARE]
    svg = lines({"links": segments}, title="machine", height=height)
    way, ends = drawn(svg, "path")
    flat = np.array([point for segment in segments for point in segment])
    places = np.array(re.findall(rf"[ML]({NUMBER}) ({NUMBER})", way["d"]), dtype=float)
    spread, room = np.ptp(flat, axis=0), np.array([WIDTH - 120.0, height - 60.0])
    scale = np.min(room[spread > 0] / spread[spread > 0])
    middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
    expected = np.array([WIDTH / 2, height / 2 + 5]) + scale * (flat - middle) * [1.0, -1.0]
    np.testing.assert_allclose(places, expected, atol=0.06)
    dots_ = np.array(re.findall(rf"M({NUMBER}) ({NUMBER})h0", ends["d"]), dtype=float)
    np.testing.assert_array_equal(dots_, places)
    assert ET.fromstring(svg).attrib["height"] == f"{height + 16:.0f}"
    assert inside(svg)


def test_groups_of_segments_have_colours_and_names_in_their_order() -> None:
    groups = {"links": SQUARE, "none": [], "legs": SQUARE[:1], "more": SQUARE[1:]}
    svg = lines(groups, title="machine")
    assert [path["stroke"] for path in drawn(svg, "path")] == ["currentColor"] * 2 + [ORANGE] * 2 + [
        "currentColor"
    ] * 2
    names = [one for one in drawn(svg, "text") if one["text"] in groups]
    assert [(one["text"], float(one["x"]), float(one["y"])) for one in names] == [
        ("links", 10.0, 234.0),
        ("legs", 230.0, 234.0),
        ("more", 340.0, 234.0),
    ]
    assert [one["fill"] for one in names] == ["currentColor", ORANGE, "currentColor"]
