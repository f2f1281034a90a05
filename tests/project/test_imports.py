"""The house keeps its floors: no import runs back, none runs in a circle, and every module has a room."""

from __future__ import annotations

from pathlib import Path

import pytest

import import_picture as house


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


@pytest.mark.parametrize("product", ["cli", "models.load", "identification.diagnosis.engine", "codegen.c"])
def test_the_product_may_not_import_the_examination(product: str, known: dict[str, Path]) -> None:
    proof = [name for name in known if name.partition(".")[0] == house.OUTSIDE]
    assert {"challenge", "challenge.cases", "challenge.simulator.base"} <= set(proof)
    assert len(house.running_back([house.Import(product, name, True) for name in proof])) == len(proof)
    assert not house.running_back([house.Import(name, product, False) for name in proof])
