"""How views are written: one screen of text, HTML that escapes everything, small pictures."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from support.examples import examples
from truepose.identification.report.drivers import MOST
from truepose.identification.report.uncertainty import ROWS
from truepose.shown.chart import strips
from truepose.shown.chart_axes import WIDTH
from truepose.shown.html import page
from truepose.shown.result import Shown
from truepose.shown.text import printable, screen

TEXTS = st.text(max_size=300) | st.sampled_from(
    ["<script>alert(1)</script>", "a\nb\tc", "\x1b[31mred", "x" * 500, "'\"&", ""]
)
NUMBERS = st.floats(allow_nan=True, allow_infinity=True)
TAGS = {"div", "p", "strong", "ul", "li", "table", "thead", "tbody", "tr", "th", "td"}


@st.composite
def views(draw: st.DrawFn) -> View:
    width = draw(st.integers(1, 9))
    rows = st.lists(st.tuples(*[TEXTS] * width), max_size=60)
    return View(
        draw(TEXTS),
        tuple(draw(st.lists(TEXTS, max_size=40))),
        draw(st.tuples(*[TEXTS] * width)),
        tuple(draw(rows)),
        draw(TEXTS),
    )


@given(views())
@settings(max_examples=examples(60))
def test_any_view_is_one_screen(view: View) -> None:
    shown = screen(view).split("\n")
    assert len(shown) <= LINES
    assert all(len(line) <= WIDTH and line.isprintable() for line in shown)


@given(views())
@settings(max_examples=examples(60))
def test_html_holds_its_own_tags_and_the_texts(view: View) -> None:
    text = page(view)
    tree = ET.fromstring(text)
    assert {element.tag for element in tree.iter()} <= TAGS
    assert len(text) < 200_000
    said = "".join(tree.itertext())
    assert printable(view.title)[:100] in said
    assert len(tree.findall(".//td")) == min(len(view.rows), ROWS) * len(view.head)


def test_what_is_left_out_is_counted_and_named() -> None:
    rows = tuple((str(k), "1") for k in range(50))
    view = View("title", tuple(f"fact {k}" for k in range(30)), ("name", "value"), rows, "see there")
    shown = screen(view).split("\n")
    facts = sum(line.startswith("  fact") for line in shown)
    left = len(rows) - (len(shown) - 1 - facts - 2)  # without title, head and the last line
    assert shown[-1] == f"  ... {30 - facts} more lines, {left} more rows: see there"
    assert len(shown) == LINES and facts >= 10
    assert screen(View("title")) == "title"


def test_a_screen_is_24_lines_of_100_characters() -> None:
    wide = View("word " * 300, ("fact " * 300,), ("a", "b", "c"), (("x" * 34,) * 3,) * 50, "y" * 100)
    shown = screen(wide).split("\n")
    assert len(shown) == 24 and {max(map(len, shown)), len(shown[-1])} == {100}
    assert shown[-1].endswith(" ...") and shown[-2].endswith(" ...")


def test_html_has_forty_rows_and_facts_and_says_how_many_rows_are_left() -> None:
    def shown(rows: int, more: str = "") -> ET.Element:
        facts = tuple(f"fact {k}" for k in range(41))
        return ET.fromstring(page(View("t", facts, ("n", "m"), (("a", "b"),) * rows, more)))

    for rows, left in ((40, None), (41, "... 1 more rows"), (50, "... 10 more rows")):
        tree = shown(rows)
        assert len(tree.findall(".//tbody/tr")) == min(rows, 40) and len(tree.findall(".//li")) == 40
        _, *below = tree.findall("p")
        assert [one.text for one in below] == ([] if left is None else [left])
    assert shown(41, "see there").findall("p")[-1].text == "... 1 more rows: see there"
    first, second = shown(1).findall(".//tbody/tr/td")
    assert first.get("style") == "text-align:left" and second.get("style") is None
    assert len(shown(1).findall(".//th")) == 2
    bare = ET.fromstring(page(View("t")))
    assert [element.tag for element in bare.iter()] == ["div", "p", "strong"]


@pytest.mark.parametrize(("letters", "cut"), [(400, False), (401, True)])
def test_html_cuts_texts_of_more_than_four_hundred_letters(letters: int, cut: bool) -> None:
    """A title at four times as many."""
    tree = ET.fromstring(page(View("t" * 4 * letters, ("f" * letters,), ("n",), (("c" * letters,),))))
    for tag, letter, most in ((".//li", "f", 400), (".//td", "c", 400), (".//strong", "t", 1600)):
        text = tree.findall(tag)[0].text
        assert text == (letter * (most - 4) + " ..." if cut else letter * most)


def test_columns_stand_under_each_other() -> None:
    shown = screen(View("t", (), ("name", "size"), (("a", "1"), ("longer", "-12.5")))).split("\n")
    assert shown == ["t", "  name     size", "  a           1", "  longer  -12.5"]


def _drawn(svg: str) -> ET.Element:
    tree = ET.fromstring(svg)
    tags = {element.tag.rpartition("}")[2] for element in tree.iter()}
    assert tags <= {"svg", "title", "text", "path", "rect", "line"}
    return tree


@given(st.dictionaries(TEXTS, NUMBERS, max_size=12), st.none() | st.floats(0.1, 10))
@example({"": 5.4e305}, None)
@example({"": 1.7e308, "a": -1.7e308}, 1.0)
@settings(max_examples=examples(40))
def test_bars_of_any_numbers(values: dict[str, float], limit: float | None) -> None:
    tree = _drawn(bars(values, title="t", limit=limit))
    finite = [v for v in values.values() if math.isfinite(v)]
    boxes = tree.findall("{*}rect")
    assert len(boxes) == len(finite)
    assert all(
        0 <= float(box.get("x", "nan")) <= 560 and float(box.get("width", "nan")) <= 560 for box in boxes
    )


@given(st.dictionaries(TEXTS, st.lists(NUMBERS, max_size=50), max_size=3))
@settings(max_examples=examples(40))
def test_dots_and_strips_of_any_numbers(series: dict[str, list[float]]) -> None:
    for path in _drawn(dots(series, title="t")).findall("{*}path"):
        assert "nan" not in path.get("d", "") and "inf" not in path.get("d", "")
    _drawn(strips(series, dict.fromkeys(series, (0.0, 1.0)), title="t"))


def test_pictures_stay_small() -> None:
    many = [1.0 + k for k in range(100_000)]
    assert len(dots({"a": many, "b": many}, title="t")) < 40 * MOST
    assert len(strips({"a": many}, {"a": (1.0, 1e5)}, title="t")) < 40 * MOST


def test_what_has_no_extent_is_not_drawn() -> None:
    assert lines({"links": [((1.0, 1.0), (1.0, 1.0))]}, title="t") == ""
    assert lines({"links": []}, title="t") == ""
    _drawn(lines({"links": [((0.0, 0.0), (1.0, 2.0))], "legs": []}, title="<&"))


class _Broken(Shown):
    shown_by = "no_such_module"


def test_a_broken_result_still_has_a_repr() -> None:
    assert repr(_Broken()) == "<_Broken, which cannot be shown: ModuleNotFoundError>"


@pytest.mark.parametrize("text", ["\x1b[2J", "\r", "\u202e", "\x00"])
def test_no_text_moves_the_cursor(text: str) -> None:
    assert screen(View(f"a{text}b")).isprintable()
    assert text not in page(View(f"a{text}b"))
