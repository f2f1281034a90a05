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


@pytest.mark.parametrize(
    ("text", "user", "used", "lazy"),
    [
        ("from truepose.b import c", "a", "b", False),
        ("from truepose import b", "a", "b", False),
        ("import truepose.b", "a", "b", False),
        ("from .b import c", "a", "b", False),
        ("from . import c", "p.a", "p.c", False),
        ("def f():\n    from truepose.b import c", "a", "b", True),
        ("if TYPE_CHECKING:\n    from truepose.b import c", "a", "b", False),
        ("import challenge", "a", "challenge", False),
        ("from challenge import cases", "a", "challenge.cases", False),
        ("def f():\n    from challenge.cases import Case", "a", "challenge.cases", True),
        ("from . import cases", "challenge.score", "challenge.cases", False),
        ("from truepose.b import c", "challenge.score", "b", False),
    ],
)
def test_every_way_to_import_is_seen(tmp_path: Path, text: str, user: str, used: str, lazy: bool) -> None:
    known = {user: tmp_path / "user.py", used: tmp_path / "used.py"}
    known[user].write_text(text, encoding="utf-8")
    known[used].write_text("", encoding="utf-8")
    assert house.imports(known) == [house.Import(user, used, lazy)]


def test_a_circle_through_a_lazy_import_is_found(tmp_path: Path) -> None:
    known = {name: tmp_path / f"{name}.py" for name in "abc"}
    for name, text in zip(
        "abc", ("import truepose.b", "def f():\n    import truepose.a", "import truepose.a"), strict=True
    ):
        known[name].write_text(text, encoding="utf-8")
    assert house.circles(house.imports(known)) == [["a", "b"]]


@pytest.mark.parametrize("product", ["cli", "models.load", "identification.diagnosis.diagnose", "codegen.c"])
def test_the_product_may_not_import_the_examination(product: str, known: dict[str, Path]) -> None:
    proof = [name for name in known if name.partition(".")[0] == house.OUTSIDE]
    assert {"challenge", "challenge.cases", "challenge.simulator.base"} <= set(proof)
    assert len(house.running_back([house.Import(product, name, True) for name in proof])) == len(proof)
    assert not house.running_back([house.Import(name, product, False) for name in proof])


def test_an_import_from_above_runs_back() -> None:
    up, down = house.Import("models.load", "cli", True), house.Import("cli", "models.load", False)
    assert house.running_back([up, down]) == [up]
