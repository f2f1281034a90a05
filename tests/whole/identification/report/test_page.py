"""A report in a browser: no error, no text upon another, nothing wider than the page, and a click on a pose is answered."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import truepose
import truepose.models
from support.browser import browser, tried
from support.examples import by_day
from support.reports import arm, report_html, synthetic
from support.results import diagnosis

pytestmark = pytest.mark.skipif(browser() is None, reason="no chromium to show a page in")
MACHINES = Path(truepose.models.__path__[0]) / "machines"
WIDTHS = (500, 1000, 1600)
OVERLAPS = """
document.querySelectorAll("details").forEach(function (one) { one.open = true; });
var walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), boxes = [], node;
while ((node = walker.nextNode())) {
  var own = node.parentElement;
  if (!node.textContent.trim() || own.closest("script, style, noscript, title, desc, .skip, [hidden]")) { continue; }
  var range = document.createRange();
  range.selectNodeContents(node);
  Array.prototype.forEach.call(range.getClientRects(), function (box) {
    if (box.width > 1 && box.height > 1) { boxes.push([box.left, box.top, box.right, box.bottom, node.textContent.trim()]); }
  });
}
boxes.sort(function (a, b) { return a[1] - b[1]; });
var bad = [];
for (var i = 0; i < boxes.length; i++) {
  for (var j = i + 1; j < boxes.length && boxes[j][1] < boxes[i][3] - 3; j++) {
    var across = Math.min(boxes[i][2], boxes[j][2]) - Math.max(boxes[i][0], boxes[j][0]);
    var down = Math.min(boxes[i][3], boxes[j][3]) - boxes[j][1];
    if (across > 3 && down > 4) { bad.push(boxes[i][4].slice(0, 40) + " | " + boxes[j][4].slice(0, 40)); }
  }
}
return {texts: boxes.length, bad: bad, wide: document.documentElement.scrollWidth - window.innerWidth,
        width: window.innerWidth};
"""
CLICK = """
var svg = document.getElementById("machine"), told = document.getElementById("told"), before = told.textContent;
var data = JSON.parse(document.getElementById("data").textContent).scene;
var box = svg.getBoundingClientRect(), answers = [];
function at(x, y) {
  ["pointerdown", "pointerup"].forEach(function (kind) {
    svg.dispatchEvent(new PointerEvent(kind, {clientX: x, clientY: y, pointerId: 1, bubbles: true}));
  });
}
svg.setPointerCapture = function () {};
var places = svg.querySelector("path.point").getAttribute("d").match(/M-?[\\d.]+ -?[\\d.]+/g);
var by = Math.min(box.width / svg.viewBox.baseVal.width, box.height / svg.viewBox.baseVal.height);
places.slice(-3).forEach(function (place) {
  var xy = place.slice(1).split(" ").map(parseFloat);
  at(box.left + box.width / 2 + by * xy[0], box.top + box.height / 2 + by * xy[1]);
  answers.push(told.textContent);
});
svg.dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowLeft"}));
return {before: before, answers: answers, key: told.textContent, rings: document.querySelectorAll("svg.chart .pick").length,
        series: document.querySelectorAll("svg.chart path[data-rows]").length};
"""
PICK = """
var svg = document.querySelector("svg.chart path[data-rows]").ownerSVGElement, box = svg.getBoundingClientRect();
var last = svg.querySelector("path[data-rows]").getAttribute("d").match(/M-?[\\d.]+ -?[\\d.]+/g).pop().slice(1).split(" ");
var by = box.width / svg.viewBox.baseVal.width;
svg.dispatchEvent(new MouseEvent("click", {clientX: box.left + by * last[0], clientY: box.top + by * last[1], bubbles: true}));
var head = document.querySelector("table.sortable th:nth-child(3) button");
head.click();
var column = Array.prototype.map.call(document.querySelectorAll("table.sortable td:nth-child(3)"), function (cell) {
  return parseFloat(cell.textContent); });
return {rings: document.querySelectorAll("svg.chart .pick").length, sorted: column,
        told: document.getElementById("told").textContent};
"""


def _diagnosis(folder: Path) -> str:
    return diagnosis().report(folder / "report.html").read_text(encoding="utf-8")


def _calibration(folder: Path) -> str:
    machine = truepose.load_machine(MACHINES / "polisher" / "machine.yaml")
    recording = truepose.load_recording(machine, [MACHINES / "polisher" / "recording.csv"])
    return truepose.calibrate(machine, recording).report(folder / "report.html").read_text(encoding="utf-8")


def _drift(folder: Path) -> str:
    machine = truepose.load_machine(MACHINES / "nanopositioner" / "machine.yaml")
    days = [MACHINES / "nanopositioner" / f"drift_day{day}.csv" for day in (0, 7)]
    found = truepose.drift(machine, truepose.load_recording(machine, days))
    return found.report(folder / "report.html").read_text(encoding="utf-8")


def _made_up(folder: Path) -> str:
    return report_html(synthetic(arm(folder)))


PAGES: dict[str, Callable[[Path], str]] = {
    "diagnosis": _diagnosis,
    "calibration": _calibration,
    "drift": _drift,
    "made up": _made_up,
}


@pytest.fixture(scope="module", params=by_day(PAGES, "made up"))
def page(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    return PAGES[request.param](tmp_path_factory.mktemp("page"))


def test_no_error_no_text_upon_another_nothing_too_wide(page: str, tmp_path: Path) -> None:
    for width in WIDTHS:
        found, console = tried(page, OVERLAPS, tmp_path, width)
        assert console == []
        assert found["width"] == width and found["texts"] > 100
        assert found["bad"] == [], width
        assert found["wide"] <= 0, width


@pytest.mark.nightly
def test_dark_and_light_differ_and_both_can_be_read(page: str, tmp_path: Path) -> None:
    """Contrast of text on its paper: 4.5 or more, as WCAG 2.1 asks for."""
    script = """
    function linear(v) { return v <= 0.03928 ? v / 12.92 : Math.pow((v + 0.055) / 1.055, 2.4); }
    function light(rgb) { return rgb.map(function (v) { return linear(v / 255); })
      .reduce(function (sum, v, k) { return sum + v * [0.2126, 0.7152, 0.0722][k]; }, 0); }
    function rgb(text) { return text.match(/[\\d.]+/g).slice(0, 3).map(Number); }
    var paper = light(rgb(getComputedStyle(document.querySelector("main")).backgroundColor));
    return [".note, figcaption", "h1", "a", "main p"].map(function (name) {
      var ink = light(rgb(getComputedStyle(document.querySelector(name)).color));
      return (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05); }).concat([paper]);
    """
    bright, _ = tried(page, script, tmp_path, 1000)
    dark, _ = tried(
        page, script, tmp_path, 1000, 900, "--force-dark-mode", "--blink-settings=preferredColorScheme=0"
    )
    assert bright[-1] > 0.9 and dark[-1] < 0.1
    assert min(*bright[:-1], *dark[:-1]) >= 4.5


@pytest.mark.nightly
def test_a_click_on_a_pose_is_answered_everywhere(tmp_path: Path) -> None:
    found, console = tried(_diagnosis(tmp_path), CLICK, tmp_path, 1200)
    assert console == []
    assert found["before"].startswith("recording.csv, row ")
    assert any(answer != found["before"] for answer in found["answers"])
    assert all("before: position" in answer and "rho1" in answer for answer in found["answers"])
    assert found["key"] != found["answers"][-1]  # an arrow key steps to the pose before
    assert found["rings"] == found["series"] > 20


@pytest.mark.nightly
def test_a_click_on_a_point_picks_its_pose_and_tables_sort(tmp_path: Path) -> None:
    found, console = tried(_diagnosis(tmp_path), PICK, tmp_path, 1200)
    assert console == []
    assert found["rings"] > 20
    assert found["told"].startswith("recording.csv, row ")
    values = [value for value in found["sorted"] if value is not None]
    assert values == sorted(values) and len(values) > 20
