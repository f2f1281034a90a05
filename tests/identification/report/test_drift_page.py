"""The page of a drift: its tables, its charts over time, and what its first screen picks."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

from support.reports import own_markup
from support.told_drift import BAD, CHANGED, DAY, GOOD, movement, told_drift
from truepose.identification.report.drift_page import drift_html

IN_THE_TABLE = "are in the table."


def rows(page: str, first: str) -> list[list[str]]:
    """Cells of the rows of tables that begin with a text."""
    found = []
    for row in re.findall(r"<tr>(.*?)</tr>", own_markup(page), re.DOTALL):
        cells = re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL)
        said = [" ".join(unescape(re.sub("<[^>]*>", "", cell)).split()) for cell in cells]
        found += [said] if said[:1] == [first] else []
    return found


def test_every_way_to_keep_up_is_a_row_for_each_session() -> None:
    page = drift_html(told_drift(carried=(GOOD, BAD), frames=(None, GOOD)))
    assert rows(page, "s1") == [
        ["s1", "everything", "position", "11.0 µm", "10.0 µm", "0.40", "yes"],
        ["s1", "the mechanism", "-", "-", "-", "-", "no fit"],
        ["s1", "nothing", "position", "11.0 µm", "10.0 µm", "-", "yes"],
    ]
    assert rows(page, "s2")[0] == ["s2", "everything", "position", "30.0 µm", "10.0 µm", "1.0×10⁻⁶", "no"]
    assert rows(page, "s0") == []


def test_a_parameter_tells_its_change_or_from_which_size_one_would_show() -> None:
    still = movement("b", "still", hidden=0.002, probability=0.03, log_bayes_factor=-2.5)
    page = drift_html(told_drift(movement("a", "moved", **CHANGED), still))
    assert rows(page, "a") == [["a", "moved", "60.0 ± 1.0 µm", "99.0 %", "9.00", "-"]]
    assert rows(page, "b") == [["b", "still", "-", "3.0 %", "-2.50", "4.0 µm"]]


@pytest.mark.parametrize(
    ("times", "axis", "places"),
    [
        (None, "session", ["1", "2", "3"]),
        ((0.0, DAY, 2.5 * DAY), "days", ["0", "1.0", "2.5"]),
        ((9 * DAY, 9.25 * DAY, 9.5 * DAY), "hours", ["0", "6", "12"]),
    ],
)
def test_changes_are_drawn_over_time_since_the_first_session(
    times: tuple[float, ...] | None, axis: str, places: list[str]
) -> None:
    page = own_markup(drift_html(told_drift(movement("a", "moved", **CHANGED), times=times)))
    (chart,) = [svg for svg in re.findall(r"<svg class=\"chart\".*?</svg>", page) if "change [µm]" in svg]
    assert f"<title>a: change [µm] against {axis}</title>" in chart
    ticks = re.findall(r'<text x="([\d.]+)" y="[\d.]+" text-anchor="middle">([^<]*)</text>', chart)
    at = {text: float(x) for x, text in ticks}
    begun = [float(x) for x in re.findall(r"M(-?[\d.]+) -?[\d.]+h0", chart)]
    assert len(begun) == 3
    first, last = (at[name] for name in (min(at, key=float), max(at, key=float)))
    scale = (last - first) / (float(max(at, key=float)) - float(min(at, key=float)))
    expected = [first + scale * (float(place) - float(min(at, key=float))) for place in places]
    np.testing.assert_allclose(begun, expected, atol=0.3)
    assert chart.count('class="error') == 1


def test_what_is_not_drawn_is_counted() -> None:
    for count, more in ((12, 0), (13, 1), (15, 3)):
        moved = [movement(f"p{k}", "moved" if k % 2 else "perhaps", **CHANGED) for k in range(count)]
        page = drift_html(told_drift(*moved))
        assert page.count("change [µm] against") == min(count, 12)
        assert (f"{more} more {IN_THE_TABLE}" in page) is bool(more)
        assert (IN_THE_TABLE in page) is bool(more)


def test_the_first_screen_tells_what_the_first_calibration_misses_at_last() -> None:
    """Beside what it would if nothing had moved; of the last session alone, and nothing where it could not be met."""
    page = " ".join(own_markup(drift_html(told_drift(carried=(GOOD, BAD)))).split())
    opening = page[: page.index('<section id="moved"')]
    assert "position error of the first calibration" in opening
    assert "30.0 µm" in opening and "11.0 µm" not in opening
    assert "if nothing had moved (dashed): 10.0 µm" in opening
    assert "the calibration of s0 on s2, rms" in opening
    gone = drift_html(told_drift(carried=(GOOD, None)))
    assert "error of the first calibration" not in gone


def test_the_tone_is_that_of_the_result_and_four_sure_movements_are_told_at_once() -> None:
    moved = [movement(f"p{k}", "moved", **CHANGED) for k in range(6)]
    page = own_markup(drift_html(told_drift(*moved)))
    assert page.count("that it moved.") == 4
    calm = own_markup(drift_html(told_drift(movement("a", "still", hidden=0.001))))
    assert "that it moved." not in calm
    tones = [
        re.search(r'<h1[^>]*class="([^"]*)"|class="([^"]*\b(?:good|warn)\b[^"]*)"', one)
        for one in (page, calm)
    ]
    assert all(tones) and "warn" in str(tones[0] and tones[0][0]) and "good" in str(tones[1] and tones[1][0])


def test_notes_have_a_section_of_their_own_where_there_are_any() -> None:
    assert '<section id="notes"' not in drift_html(told_drift())
    noted = drift_html(replace(told_drift(), notes=("row 4 was lost",)))
    assert '<section id="notes"' in noted and "row 4 was lost" in noted


def test_facts_count_the_readings_of_all_sessions() -> None:
    page = " ".join(re.sub("<[^>]*>", " ", own_markup(drift_html(told_drift()))).split())
    assert "sessions s0, s1, s2" in page and "readings 93" in page and "noise 1.04 times the stated" in page
