"""A fleet in words, on its page and in its tables: what is counted, picked, cut and left out."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from html import unescape
from typing import Any

import pytest

from support.reports import own_markup
from support.told_fleet import DONE, FAILED, SEEN, STATISTICS, fleet, fleet_html
from truepose.identification.leaves.fleet.changes import Change, Changes, Moved
from truepose.identification.leaves.fleet.page import fleet_document
from truepose.identification.leaves.fleet.result import Fleet
from truepose.identification.leaves.fleet.sections import effect_blocks, shown_words, tolerance_blocks
from truepose.identification.leaves.fleet.statistics import (
    ConstantInFleet,
    EffectInFleet,
    Interval,
    ToleranceInFleet,
)
from truepose.identification.leaves.fleet.words import (
    change_sentences,
    effect_sentence,
    fleet_json,
    headline,
    moved_words,
    off_drawing,
    often,
    said_words,
    size_words,
    status_sentences,
    tolerance_sentence,
)
from truepose.shown.document import Table
from truepose.shown.text import first_screen

PART = ToleranceInFleet("serial", "angle q", 600, Interval(1.6, 1.4, 1.8), 0.5)


def of(statuses: dict[str, int], **verdicts: int) -> Fleet:
    named = {name.replace("_", "-"): count for name, count in verdicts.items()}
    return replace(
        fleet(None), name="line", machines=sum(statuses.values()), statuses=statuses, verdicts=named
    )


@pytest.mark.parametrize(
    ("verdicts", "said"),
    [
        ({"missing_physics": 3, "unknown": 2}, "physics is missing in 3 and something unknown in 2."),
        ({"missing_physics": 3}, "physics is missing in 3."),
        ({"unknown": 2, "adequate": 4}, "something unknown in 2."),
        ({"adequate": 6}, "the model is adequate in all."),
    ],
)
def test_the_headline_counts_verdicts(verdicts: dict[str, int], said: str) -> None:
    assert headline(of({"done": 6, "failed": 1}, **verdicts)) == f"6 of 7 machines diagnosed: {said}"
    assert headline(of({"failed": 2})) == "None of 2 machines could be diagnosed."


def test_machines_that_are_no_plain_success_are_counted_by_what_became_of_them() -> None:
    assert status_sentences(of({"done": 6, "failed": 1, "wrong": 2, "broken": 0})) == [
        "2 machines whose files do not belong together.",
        "1 machine that could not be worked with.",
    ]
    assert status_sentences(of({"done": 6})) == []


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, "median 1.00×10⁻⁴ (8.00×10⁻⁵ to 1.20×10⁻⁴) rad, one sigma between machines 1.5 times"),
        ({"spread": None}, "median 1.00×10⁻⁴ (8.00×10⁻⁵ to 1.20×10⁻⁴) rad"),
        (
            {"amount": None, "spread": None},
            "median 0.100 (0.0800 to 0.120) of what the catalogue expects at most",
        ),
        ({"unit": "1", "spread": None}, "median 1.00×10⁻⁴ (8.00×10⁻⁵ to 1.20×10⁻⁴)"),
        ({"amount": None, "size": None}, ""),
    ],
)
def test_sizes_come_in_their_unit_or_in_the_largest_that_is_expected(more: dict[str, Any], said: str) -> None:
    own = replace(SEEN, place=("q1", "q2"), **more)
    assert size_words(own) == said
    told = effect_sentence(own)
    assert told.startswith(
        "backlash (backlash) at q1 + q2: in 40 % of machines (30 % to 50 %; expected 5.0 %)"
    )
    assert told.endswith(f"; {said}." if said else "expected 5.0 %).")


@pytest.mark.parametrize(
    ("machines", "low", "value", "found", "there"),
    [
        (100, 0.005, 0.01, 0.0, True),
        (100, 0.0049, 0.01, 0.0, False),
        (100, 0.0, 0.06, 0.5, True),
        (100, 0.0, 0.05, 0.5, False),
        (100, 0.0, 0.06, 0.49, False),
    ],
)
def test_an_effect_occurs_where_one_machine_surely_has_it_or_it_is_likelier_than_expected(
    machines: int, low: float, value: float, found: float, there: bool
) -> None:
    own = replace(SEEN, machines=machines, frequency=Interval(value, low, 0.5), found=found, usual=0.05)
    assert often(own) is there


@pytest.mark.parametrize(
    ("met", "said"), [(0.9, "met"), (0.89, "open"), (0.11, "open"), (0.1, "not met"), (0.0, "not met")]
)
def test_a_tolerance_is_met_or_not_with_nine_to_one(met: float, said: str) -> None:
    told = tolerance_sentence(replace(PART, met=met))
    assert told == f"angle q: {said}; true spread 1.6 (1.4 to 1.8) of the stated tolerance, 600 constants."


def test_a_constant_is_off_where_its_interval_leaves_out_the_drawing() -> None:
    ends = [(0.1, 0.9), (-0.1, 0.9), (-0.9, -0.1), (0.0, 0.9), (-0.9, 0.0)]
    constants = tuple(
        ConstantInFleet("serial", f"c{k}", 9, Interval(0.5, *e), 1.0) for k, e in enumerate(ends)
    )
    own = replace(fleet(), statistics=replace(STATISTICS, constants=constants))
    assert [one.name for one in off_drawing(own)] == ["c0", "c2"]


# -- changes -------------------------------------------------------------------------------------------


def test_changes_are_told_by_kind_with_six_names() -> None:
    names = tuple(f"m{k}" for k in range(8))
    said = [
        Change("m1", "verdict", "adequate", "unknown"),
        Change("m2", "status", "done", "failed"),
        Change("m3", "findings", "", "x"),
    ]
    moved = (Moved("m1", "q2.r", 0.3, 7.0), Moved("m1", "q3.r", 0.2, 6.0), Moved("m4", "q2.r", 0.1, 5.5))
    told = change_sentences(Changes(new=names, gone=("b",), said=tuple(said), moved=moved, compared=40))
    assert told == [
        "New: m0, m1, m2, m3, m4, m5 and 2 more.",
        "Gone: b.",
        "Otherwise done: m2.",
        "Other verdict: m1.",
        "Other findings: m3.",
        f"3 of 40 parameters moved by more than {Changes(compared=40).limit:.1f} sigma: m1, m4.",
    ]
    assert change_sentences(Changes(again=3)) == [
        "Nothing has changed since the last run, though 3 machines were worked with again."
    ]
    assert said_words(said[2]) == ("m3", "findings", "-", "x")
    assert said_words(Change("m", "verdict", "x", "")) == ("m", "verdict", "x", "-")
    assert moved_words(moved[0]) == ("m1", "q2.r", "0.300", "7.00")


def test_lines_for_a_terminal_keep_to_five_of_a_kind_and_count_the_rest() -> None:
    effects = tuple(replace(SEEN, effect=f"e{k}") for k in range(7))
    parts = tuple(replace(PART, parts=f"p{k}", met=0.95 if k == 0 else 0.5) for k in range(7))
    odd = [replace(DONE, name=f"m{k}", odd_because="why") for k in range(6)]
    own = replace(
        of({"done": 6, "refused": 1, "wrong": 2, "failed": 3, "broken": 4}, adequate=6),
        statistics=replace(STATISTICS, anywhere=effects, tolerances=parts), unusual=odd, odd=9,
    )  # fmt: skip
    lines = first_screen(fleet_document(own), 60)
    for label, shown, left in (
        ("occurs", 5, 2),
        ("tolerance", 5, 1),
        ("odd", 5, 4),
        ("since last time", 1, 0),
    ):
        told = [line for line in lines if line.startswith(f"  {label}: ")]
        assert len([line for line in told if "see fleet.html" not in line]) == shown
        more = [f"  {label}: and {left} more: see fleet.html"] if left else []
        assert [line for line in told if "see fleet.html" in line] == more
    assert "  tolerance: p0" not in "\n".join(lines) and "  tolerance: p1" in "\n".join(lines)
    assert lines[0].startswith("line: ")


def test_the_document_holds_the_machines_by_what_became_of_them() -> None:
    own = of({"failed": 1, "done": 6}, unknown=2, adequate=4)
    document = fleet_json(replace(own, changes=Changes(new=("a",), compared=40)))
    assert list(document["statuses"].items()) == [("done", 6), ("failed", 1)]
    assert list(document["verdicts"]) == ["adequate", "unknown"]
    assert document["changes"]["limit"] == pytest.approx(Changes(compared=40).limit)
    assert document["changes"]["new"] == ("a",)
    assert fleet_json(own)["changes"] is None
    assert document["undone"] == [{"name": FAILED.name, "status": "failed", "why": FAILED.why}]
    assert document["odd"][0] == {"name": DONE.name, "oddness": 4.2, "because": DONE.odd_because}


# -- the page ------------------------------------------------------------------------------------------


def tables(blocks: Any) -> list[Table]:
    return [one for one in blocks if isinstance(one, Table)]


def anywhere(*effects: EffectInFleet) -> Table:
    """The table of effects wherever they stand."""
    blocks = effect_blocks(replace(fleet(), statistics=replace(STATISTICS, anywhere=effects, places=())))
    (found,) = tables(blocks)
    return found


WHOLE = [
    "backlash",
    "",
    "serial",
    "100",
    "0.4",
    "0.3",
    "0.5",
    "0.05",
    "0.0001",
    "8e-05",
    "0.00012",
    "rad",
    "1.5",
]
"""A row of the CSV, in which nothing is left out."""


def test_columns_that_say_the_same_of_all_are_left_out() -> None:
    alike = anywhere(SEEN, replace(SEEN, effect="e2"))
    assert list(alike.head) == [
        "effect", "machines", "in", "90 % interval", "expected", "median size", "90 % interval", "spread",
    ]  # fmt: skip
    assert alike.text_columns == 1
    assert list(alike.rows[0]) == [
        "backlash (backlash)", "100", "40 %", "30 % to 50 %", "5.0 %", "1.00×10⁻⁴ rad", "8.00×10⁻⁵ to 1.20×10⁻⁴", "1.5",
    ]  # fmt: skip


def test_columns_that_tell_effects_apart_are_there() -> None:
    unsized = replace(SEEN, amount=None, size=None, spread=None)
    mixed = anywhere(SEEN, replace(unsized, effect="e2", place=("q1", "q2"), mechanism="parallel"))
    assert list(mixed.head)[:3] == ["effect", "place", "mechanism"] and mixed.text_columns == 3
    assert list(mixed.rows[1]) == [
        "e2 (e2)", "q1 + q2", "parallel", "100", "40 %", "30 % to 50 %", "5.0 %", "-", "-", "-",
    ]  # fmt: skip
    assert mixed.rows[0][1] == "anywhere"
    head, first, second = csv.reader(io.StringIO(mixed.csv))
    assert len(head) == len(first) == len(second) == 13
    assert first == WHOLE
    assert second == ["e2", "q1+q2", "parallel", *WHOLE[3:8], "", "", "", "", ""]
    sized = anywhere(replace(SEEN, amount=None))
    assert list(csv.reader(io.StringIO(sized.csv)))[1][8:] == ["0.1", "0.08", "0.12", "", "1.5"]


def test_tolerances_and_constants_that_are_off_are_listed() -> None:
    parts = tuple(replace(PART, parts=f"p{k}", ratio=Interval(0.5, 0.2, 0.8)) for k in range(23))
    own = replace(fleet(), statistics=replace(STATISTICS, tolerances=parts))
    table, off = tolerance_blocks(own)[1:]
    assert isinstance(table, Table) and isinstance(off, Table) and len(table.rows) == 23
    assert list(table.rows[0]) == ["p0", "600", "0.500", "0.200", "0.800", "50 %"]
    assert [list(row) for row in off.rows] == [["q2.r", "serial", "100", "0.500", "0.300", "0.700", "1.00"]]
    assert off.caption is not None and off.caption.endswith("by chance. ")
    none = replace(STATISTICS, constants=())
    assert len(tolerance_blocks(replace(fleet(), statistics=none))) == 2
    assert len(tolerance_blocks(replace(fleet(), statistics=replace(none, tolerances=())))) == 1
    many = tuple(ConstantInFleet("serial", f"c{k}", 9, Interval(0.5, 0.1, 0.9), 1.0) for k in range(203))
    *_, last = tolerance_blocks(replace(fleet(), statistics=replace(STATISTICS, constants=many)))
    assert (
        isinstance(last, Table)
        and len(last.rows) == 200
        and str(last.caption).endswith("Shown are 200 of 203.")
    )


def test_a_table_that_is_whole_says_nothing_of_it() -> None:
    assert shown_words(3, 4) == "Shown are 3 of 4." and shown_words(4, 4) == ""


def said(page: str) -> str:
    return " ".join(unescape(re.sub("<[^>]*>", " ", own_markup(page))).split())


def test_the_first_screen_has_five_lines_of_a_list_and_what_to_do_next() -> None:
    effects = tuple(replace(SEEN, effect=f"e{k}") for k in range(7))
    parts = tuple(replace(PART, parts=f"p{k}", met=0.95 if k == 0 else 0.5) for k in range(8))
    odd = [replace(DONE, name=f"m{k}", odd_because=f"why {k}") for k in range(7)]
    own = replace(
        fleet(), statistics=replace(STATISTICS, anywhere=effects, tolerances=parts), unusual=odd, odd=7
    )
    page = own_markup(fleet_html(own))
    opening = said(page[: page.index("<section id=")])
    assert [f"e{k} (e{k}): in" in opening for k in range(7)] == [True] * 5 + [False] * 2
    assert [f"p{k}: open" in opening for k in range(8)] == [False, *[True] * 5, False, False]
    assert [f"m{k}: why {k}" in opening for k in range(7)] == [True] * 5 + [False] * 2
    assert "truepose diagnose MACHINE RECORDING --prior prior.yaml -o DIR" in opening
    assert "odd 7" in opening and "missing-physics 1" in opening
    nobody = replace(own, statuses={"failed": 2}, verdicts={})
    assert "--prior prior.yaml" not in said(fleet_html(nobody))


@pytest.mark.parametrize(
    ("statuses", "odd", "tone"),
    [({"done": 3}, 0, "good"), ({"done": 3}, 1, "warn"), ({"done": 3, "failed": 1}, 0, "warn")],
)
def test_a_fleet_is_good_where_all_are_diagnosed_and_none_is_odd(
    statuses: dict[str, int], odd: int, tone: str
) -> None:
    own = replace(
        of(statuses, adequate=3), odd=odd, unusual=[DONE] * odd, undone=[FAILED] * statuses.get("failed", 0)
    )
    page = own_markup(fleet_html(own))
    head = page[: page.index("<section id=")]
    assert re.search(rf'class="[^"]*\b{tone}\b', head), head[:600]
    assert ('<section id="undone"' in page) is ("failed" in statuses)
    assert ("No machine is further from the others" in page) is not odd


def test_changes_are_listed_with_how_many_there_are() -> None:
    changes = Changes(
        said=tuple(Change(f"m{k}", "verdict", "a", "b") for k in range(203)),
        moved=tuple(Moved(f"m{k}", "q1.r", 0.3, 7.0) for k in range(204)), compared=999,
    )  # fmt: skip
    text = said(fleet_html(fleet(changes)))
    assert "Shown are 200 of 203." in text and "Shown are 200 of 204." in text
    few = Changes(said=changes.said[:1], compared=999)
    assert (
        "Shown are"
        not in said(fleet_html(fleet(few)))
        .partition("What changed since last time")[2]
        .partition("The machines")[0]
    )


def test_a_machine_is_a_row_with_its_figures() -> None:
    page = fleet_html(
        replace(fleet(), rows=[replace(DONE, name="m1"), replace(FAILED, name="m2", verdict="", findings="")])
    )
    rows = [
        re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL)
        for row in re.findall(r"<tr>(.*?)</tr>", page, re.DOTALL)
    ]
    cells = [[" ".join(unescape(re.sub("<[^>]*>", "", c)).split()) for c in row] for row in rows]
    assert [
        "m1",
        "done",
        "missing-physics",
        "backlash at q2",
        "40.0",
        "1.00",
        "900",
        "15.0",
        "µm",
        "0.0200",
        "4.20",
    ] in cells
    assert ["m2", "failed", "-", "-", "-", "-", "-", "-", "-", "-", "-"] in cells
    links = dict(re.findall(r'href="machines/(m\d)/([^"]*)"', page))
    assert links == {"m1": "report.html", "m2": ""}
