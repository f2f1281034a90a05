"""The pictures of ``docs/how-it-works.md`` are those that their script draws, and the page tells what they show."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from support import ROOT

pytest.importorskip("matplotlib")

from support.guides import shown

FIGURES = ROOT / "docs" / "figures"


def words(picture: Path) -> list[str]:
    """The texts of a picture, in order."""
    return re.findall(r"<text[^>]*>([^<]*)</text>", picture.read_text(encoding="utf-8"))


def test_the_pictures_are_those_of_the_script(tmp_path: Path) -> None:
    importlib.import_module("docs.how_it_works_pictures").draw(tmp_path)
    drawn, kept = sorted(tmp_path.glob("*.svg")), sorted(FIGURES.glob("how_*.svg"))
    assert [path.name for path in drawn] == [path.name for path in kept]
    for new, old in zip(drawn, kept, strict=True):
        assert shown(" ".join(words(old)), " ".join(words(new))), new.name


def test_the_page_shows_every_picture_and_its_numbers() -> None:
    page = (ROOT / "docs" / "how-it-works.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\(figures/(how_\w+\.svg)\)", page)) == {p.name for p in FIGURES.glob("how_*.svg")}
    numbers = {text for text in words(FIGURES / "how_levels.svg") if re.fullmatch(r"\d+", text)}
    assert {"150", "122", "29", "27"} <= numbers
    assert re.search(r"from 150 µm to 29 µm, .* from 122 µm to 27 µm", page, re.S)
