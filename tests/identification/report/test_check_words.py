"""What a check says: by how much a mended slip fits better, what it refuses, and what stands above a result."""

from __future__ import annotations

from dataclasses import replace

import pytest

from truepose.identification.leaves.check.result import Check, Found
from truepose.identification.leaves.check.words import (
    caution,
    check_lines,
    checked,
    found_words,
    refusal,
)
from truepose.identification.signatures.untestable import Missing
from truepose.shown.document import Items, Table
from truepose.shown.result import document, frame

SLIP = Found("sign", ("q2", "q3"), "q2 counts backwards", "turn its sign", "wrong", 12.0, 0.03)
DOUBT = replace(SLIP, kind="sigma", verdict="suspect", says="sigma is twice as large")


def check(*found: Found, left: float | None = 0.0304, missing: tuple[Missing, ...] = ()) -> Check:
    return Check(found, 42, left, "mm", missing, left_rows=40, left_mended=any(f.after for f in found))


@pytest.mark.parametrize(
    ("before", "after", "more"),
    [
        (12.0, 0.03, ": it would fit 400 times better, rms 0.03 mm (12 mm as it stands)"),
        (12000.0, 0.003, ": it would fit 4e+06 times better, rms 0.003 mm (1.2e+04 mm as it stands)"),
        (0.75, 0.5, ": it would fit 1.5 times better, rms 0.5 mm (0.75 mm as it stands)"),
        (0.149, 0.1, ""),
        (12.0, 0.0, ": it would fit inf times better, rms 0 mm (12 mm as it stands)"),
        (None, 0.03, ": it would fit to 0.03 mm rms; as it stands nothing fits"),
        (None, None, ""),
        (12.0, None, ""),
    ],
)
def test_a_slip_is_told_with_what_mending_it_brings(
    before: float | None, after: float | None, more: str
) -> None:
    assert found_words(replace(SLIP, before=before, after=after)) == f"q2 counts backwards{more}"
    assert found_words(replace(DOUBT, before=before, after=after)) == "sigma is twice as large"


def test_lines_of_a_check() -> None:
    others = replace(SLIP, instead=("a", "b", "c", "d"))
    lack = Missing(("joint-compliance",), "no `gravity:`", "add it")
    assert check_lines(check()) == [
        "ok: the recording fits the machine file",
        "within its tolerances, the machine is off by 0.0304 mm rms over 40 of 42 rows",
    ]
    assert check_lines(check(left=None)) == ["ok: the recording fits the machine file"]
    lines = check_lines(check(others, missing=(lack,)), ["a.yaml", "b.csv"])
    assert lines == [
        "wrong: the recording does not belong to the machine file as it stands",
        f"  sign: {found_words(SLIP)}",
        "    to mend: turn its sign",
        "    fits as well: a; b; c",
        "mended and within its tolerances, the machine is off by 0.0304 mm rms over 40 of 42 rows",
        "  cannot be tested: joint-compliance: no `gravity:`; add it",
        "written: a.yaml, b.csv",
    ]
    unfitted = check_lines(check(replace(DOUBT, before=None, after=None)))
    assert unfitted[0].startswith("suspect: ") and unfitted[-1].startswith("within its tolerances")


def test_a_refusal_names_the_first_that_is_wrong_and_counts_the_others() -> None:
    one = f"sign: {found_words(SLIP)}; turn its sign"
    tail = "; 'truepose check' says more, --anyway goes on"
    assert refusal(check(DOUBT, SLIP)) == f"{one}{tail}"
    assert refusal(check(SLIP, DOUBT, SLIP)) == f"{one} (and 1 more){tail}"


def test_a_caution_says_what_may_be_wrong() -> None:
    assert caution(check(DOUBT)) == ["SUSPECT: sigma: sigma is twice as large; turn its sign"]
    assert caution(check()) == [] and checked(check()) == {}
    assert checked(check(DOUBT)) == {"check": check(DOUBT).document()}


def test_what_there_is_to_see_of_a_check() -> None:
    shown = document(check(SLIP))
    facts, rows = shown.summary
    assert shown.headline == "Check: wrong: the recording does not belong to the machine file as it stands"
    assert isinstance(rows, Table) and list(rows.rows) == [("sign", "q2, q3", "wrong", "q2 counts backwards")]
    assert isinstance(facts, Items) and facts.items == [line.strip() for line in check_lines(check(SLIP))[1:]]
    table = frame(check(SLIP, DOUBT))
    assert table["where"].tolist() == ["q2, q3", "q2, q3"] and table["before"].tolist() == [12.0, 12.0]
    assert frame(check()).empty and list(frame(check()).columns) == list(table.columns)
