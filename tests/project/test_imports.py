"""The house keeps its floors: no import runs back, none runs in a circle, and every module has a room."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import import_picture as house
from support import ROOT


@pytest.fixture(scope="module")
def known() -> dict[str, Path]:
    """Every module of the project."""
    return house.modules()


@pytest.fixture(scope="module")
def found(known: dict[str, Path]) -> list[house.Import]:
    """All its imports; not at the import of this file, which every worker of a run pays for."""
    return house.imports(known)


def test_every_module_stands_on_a_floor(known: dict[str, Path]) -> None:
    rooms = {room for floor in house.FLOORS for room in floor}
    assert {house.room(name) for name in known} == rooms


def test_no_import_runs_back(found: list[house.Import]) -> None:
    assert house.running_back(found) == []


def test_no_circle(found: list[house.Import]) -> None:
    assert house.circles(found) == []


def test_the_picture_shows_every_room_and_nothing_red() -> None:
    """Run ``python docs/import_picture.py`` after adding a room."""
    picture = house.PICTURE.read_text(encoding="utf-8")
    assert all(f">{label}<" in picture for label in house.labels())
    assert house.BACK not in picture


def test_the_product_does_not_name_its_proof(known: dict[str, Path]) -> None:
    """What is in ``proof/`` depends on the product; code, comments and bundled files do not know of it."""
    names = re.compile(
        r"\b(?:challenge|benchmarks)[./]\w|\bproof/|python -m (?:challenge|benchmarks)|\"benchmarks"
    )
    bundled = (path for kind in ("csv", "json", "yaml") for path in (ROOT / "models").rglob(f"*.{kind}"))
    files = {**known, **{str(path): path for path in bundled}}
    naming = {name: names.findall(path.read_text(encoding="utf-8")) for name, path in files.items()}
    assert {name: words for name, words in naming.items() if words} == {}
