"""The page of a drift: its tables, its charts over time, and what its first screen picks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from support.reports import arm, fitted, own_markup, page_data, recorded
from support.told_drift import BAD, CHANGED, DAY, GOOD, NAMES, blind, drift_html, movement, told_drift
from truepose.identification.identifiability.observability import Direction
from truepose.identification.leaves.drift.analysis import Drift
from truepose.identification.leaves.drift.durability import Check
from truepose.identification.leaves.drift.sizes import Movement
from truepose.models.machine.machine import Machine

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
    assert "if nothing had moved: 10.0 µm" in opening
    assert "the calibration of s0 on s2, rms" in opening
    gone = drift_html(told_drift(carried=(GOOD, None)))
    assert "error of the first calibration" not in gone


def test_the_tone_is_that_of_the_result_and_all_movements_are_told_at_once() -> None:
    moved = [movement(f"p{k}", "moved", **CHANGED) for k in range(6)]
    page = own_markup(drift_html(told_drift(*moved)))
    assert page.count("moved: p") == 6
    calm = own_markup(drift_html(told_drift(movement("a", "still", hidden=0.001))))
    assert "moved: p" not in calm
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
    assert "sessions s0, s1, s2" in page and "readings 93" in page and "noise 1.0 times the stated" in page


def opening(found: Drift) -> str:
    """The first screen."""
    page = " ".join(own_markup(drift_html(found)).split())
    return page[: page.index('<section id="moved"')]


@pytest.mark.parametrize(
    ("got", "expected", "bar", "mark"),
    [(0.03, 0.01, 100.0, 33.3), (0.01, 0.04, 25.0, 100.0), (0.0, 0.0, 0.0, 0.0)],
)
def test_bars_are_shares_of_the_larger_of_what_is_missed_and_what_was_expected(
    got: float, expected: float, bar: float, mark: float
) -> None:
    check = Check({"position": got}, {"position": expected}, {"position": "mm"}, 0.4, True)
    screen = opening(told_drift(carried=(GOOD, check)))
    assert re.findall(r'<i class="t-after" style="width:([\d.]+)%">', screen) == [f"{bar:.1f}"]
    assert re.findall(r'<b style="left:([\d.]+)%">', screen) == [f"{mark:.1f}"]


def test_every_kind_of_reading_has_its_gain() -> None:
    both = Check(
        {"position": 0.03, "rotation": 2e-6}, {"position": 0.01, "rotation": 1e-6}, {"position": "mm", "rotation": "rad"},
        0.4, True,
    )  # fmt: skip
    screen = opening(told_drift(carried=(GOOD, both)))
    assert "position error of the first calibration" in screen
    assert "rotation error of the first calibration" in screen and "if nothing had moved: 1.00 µrad" in screen
    page = drift_html(told_drift(carried=(both,), frames=(None,)))
    kinds = [row[2] for row in rows(page, "s1")]
    assert kinds == ["position", "rotation", "-", "position"]


def test_what_stayed_and_how_long_a_calibration_lasts_are_on_the_first_screen() -> None:
    hidden = movement("a", "still", hidden=0.001)
    screen = opening(told_drift(hidden))
    assert "What did not move, or could not be told" in screen and "a (2.0 µm)" in screen
    assert "the calibration of s0 as it is suffices up to s2" in screen
    assert "What did not move" not in opening(told_drift(movement("a", "moved", **CHANGED)))
    pairs = [Direction({NAMES[2 * k]: 1.0, NAMES[2 * k + 1]: -1.0}) for k in range(5)]
    traded = told_drift(unseen=blind(*pairs))
    assert opening(traded).count("would not be noticed") == 5
    page = own_markup(drift_html(told_drift(hidden)))
    assert "Every parameter is common to all sessions unless" in page


def test_sentences_of_what_moved_stand_above_its_charts() -> None:
    unsized = movement("b", "perhaps", probability=0.6)
    page = own_markup(drift_html(told_drift(movement("a", "moved", **CHANGED), unsized)))
    moved = page[: page.index('<section id="lasting"')]
    assert "of the mechanism: a" in moved and "b: not in the likeliest set, probability 60 %" in moved
    assert "Change since the first session, with 1-sigma." in moved and moved.count("change [µm]") > 0
    bare = own_markup(drift_html(told_drift(unsized)))
    assert "Change since the first session" not in bare
    calm = own_markup(drift_html(told_drift(movement("c", "still", hidden=0.1))))
    assert "of the mechanism" not in calm


def test_columns_of_numbers_are_set_to_the_right() -> None:
    page = drift_html(told_drift(movement("a", "moved", **CHANGED)))
    assert re.findall(r'<table class="t(\d+)', page) == ["2", "3"]


def test_a_number_without_a_unit_is_drawn_as_one() -> None:
    own = movement("gain", "moved", **{**CHANGED, "unit": "1"})
    page = own_markup(drift_html(told_drift(own)))
    assert "<title>gain: change [1] against days</title>" in page


# -- with the fits of each session -------------------------------------------------------------------


def fitted_sessions(machine: Machine, *movements: Movement, rows: Sequence[int] = (30, 25)) -> Drift:
    """Two sessions from two files; the first has been fitted."""
    whole = recorded(machine, sum(rows))
    session = np.repeat([1, 2], rows)
    own = replace(whole, files=("days/a.csv", "days/b.csv"), session=session, source_file=session - 1)
    first = own.subset(session == 1)
    labels, checks = {"labels": ("a.csv", "b.csv"), "n_observations": (90, 90)}, (GOOD,)
    return told_drift(
        *movements,
        carried=checks,
        frames=checks,
        times=None,
        fits=(fitted(machine, first),),
        recording=own,
        **labels,
    )


def test_the_last_session_is_to_be_calibrated_on_where_something_moved(tmp_path: Path) -> None:
    machine = arm(tmp_path)
    moved = movement("q1.d", "moved", change=(0.0, 0.06), std=(0.0, 0.001))
    screen = opening(fitted_sessions(machine, moved))
    assert "calibrate on the last session:" in screen and "truepose calibrate arm.yaml b.csv -o fit" in screen
    for gone in (
        replace(fitted_sessions(machine, moved), fits=()),
        replace(fitted_sessions(machine, moved), recording=None),
    ):
        assert "truepose calibrate" not in opening(gone) and '<section id="origin"' not in own_markup(
            drift_html(gone)
        )
    perhaps = fitted_sessions(machine, replace(moved, status="perhaps"))
    assert "truepose calibrate" not in opening(perhaps)
    page = own_markup(drift_html(perhaps))
    assert '<section id="origin"' in page and "truepose drift arm.yaml" in " ".join(page.split())


def test_what_moved_or_perhaps_did_stands_out_in_the_drawing_of_the_first_session(tmp_path: Path) -> None:
    """Four parts at most, each with how sure that is."""
    machine = arm(tmp_path)
    names = ("q1.d", "q2.alpha", "q2.d", "q1.r", "q2.r")
    some = [
        movement(name, "moved" if k % 2 else "perhaps", probability=0.9 + 0.01 * k)
        for k, name in enumerate(names)
    ]
    found = fitted_sessions(machine, movement("q2.theta", "still", hidden=0.1), *some)
    html = drift_html(found)
    scene = page_data(html)["scene"]
    assert len(scene["guilty"]) == 4 and all(scene["guilty"]) and len(scene["poseRows"]) == 30
    screen = opening(found)
    assert (
        "q1.d perhaps" in screen and "q2.alpha moved" in screen and "q2.r" not in screen.partition("<svg")[2]
    )
    assert "q2.theta still" not in screen
    lost = replace(found, fits=(fitted(machine, recorded(machine, 29)),))
    assert page_data(drift_html(lost)).get("scene") is None  # rows of another recording cannot be drawn
