"""Documents as text: one screen, in the order of its parts, everything while there is room, and what is left out counted."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.examples import examples
from truepose.shown.document import Command, Document, Fold, Gain, Items, Table, Text
from truepose.shown.html import page
from truepose.shown.result import Shown
from truepose.shown.text import LINES, WIDTH, first_screen, printable, screen, wrapped

TEXTS = st.text(max_size=300) | st.sampled_from(
    ["<script>alert(1)</script>", "a\nb\tc", "\x1b[31mred", "x" * 500, "'\"&", ""]
)


@st.composite
def documents(draw: st.DrawFn) -> Document:
    width = draw(st.integers(1, 9))
    cells = st.lists(TEXTS, min_size=width, max_size=width)
    lists = st.builds(
        Items, st.lists(TEXTS, max_size=30), st.just("t"), label=TEXTS, weight=st.integers(1, 3)
    )
    table = Table(draw(cells), draw(st.lists(cells, max_size=60)))
    gain = Gain(draw(TEXTS), draw(TEXTS), draw(TEXTS), draw(TEXTS), draw(TEXTS), (1.0, 0.5, 0.2))
    return Document(
        draw(TEXTS),
        draw(TEXTS),
        gains=[gain] * draw(st.integers(0, 4)),
        summary=[*draw(st.lists(lists | st.builds(Text, TEXTS), max_size=6)), table],
        steps=[Text("look at it"), Command("truepose check m.yaml r.csv", "look:")],
        notes=draw(st.lists(TEXTS, max_size=20)),
        cautions=draw(st.lists(TEXTS, max_size=5)),
        more=draw(TEXTS),
    )


@given(documents())
@settings(max_examples=examples(60), deadline=None)
def test_any_document_is_one_screen(document: Document) -> None:
    for lines in (screen(document).split("\n"), first_screen(document)):
        assert len(lines) <= LINES
        assert all(len(line) <= WIDTH and line.isprintable() for line in lines)
    assert first_screen(document)[-1] == "next, look: truepose check m.yaml r.csv"
    assert "next" not in screen(
        replace(document, summary=(), gains=(), cautions=(), notes=(), title="t", headline="")
    )


def facts(count: int, **more: object) -> Items:
    return Items([f"fact {k}" for k in range(count)], **more)  # type: ignore[arg-type]


def test_parts_stand_in_this_order() -> None:
    alone = "the instrument alone: 0.1 mm"
    gain = Gain("position error, rms", "0.5 mm", "0.2 mm", "on held-out rows", alone, (1, 0, 0))
    told = Document(
        "kicker",
        "The headline.",
        cautions=["SUSPECT: look"],
        gains=[gain, replace(gain, before="")],
        summary=[facts(2, label="against it"), Text("a sentence"), Table(["name", "value"], [["a", "1"]])],
        steps=[Command("truepose codegen improved.yaml -o controller", "apply it:")],
        notes=["a note"],
    )
    body = [
        "  position error, rms: 0.5 mm before, 0.2 mm after; on held-out rows; the instrument alone: 0.1 mm",
        "  position error, rms: 0.2 mm; on held-out rows; the instrument alone: 0.1 mm",
        "  against it: fact 0",
        "  against it: fact 1",
        "  a sentence",
    ]
    table = ["  name  value", "  a         1"]
    step = "next, apply it: truepose codegen improved.yaml -o controller"
    assert first_screen(told) == ["SUSPECT: look", "The headline.", *body, *table, step]
    assert screen(told).split("\n") == ["SUSPECT: look", "The headline.", *body, "  note: a note", *table]
    assert first_screen(Document("title", "")) == ["title"]


@pytest.mark.parametrize("most", range(6, 40))
def test_all_is_told_where_it_fits_and_what_is_left_out_is_counted(most: int) -> None:
    told = Document("t", "h", summary=[facts(9), facts(20, label="other")], more="see there")
    lines = first_screen(told, most)
    assert len(lines) <= most
    if most >= 30:
        assert len(lines) == 30 and not any("more" in line for line in lines)
        return
    assert any(line.endswith("more: see there") or line.endswith("more lines: see there") for line in lines)
    for label, count in (("  fact", 9), ("  other: fact", 20)):
        shown = sum(line.startswith(label) for line in lines)
        rest = [line for line in lines if line.startswith(label.replace("fact", "and "))]
        if rest:
            assert f"and {count - shown} more: see there" in rest[0]


def test_a_list_of_more_weight_keeps_more_of_its_items() -> None:
    told = Document("t", "h", summary=[facts(30, weight=3), facts(30, label="other")])
    lines = first_screen(told)
    assert sum(line.startswith("  fact") for line in lines) > sum("other: fact" in line for line in lines) > 0


def test_rows_of_a_table_take_the_room_that_is_left() -> None:
    table = Table(["name", "value"], [[str(k), "1"] for k in range(50)])
    lines = first_screen(Document("t", "h", summary=[facts(3), table], more="see there"))
    assert len(lines) == LINES and lines[-1] == f"  ... {50 - (LINES - 6)} more rows: see there"


def test_a_command_is_never_broken_and_cautions_are_three() -> None:
    command = f"truepose plan {'m' * 150}.yaml"
    lines = first_screen(Document("t", "h", cautions=["word " * 100] * 5, steps=[Command(command)]))
    assert lines[-1] == f"next: {command}"
    assert "and 2 more: see report.html" in lines


@given(TEXTS, st.integers(1, 4))
def test_a_sentence_keeps_to_its_lines_and_says_where_it_was_cut(text: str, most: int) -> None:
    lines = wrapped(text, "  ", most)
    assert len(lines) <= most and all(len(line) <= WIDTH for line in lines)
    told = " ".join(line.strip() for line in lines)
    if not told.endswith("..."):
        assert "".join(told.split()) == "".join(printable(text).split())


def test_a_page_escapes_what_it_is_given_and_keeps_the_lines_of_a_table_to_copy() -> None:
    table = Table(["a", "b"], [["<b>", "(joint-compliance)"]], csv='a,"b"\n1,2\n')
    text = page(Document("<t>", "<h>", summary=[Fold("<f>", [table])]))
    assert "<b>" not in text.replace("<b style", "") and "&lt;b&gt;" in text and "&lt;h&gt;" in text
    assert "<small>(joint-compliance)</small>" in text
    assert 'data-csv="a,&#34;b&#34;\n1,2\n"' in text


class _Broken(Shown):
    pass


def test_a_broken_result_still_has_a_repr() -> None:
    assert repr(_Broken()) == "<_Broken, which cannot be shown: TypeError>"


@pytest.mark.parametrize("text", ["\x1b[2J", "\r", "\u202e", "\x00"])
def test_no_text_moves_the_cursor(text: str) -> None:
    told = Document("t", f"a{text}b", summary=[Items([f"c{text}d"])])
    assert all(line.isprintable() for line in first_screen(told))
    assert text not in page(told)
