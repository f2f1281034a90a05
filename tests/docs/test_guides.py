"""The tutorial and the how-tos: every command runs, every program compiles, and what they show is what is printed."""

from __future__ import annotations

from pathlib import Path

import pytest

from support import ROOT
from support.documents import blocks, write_files
from support.generated_c import COMPILER
from support.guide_bag import write_bag
from support.guides import run_page, shown
from support.probe_logs import written

pytestmark = pytest.mark.nightly

DOCS = ROOT / "docs"
HOWTOS = sorted((DOCS / "howto").glob("*.md"))
PAGES = [DOCS / "tutorial.md", *HOWTOS]
LANGUAGES = {"sh", "text", "csv", "txt", "yaml", "python", "c"}
NAMES = {
    *("apply-c", "apply-plc", "apply-ur", "backlash-or-friction", "drift", "fleet"),
    *("hexapod", "probe-clock", "python", "robot-programs", "ros-bag", "thermal", "urdf"),
}


def test_there_is_a_how_to_for_each_question() -> None:
    assert {page.stem for page in HOWTOS} == NAMES


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_guide_s_commands_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if page.stem == "ros-bag":
        pytest.importorskip("rosbags")
        write_bag(tmp_path)
    if page.stem == "probe-clock":
        written(tmp_path, 90.0, 40.0)
    if any(block.language == "c" for block in blocks(page)) and COMPILER is None:
        pytest.skip("no C compiler found")
    write_files(page, tmp_path)
    monkeypatch.chdir(tmp_path)
    run_page(page, tmp_path)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_block_of_a_guide_is_tried(page: Path) -> None:
    """A block of a file is used by a command (a header, by the compiler); others are commands and what they print."""
    found = blocks(page)
    assert {block.language for block in found} <= LANGUAGES
    commands = " ".join(block.text for block in found if block.language == "sh")
    for block in found:
        assert block.language in ("sh", "text") or block.file in {*commands.split(), "math.h"}


@pytest.mark.parametrize(
    ("text", "printed", "there"),
    [
        ("s = 0.00101 +- 7e-06", "found:\n  s =\n  0.00102 +- 7e-06 rad", True),
        ("s = 0.00115", "s = 0.00102", False),
        ("a [...] c", "a b\nc", True),
        ("c [...] a", "a b c", False),
        ("q3, 99 %:", "q4, 99 %:", False),
        ("at q3", "of q3", False),
    ],
)
def test_what_is_shown_must_be_printed(text: str, printed: str, there: bool) -> None:
    assert shown(text, printed) is there


@pytest.mark.parametrize(
    ("text", "there"),
    [("s = 0.0013 +- 5e-06", True), ("q3, 97 %: s =", True), ("q4, 99 %:", False), ("k =", False)],
)
def test_words_are_printed_whatever_the_numbers(text: str, there: bool) -> None:
    assert shown(text, "at q3, 99 %: s = 0.001 +- 7e-06", numbers=False) is there
