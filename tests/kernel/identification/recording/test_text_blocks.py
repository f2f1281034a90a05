"""Texts of tables: what was written in any form is read back, and what is wrong is said with its place."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.examples import examples
from truepose.errors import InputError
from truepose.identification.recording.table import read_table

HEADERS = ("q1", "note", "pose", "x")
Row = tuple[str, str, str, str]


@dataclass(frozen=True)
class Form:
    """How a text is written. quotes: around which cells; between: a line that is no row, before each one that is."""

    separator: str = ","
    quotes: Literal["none", "needed", "all"] = "none"
    mark: str = "."
    end: str = "\n"
    between: str = ""
    above: str = ""
    encoding: str = "utf-8"

    def cell(self, text: str) -> str:
        """A cell as it is written."""
        needed = any(c in text for c in (self.separator, '"', "\n", "\r"))
        if self.quotes == "all" or (self.quotes == "needed" and needed):
            return '"' + text.replace('"', '""') + '"'
        return text

    def line(self, row: Row) -> str:
        """A row as it is written, decimal marks in its numbers."""
        q1, note, pose, x = row
        cells = (q1.replace(".", self.mark), note, pose, x.replace(".", self.mark))
        return self.separator.join(map(self.cell, cells)) + self.end


FORMS = {
    "plain": Form(),
    "Windows": Form(end="\r\n"),
    "Macintosh": Form(end="\r"),
    "comments between rows": Form(between='# it is 5" long\n'),
    "empty lines between rows": Form(separator=";", between="\n  \n"),
    "quotes where needed": Form(quotes="needed"),
    "quotes and comments": Form(quotes="needed", between="# c\r\n\r\n", end="\r\n"),
    "all cells in quotes": Form(quotes="all", separator="\t"),
    "decimal commas in quotes": Form(quotes="all", mark=","),
    "decimal commas between semicolons": Form(";", mark=","),
    "decimal commas between tabs": Form("\t", mark=",", between="#\n"),
    "spaces": Form("  ", between="#\n"),
    "decimal commas between spaces": Form("   ", mark=",", end=" \r\n"),
    "a spreadsheet's own": Form("|", quotes="needed", above="sep=|\n"),
    "no ASCII between": Form("§", quotes="needed", above="sep=§\n"),
    "UTF-8 with a mark": Form(encoding="utf-8-sig", above="# first\n\n"),
    "UTF-16": Form("\t", quotes="needed", mark=",", encoding="utf-16"),
    "Latin-1": Form(";", above="# Prüfstand\n", encoding="latin-1"),
}
NUMBERS = st.one_of(
    st.floats(-1e6, 1e6).map(repr),
    st.integers(-9999, 9999).map(str),
    st.sampled_from(["5.", "+.5e-3", " 1 "]),
)


def notes(form: Form) -> st.SearchStrategy[str]:
    """Labels that a form can hold."""
    if form.separator.isspace() and form.separator != "\t":
        return st.text("ab#\"'", min_size=1, max_size=4)
    plain = st.text("ab #'µ", max_size=4)
    hard = st.text("ab \n\r;,|\t\"§'", max_size=6).map(lambda text: "\n".join(text.splitlines()))
    told = st.one_of(plain, hard.filter(lambda text: all(line.strip() for line in text.split("\n"))))
    return told if form.quotes != "none" else plain


def rows(form: Form) -> st.SearchStrategy[list[Row]]:
    """Few rows, or as many that columns hold more texts than are kept."""
    spaced = form.separator.isspace() and form.separator != "\t"
    numbers = NUMBERS.map(str.strip) if spaced else NUMBERS
    lost = numbers if spaced else st.one_of(numbers, st.just(""))
    drawn = st.lists(st.tuples(numbers, notes(form), st.just("007"), lost), min_size=1, max_size=6)

    def more(few: list[Row], many: bool) -> list[Row]:
        added = [(f"{k}.5", few[0][1], f"{k:04d}", few[0][3]) for k in range(1, 260 if many else 2)]
        return [*few, *added]

    return st.builds(more, drawn, st.booleans())


def write(path: Path, form: Form, written: Sequence[Row]) -> list[int]:
    """Write a file; the line that each row ends on."""
    pieces, lines = [form.above + form.line(HEADERS)], []
    number = _ends(pieces[0])
    for row in written:
        pieces.append(form.between + form.line(row))
        number += _ends(pieces[-1])
        lines.append(number)
    path.write_bytes("".join(pieces).removesuffix(form.end).encode(form.encoding))
    return lines


def _ends(text: str) -> int:
    return len(re.findall("\r\n|\r|\n", text))


@pytest.mark.parametrize("name", FORMS)
@settings(max_examples=examples(25), deadline=None)
@given(data=st.data())
def test_what_was_written_in_any_form_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, name: str, data: st.DataObject
) -> None:
    form = FORMS[name]
    written = data.draw(rows(form))
    path = tmp_path_factory.mktemp("rows") / "rows.csv"
    lines = write(path, form, written)
    found = read_table(path)
    assert found.names == HEADERS
    assert [list(found.cells[header]) for header in HEADERS] == [
        list(cells) for cells in zip(*written, strict=True)
    ]
    np.testing.assert_array_equal(found.numbers("q1"), [float(row[0]) for row in written])
    np.testing.assert_array_equal(found.readings("x"), [float(row[3] or math.nan) for row in written])
    assert found.line is not None
    assert [found.line(row) for row in (0, len(written) - 1)] == [lines[0], lines[-1]]
    assert found.texts("pose") == tuple(row[2] for row in written)


EXAMPLES: dict[str, tuple[str, list[list[str]]]] = {
    "cells as they stand": ("q1 [mm],x\n1,2.50\n-1e-3, +4\n", [["1", "-1e-3"], ["2.50", " +4"]]),
    "marks and blanks above": ("\ufeff# comment\n\nq,x\r\n 1 ,\r\n3,x\r\n", [[" 1 ", "3"], ["", "x"]]),
    "tabs only are no row": ("a\tb\n1\t2\n\t\n3\t4\n", [["1", "3"], ["2", "4"]]),
    "blanks only are no row of one column": ("a\n1\n \n2\n", [["1", "2"]]),
    "empty cells in quotes are one": ('a\n1\n""\n2\n', [["1", "", "2"]]),
    "several ends of lines": ("a,b\n1,2\r3,4\r\n5,6\n", [["1", "3", "5"], ["2", "4", "6"]]),
    "a quote amid a cell": ('a,b\n5" pipe,1\n"x",2\n', [['5" pipe', "x"], ["1", "2"]]),
    "quotes amid two cells": ('a,b\n5" pipe,1"\n', [['5" pipe'], ['1"']]),
    "comments and empty lines in quotes": ('a,b\n"x\n\n# y\nz",2\n', [["x\nz"], ["2"]]),
    "a mark amid the text": ("a,b\nx,1\n\ufeffy,2\n", [["x", "\ufeffy"], ["1", "2"]]),
    "labels with commas and decimal commas": (
        "a;b\nx, y;1,5\n1,5,2;2\n",
        [["x, y", "1,5,2"], ["1.5", "2"]],
    ),
    "headers in quotes": ('"a, b";c\n1,5;2\n', [["1.5"], ["2"]]),
    "a long line": (f"a,b\n{'x' * 100_000},{'y' * 100_000}\n", [["x" * 100_000], ["y" * 100_000]]),
}


@pytest.mark.parametrize("case", EXAMPLES)
def test_examples_are_read_as_they_stand(case: str, tmp_path: Path) -> None:
    text, expected = EXAMPLES[case]
    path = tmp_path / "rows.csv"
    path.write_bytes(text.encode())
    assert [list(cells) for cells in read_table(path).cells.values()] == expected


GOOD = "".join(f"{k},{k}.5\n" for k in range(1, 40))
WRONG: dict[str, tuple[str, str]] = {
    "no number": (f"q1,q2\n{GOOD}3,high\n", "row 40 (line 41), column 'q2': found 'high', expected"),
    "an empty cell": (f"q1,q2\n{GOOD}3,\n4,5\n", "row 40 (line 41), column 'q2': found an empty cell"),
    "nan": (f"q1,q2\n{GOOD}3,nan\n", "row 40 (line 41), column 'q2': found 'nan'"),
    "grouped digits": (f"q1,q2\n{GOOD}3,1_000\n", "row 40 (line 41), column 'q2': found '1_000'"),
    "behind comments": (f"# c\n\nq1,q2\n{GOOD}# c\n3,a\n", "row 40 (line 44), column 'q2': found 'a'"),
    "behind ends of lines": (f'q1,q2\n"a\nb",5\n{GOOD}3,a\n', "row 41 (line 43), column 'q2': found 'a'"),
    "a short row": (f"q1,q2\n{GOOD}3\n{GOOD}", "row 40 (line 41): found 1 cells, expected 2"),
    "a long row": (f"q1,q2\n{GOOD}3,4,5\n{GOOD}", "row 40 (line 41): found 3 cells, expected 2"),
    "decimal commas": (f"q1,q2\n{GOOD}1,5,2,5\n", "expected 2; decimal commas need a semicolon or a tab"),
    "the first wrong row": (f'q1,q2\n{GOOD}3\n3,"4"5\n', "row 40 (line 41): found 1 cells, expected 2"),
    "twice": (f"q1,q1 [mm]\n{GOOD}", "column 'q1': found twice"),
    "no row": ("q1,q2\n", "found no row of data"),
    "comments only": ("# q1,q2\n", "found no header"),
    "no header": ("sep=,\n\n", "found no header"),
    "no UTF-8": (f"q1,q2\n{GOOD}1,\udc93\n", "cannot read the file: neither text in UTF-8"),
    "half a character": (f"q1,q2\n{GOOD}\udcc3", "expected 2"),
    "a control character": (
        f"q1,q2\n{GOOD}1\n1,\x01\u2028\n",
        "found the control character '\\x01', expected",
    ),
    "text behind quotes": (f'q1,q2\n{GOOD}1,"2"3\n', "cannot read the file: ',' expected after '\"'"),
    "an open quote": (f'q1,q2\n{GOOD}1,"2\n{GOOD}', "cannot read the file: unexpected end of data"),
    "an endless quote": (f'q1,q2\n{GOOD}1,"2\n{GOOD * 600}', "field larger than field limit"),
    "an endless cell": (f"q1,q2\n{GOOD}1,{'2' * 140_000}\n", "row 40 (line 41), column 'q2': found '222"),
    "both decimal marks": (
        f"q1;q2\n{GOOD.replace(',', ';')}1,5;2\n",
        "found '1,5' in row 40 (line 41), column 'q1' and '1.5' in row 1 (line 2), column 'q2', expected one",
    ),
    "thousands": (
        "q1\tq2\n" + "1\t2,500\n" * 9 + "12,125\t3\n",
        "found '12,125' in row 10 (line 11), column 'q1': the comma may mark decimals or thousands",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_said_with_its_place(case: str, tmp_path: Path) -> None:
    text, expected = WRONG[case]
    path = tmp_path / "rows.csv"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError) as caught:
        read_table(path).numbers("q2")
    assert str(caught.value).startswith(f"{path}: ")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_commas_of_one_late_row_are_decimal(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_text("q1\tq2\n" + "1\t2,500\n" * 9 + "1\t2,50\n")
    np.testing.assert_array_equal(read_table(path).numbers("q2"), [2.5] * 10)
