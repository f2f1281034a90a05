"""The tutorial and the how-tos: every command runs, every program compiles, and what they show is what is printed."""

from __future__ import annotations

from pathlib import Path

import pytest

from support import ROOT
from support.documents import blocks, write_files
from support.generated_c import COMPILER
from support.guide_bag import write_bag
from support.guides import run_page
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
