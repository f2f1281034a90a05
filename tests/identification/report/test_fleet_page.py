"""The page of a fleet: it loads nothing, whatever a machine is called; it shows what there is, and says what it leaves out."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from support.browser import browser, tried
from support.told_fleet import DONE, FAILED, HOSTILE, RARE, SEEN, STATISTICS, fleet, fleet_html
from truepose.identification.leaves.fleet.changes import Change, Changes, Moved
from truepose.identification.leaves.fleet.page import fleet_document
from truepose.identification.leaves.fleet.result import SHOWN, Fleet
from truepose.identification.leaves.fleet.statistics import FleetStatistics, Interval
from truepose.identification.leaves.fleet.table import table
from truepose.identification.leaves.fleet.words import effect_sentence, fleet_json, often
from truepose.identification.report.json_text import json_text
from truepose.shown.text import first_screen


def test_a_page_loads_nothing_and_runs_nothing_of_a_machine_s() -> None:
    page = fleet_html(fleet())
    assert "<script>alert" not in page and "&lt;script&gt;alert" in page
    assert not re.search(r"(?:src|href)=[\"']?(?:https?:|//|data:)", page)
    links = set(re.findall(r'href="(machines/[^"]*)"', page))
    assert links == {"machines/%3Cscript%3Ealert%28%221%22%29%3C%2Fscript%3E%26/report.html"}
    assert fleet_html(fleet()) == page


@pytest.mark.parametrize(
    "said",
    [
        "in 40 % of machines",
        "from",
        "angle q",
        "q2.r",
        "which 0 of 99 others have",
        "zz/..",
        "New:",
        "Gone:",
        "7.00",
    ],
)
def test_a_page_says_what_the_fleet_says(said: str) -> None:
    assert said in fleet_html(fleet())


def test_what_is_left_out_is_counted() -> None:
    page = fleet_html(fleet(rows=SHOWN + 5))
    assert f"Shown are {SHOWN} of {SHOWN + 6}." in page


def test_first_run_and_a_run_without_change() -> None:
    assert "nothing to compare with" in fleet_html(fleet(None))
    assert "Nothing has changed since the last run." in fleet_html(fleet(Changes()))


def test_an_empty_fleet_has_a_page_too() -> None:
    nothing = Fleet(
        "line", 1, {"failed": 1}, {}, FleetStatistics(0, (), (), (), ()), 0, (), [FAILED], (), None
    )
    assert "None of 1 machines could be diagnosed." in fleet_html(nothing)
    assert json_text(fleet_json(nothing)) and first_screen(fleet_document(nothing))


def test_an_interval_whose_ends_read_alike_is_told_once() -> None:
    rare = replace(SEEN, frequency=Interval(1e-5, 1e-6, 1e-4))
    assert "below 0.1 % of machines (below 0.1 %; expected" in effect_sentence(rare)
    assert "in 40 % of machines (30 % to 50 %; expected" in effect_sentence(SEEN)


LINES = """
return Array.prototype.map.call(document.querySelectorAll("td:has(> small)"), function (cell) {
  var range = document.createRange(), tops = new Set();
  range.selectNodeContents(cell);
  Array.prototype.forEach.call(range.getClientRects(), function (box) { tops.add(Math.round(box.bottom / 10)); });
  return tops.size;
});
"""


@pytest.mark.skipif(browser() is None, reason="no chromium to show a page in")
@pytest.mark.parametrize("width", [800, 1280])
def test_names_of_effects_are_not_broken_into_single_words(width: int, tmp_path: Path) -> None:
    shown = fleet()
    long = replace(SEEN, effect="actuator-scale", place=("q1", "q2"))
    told = replace(STATISTICS, anywhere=(SEEN, replace(long, place=())), places=(SEEN, long))
    page = fleet_html(replace(shown, statistics=told))
    lines, console = tried(page, LINES, tmp_path, width)
    assert not console and len(lines) == 2 and max(lines) <= 2


def test_words_for_a_terminal() -> None:
    lines = "\n".join(first_screen(fleet_document(fleet())))
    assert "backlash" in lines and "(drift)" not in lines
    assert often(SEEN) and not often(RARE)
    assert (
        "angle q: not met; true spread 1.6 (1.4 to 1.8) of the stated tolerance, 600 constants."
        in " ".join(lines.split())
    )


def section(page: str, name: str) -> str:
    """What stands in a part of the page, with its tags."""
    return page.partition(f'<section id="{name}"')[2].partition("</section>")[0]


def text_columns(page: str, name: str) -> list[int]:
    """Of each table of a section how many of its first columns are text, the others numbers."""
    return [int(count) for count in re.findall(r'<table class="t(\d+)', section(page, name))]


def test_columns_of_numbers_are_set_to_the_right() -> None:
    page = fleet_html(fleet())
    names = {
        "undone": [3],
        "effects": [1, 1],
        "tolerances": [1, 2],
        "odd": [4],
        "changes": [4, 2],
        "machines": [4],
    }
    assert {name: text_columns(page, name) for name in names} == names


@pytest.mark.parametrize(("failed", "listed"), [(1, 1), (7, 1)])
def test_machines_without_a_diagnosis_are_counted_beside_those_that_are_listed(
    failed: int, listed: int
) -> None:
    own = replace(
        fleet(), machines=1 + failed, statuses={"done": 1, "failed": failed}, undone=[FAILED] * listed
    )
    said = f"Shown are {listed} of {failed}."
    assert (said in section(fleet_html(own), "undone")) is (listed < failed)


def test_effects_have_a_table_of_their_places_where_one_is_seen_at_any() -> None:
    """What hardly occurs anywhere is in the first table alone, and nothing is drawn where nothing occurs."""
    seen = section(fleet_html(fleet()), "effects")
    assert (
        "Effects by place, where at least one machine probably has them." in seen
        and seen.count("<table") == 2
    )
    rare = replace(
        fleet(), statistics=replace(STATISTICS, anywhere=(RARE,), places=(replace(RARE, place=("q2",)),))
    )
    hardly = section(fleet_html(rare), "effects")
    assert "Each effect at any of its places" in hardly and "Effects by place" not in hardly
    nothing = section(fleet_html(replace(fleet(), statistics=replace(STATISTICS, anywhere=()))), "effects")
    assert "there is nothing to say of effects" in nothing and "<table" not in nothing


def test_what_changed_has_tables_only_where_something_did() -> None:
    said = (Change("m1", "verdict", "", "unknown"),)
    moved = (Moved("m2", "q1.r", 0.3, 7.0),)
    for changes, tables in (
        (None, 0), (Changes(), 0), (Changes(said=said, compared=3), 1), (Changes(moved=moved, compared=3), 1),
        (Changes(said=said, moved=moved, compared=3), 2),
    ):  # fmt: skip
        assert section(fleet_html(fleet(changes)), "changes").count("<table") == tables


def test_a_brief_fleet_leads_to_folders_where_there_are_no_reports() -> None:
    rows = [
        replace(DONE, name=f"m {status}", status=status) for status in ("done", "refused", "wrong", "broken")
    ]
    for brief, reports in ((False, 2), (True, 0)):
        page = fleet_html(replace(fleet(), rows=rows, unusual=[], odd=0, brief=brief))
        links = re.findall(r'href="machines/m%20(\w+)/([^"]*)"', page)
        assert [status for status, _ in links] == ["done", "refused", "wrong", "broken"]
        assert [file for _, file in links] == ["report.html"] * reports + [""] * (4 - reports)


def test_a_table_has_a_row_a_machine() -> None:
    found = table([DONE, FAILED])
    assert found["name"].tolist() == [HOSTILE, "zz/.."] and found["oddness"].isna().tolist() == [False, True]
