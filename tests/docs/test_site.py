"""The site builds strictly, offline, and has what its map promises."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

import site_links
import truepose
from support import ROOT

pytestmark = pytest.mark.nightly

CONFIG = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
FROM_AFAR = re.compile(r"<(?:script|link|img)\b[^>]*\b(?:src|href)=\"https?://[^\"]+")


def pages(nav: Any) -> list[str]:
    """Paths of a navigation tree, in order."""
    if isinstance(nav, str):
        return [nav]
    parts = nav.values() if isinstance(nav, dict) else nav
    return [page for part in parts for page in pages(part)]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-f", str(ROOT / "mkdocs.yml")]
    done = subprocess.run([*command, "-d", str(folder)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_every_page_of_the_map_is_built_and_nothing_is_left_out(site: Path) -> None:
    mapped = pages(CONFIG["nav"])
    assert sorted(mapped) == sorted(path.relative_to(ROOT / "docs").as_posix() for path in _written())
    for page in mapped:
        text = (site / page).with_suffix(".html").read_text(encoding="utf-8")
        assert "<h1" in text, page


def test_the_built_site_asks_nothing_of_the_network(site: Path) -> None:
    asked = {path.name: FROM_AFAR.findall(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    assert {name: found for name, found in asked.items() if found} == {}


def test_the_python_page_has_every_public_name(site: Path) -> None:
    text = (site / "reference/python.html").read_text(encoding="utf-8")
    missing = {name for name in dir(truepose) if f"truepose.{name}" not in text}
    assert missing == set()


def test_links_out_of_the_folder_are_named_and_others_stay() -> None:
    page = ROOT / "docs/reference/python.md"
    text = "[a](../index.md) [the licence](../../LICENSE) [b](https://x.y) ![c](../../LICENSE) [d](../../nothing)"
    said = "[a](../index.md) the licence (`LICENSE`) [b](https://x.y) ![c](../../LICENSE) [d](../../nothing)"
    assert site_links.named(text, page) == said


def test_bars_in_code_are_plain_in_tables_only() -> None:
    row, code = "| `a\\|b` | c\\|d |", "`a\\|b`"
    assert site_links.unescaped(f"{row}\n{code}") == f"| `a|b` | c\\|d |\n{code}"


def _written() -> list[Path]:
    return list((ROOT / "docs").rglob("*.md"))
