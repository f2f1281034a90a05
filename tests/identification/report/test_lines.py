"""Words in lines of a terminal: as wide as a line may be and no wider, cut where there is no room, the rest counted."""

from __future__ import annotations

import pytest

from truepose.identification.report.lines import listed, several_lines, wrapped

WIDTH = 110
WORDS = "a " * 400
"""Words so short that a line is filled but for one letter."""


@pytest.mark.parametrize("indent", [0, 2, 4, 9])
@pytest.mark.parametrize("most", [1, 2, 3])
def test_a_sentence_that_is_cut_fills_its_lines(indent: int, most: int) -> None:
    """Whole lines up to the width; those after the first stand two further in; the end says that it is cut."""
    lines = wrapped(WORDS, indent, most)
    assert len(lines) == most
    assert all(WIDTH - 1 <= len(line) <= WIDTH for line in lines[:-1])
    full = WIDTH if most > 1 else WIDTH - 2
    assert full - 1 <= len(lines[-1]) <= full and lines[-1].endswith("a ...")
    starts = [len(line) - len(line.lstrip()) for line in lines]
    assert starts == [indent, *[indent + 2] * (most - 1)]


@pytest.mark.parametrize("indent", [0, 2, 5])
def test_a_sentence_that_fits_is_not_cut(indent: int) -> None:
    exact = "b" * (WIDTH - indent - 2) + " b"
    assert wrapped(exact, indent, 1) == [" " * indent + exact]
    assert len(wrapped(exact + "b", indent, 2)) == 2
    assert wrapped("one-two-three " * 9, indent, 2) == [
        line.rstrip() for line in wrapped("one-two-three " * 9, indent, 9)
    ]
    assert not any(line.endswith("-") for line in wrapped("one-two-three " * 30, indent, 9))


def test_of_sentences_those_beyond_the_room_are_counted() -> None:
    texts = ["x", "y", "z"]
    assert several_lines(texts, "against it", 3) == [f"  against it: {text}" for text in texts]
    assert several_lines(texts, "against it", 2) == [
        "  against it: x",
        "  against it: and 2 more: see report.html",
    ]
    assert several_lines(texts, "against it", 1) == ["  against it: and 3 more: see report.html"]
    assert several_lines(texts, "against it", 0) == several_lines([], "against it", 2) == []
    assert len(several_lines([WORDS], "against it", 9, 3)) == 3
    assert len(several_lines([WORDS], "against it", 9)) == 2


def test_a_block_is_told_whole_or_not_at_all() -> None:
    blocks = [["a"], ["b", "b"], ["c"]]
    whole = ["a", "b", "b", "c"]
    assert listed(blocks, 4) == whole and listed(blocks, 9) == whole
    assert listed(blocks, 3) == ["a", "  and 2 more: see report.html"]
    assert listed(blocks, 2, "{} left") == ["a", "2 left"]
    assert listed(blocks, 1, "{} left") == ["3 left"]
