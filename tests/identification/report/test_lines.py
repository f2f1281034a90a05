"""Words in lines of a terminal: as wide as a line may be and no wider, cut where there is no room, the rest counted."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from truepose.identification.report.lines import listed, several_lines, wrapped
from truepose.identification.report.next_steps import after_calibration
from truepose.identification.report.naming import far_row_words
from truepose.models.machine.machine import Machine

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


@pytest.mark.parametrize("count", [10, 11, 12])
def test_ten_rows_that_do_not_fit_are_named_of_two_files(count: int) -> None:
    """By their numbers, whatever their order; the largest residual is told."""
    rows = [
        {"file": f"{name}.csv", "row": k, "sigma": 4.0 + k} for name in "abc" for k in range(count, 0, -1)
    ]
    first, second = far_row_words(rows)
    more = f" and {count - 10} more" if count > 10 else ""
    for name, text in (("a", first), ("b", second)):
        assert text == (
            f"rows 1, 2, 3, 4, 5, 6, 7, 8, 9, 10{more} of {name}.csv do not fit: residuals of up to {4 + count} sigma;"
            " look there before the model is suspected"
        )


@pytest.mark.parametrize("over", [0, 1])
def test_a_command_may_be_as_wide_as_a_line(over: int) -> None:
    """A letter more, and it goes without the folder of its file; what is too long even so goes with less said of it."""
    label = "next: units, signs, order, frames: truepose check "
    path = "m" * (WIDTH + over - len(label) - len(" RECORDING"))
    machine = cast(Machine, SimpleNamespace(file=SimpleNamespace(path=path)))
    (line,) = after_calibration(machine, Path("out"), calibrated=False, doubtful=False)
    assert line == f"{label}{'MACHINE' if over else path} RECORDING"
