"""Pages of a stranger's machine in a browser: no name becomes markup, no script but the page's own runs, nothing is loaded."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import truepose
from support.browser import browser, tried
from support.examples import by_day
from support.reports import MACHINE as PLAIN
from support.reports import calibration_html, report_html
from support.told_drift import drift_html
from support.told_fleet import fleet_html
from truepose.identification.compensation.inverse import PoseSolver
from truepose.identification.leaves.fleet.odd import Oddness, Reason
from truepose.identification.leaves.fleet.record import Record
from truepose.identification.leaves.fleet.statistics import FleetStatistics
from truepose.identification.leaves.fleet.table import Fleet, fleet_table
from truepose.models.machine.machine import Machine

needs_browser = pytest.mark.skipif(browser() is None, reason="no chromium to show a page in")
OWN = "document.title='owned'"
MACHINE = f"</script><script>{OWN}</script>"
FIRST = f"<script>{OWN}</script>"
SECOND = f'"><img src=x onerror="{OWN}">'
DRIVER = f"<!--<svg onload={OWN}>"
MASS = f"`</code><iframe srcdoc='<script>parent.{OWN}</script>'>`"
FILE = f"<img src=x onerror={OWN}>{{}}.csv"
SCRIPTS = 4
"""Of every page: three of its own, and the data that they read."""
LOOK = """
var all = Array.prototype.slice.call(document.querySelectorAll("*"));
return {title: document.title,
        scripts: document.querySelectorAll("script").length - 1,
        foreign: document.querySelectorAll("img, iframe, object, embed, link, base, form, math, audio, video").length,
        handlers: all.filter(function (one) {
          return Array.prototype.some.call(one.attributes, function (each) { return /^on/i.test(each.name); }); }).length,
        addresses: all.map(function (one) { return one.getAttribute("href") || one.getAttribute("src") || ""; })
          .filter(function (to) { return to && !/^(#|machines\\/)/.test(to); }),
        loaded: performance.getEntriesByType("resource").map(function (one) { return one.name; }),
        text: document.body.textContent};
"""


def machine(folder: Path) -> Machine:
    document: dict[str, Any] = yaml.safe_load(PLAIN)
    for joint, name in zip(document["mechanism"]["joints"], (FIRST, SECOND), strict=True):
        joint["name"] = name
    document["gravity"] = [0, 0, -9.81]
    document["masses"] = {MASS: {"kg": 2.0, "com": [0, 0, 10], "in": "tool", "tolerance": {"kg": 0.1}}}
    document["drivers"] = [{"name": DRIVER, "unit": "degC", "drives": "temperature"}]
    path = folder / "machine.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return replace(truepose.load_machine(path), name=MACHINE)  # files cannot have it


def recorded(made: Machine, folder: Path, day: int) -> Path:
    """A recording whose first joint's gear turns unevenly, in a file with a name of its own."""
    rng = np.random.default_rng(day)
    q = rng.uniform(-1.4, 1.4, (40, 2))
    moved = q + np.stack([2e-3 * np.sin(2 * q[:, 0]) + 1e-3 * day, 0 * q[:, 1]], axis=1)
    seen = PoseSolver(made).forward(moved)[0][:, :3, 3] + rng.normal(0, 0.01, (40, 3))
    path = folder / FILE.format(day)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([f"{FIRST} [rad]", f"{SECOND} [rad]", DRIVER, "x", "y", "z"])
        writer.writerows(np.column_stack([q, 20 + rng.normal(size=40), seen]).tolist())
    return path


def _diagnosis(folder: Path) -> str:
    made = machine(folder)
    found = truepose.diagnose(made, truepose.load_recording(made, [recorded(made, folder, 0)]))
    return report_html(found, cautions=(SECOND,))


def _calibration(folder: Path) -> str:
    made = machine(folder)
    found = truepose.calibrate(made, truepose.load_recording(made, [recorded(made, folder, 0)]))
    return calibration_html(found, cautions=(FIRST, SECOND))


def _drift(folder: Path) -> str:
    made = machine(folder)
    files = [recorded(made, folder, day) for day in (0, 1)]
    return drift_html(truepose.drift(made, truepose.load_recording(made, files)), cautions=(FIRST,))


def _fleet(folder: Path) -> str:
    told = FleetStatistics(1, (), (), (), ())
    figures = {"machine": FIRST, "check": "ok", "verdict": SECOND, "findings": DRIVER}
    done = [
        Record(name=name, key="", status="done", figures=figures) for name in (MACHINE, f"javascript:{OWN}")
    ]
    failed = Record(name=FIRST, key="", status="failed", why=SECOND)
    odd = Oddness(2.0, True, (Reason("present", "", 0.0, MASS),))
    return fleet_html(Fleet(MACHINE, fleet_table([*done, failed], [odd, odd]), told, None))


PAGES: dict[str, Callable[[Path], str]] = {
    "diagnosis": _diagnosis,
    "calibration": _calibration,
    "drift": _drift,
    "fleet": _fleet,
}


@pytest.fixture(scope="module", params=by_day(PAGES, "calibration"))
def page(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    return PAGES[request.param](tmp_path_factory.mktemp("page"))


@needs_browser
def test_names_stay_texts(page: str, tmp_path: Path) -> None:
    found, console = tried(page, LOOK, tmp_path, 1000)
    assert console == []
    assert "owned" not in found["title"].replace(MACHINE, "")
    assert found["scripts"] == SCRIPTS
    assert found["foreign"] == found["handlers"] == 0
    assert found["addresses"] == found["loaded"] == []
    assert MACHINE in found["text"] and FIRST in found["text"]


@needs_browser
def test_what_slips_in_all_the_same_does_not_run_and_loads_nothing(page: str, tmp_path: Path) -> None:
    """A second lock: the page says itself which scripts may run."""
    slipped = (
        f'<script>{OWN}</script><img src=x onerror={OWN}><a id=way href="javascript:{OWN}">x</a>'
        "<script src=other.js></script><link rel=stylesheet href=other.css>"
    )
    script = f"document.getElementById('way').click(); {LOOK}"
    found, console = tried(page.replace("<main>", f"<main>{slipped}"), script, tmp_path, 1000)
    assert "owned" not in found["title"].replace(MACHINE, "")
    assert found["foreign"] == 2 and found["scripts"] == SCRIPTS + 2 and found["handlers"] == 1
    assert len([line for line in console if "Content Security Policy" in line]) >= 4


def test_pages_say_what_a_browser_may_do(page: str) -> None:
    head = page[: page.index("<style>")]
    found = re.search(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">', head)
    assert found is not None
    policy = dict(part.strip().split(" ", 1) for part in found[1].replace("&#39;", "'").split(";"))
    assert policy["default-src"] == "'none'" and policy["base-uri"] == policy["form-action"] == "'none'"
    assert all(source.startswith("'sha256-") for source in policy["script-src"].split())
    assert not re.search(r"<!--|</script><script>document", page)
