"""How a user's file is loaded: as a module that Python itself knows, under a name of its own, or not at all."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from truepose.cli import app
from truepose.errors import InputError
from truepose.models.effects.base import effects
from truepose.models.registry import load_plugin

BELT = """
from truepose.models.effects.base import Coefficient, Effect, effects


@effects.add("stretched-belt")
class StretchedBelt(Effect):
    slug = "stretched-belt"

    def places(self, machine):
        return []

    def coefficients(self, machine, place, settings):
        return (Coefficient("k", "rad", 0.01),)

    def shifts(self, site):
        return {}
"""


def _plugins() -> set[str]:
    return {name for name in sys.modules if name.startswith("truepose_plugin_")}


def test_files_of_one_name_do_not_clash(tmp_path: Path) -> None:
    loaded = {}
    for name in ("one-belt", "other-belt"):
        path = tmp_path / name / "belt.py"
        path.parent.mkdir()
        path.write_text(BELT.replace("stretched-belt", name), encoding="utf-8")
        loaded[name] = load_plugin(path)
    assert len({module.__name__ for module in loaded.values()}) == 2
    for name, module in loaded.items():
        assert sys.modules[module.__name__] is module
        kind = effects.get(name, "")
        assert kind.slug == name and pickle.loads(pickle.dumps(kind)) is kind


def test_a_plugin_takes_no_module_of_python_away(tmp_path: Path) -> None:
    import json

    (tmp_path / "json.py").write_text("loaded = True\n", encoding="utf-8")
    assert load_plugin(tmp_path / "json.py").loaded
    assert sys.modules["json"] is json


def test_a_file_loaded_again_is_run_again(tmp_path: Path) -> None:
    path = tmp_path / "counted.py"
    for text in ("one", "another"):
        path.write_text(f"said = {text!r}\n", encoding="utf-8")
        assert load_plugin(path).said == text
    assert len([name for name in _plugins() if name.endswith("_counted")]) == 1


@pytest.mark.parametrize(
    "text", ["import nowhere_at_all\n", "def broken(:\n", "1 / 0\n", "raise InputError\n"]
)
def test_what_cannot_be_loaded_leaves_nothing_behind(tmp_path: Path, text: str) -> None:
    before = _plugins()
    path = tmp_path / "broken.py"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"broken\.py: the plugin cannot be loaded: \w+Error"):
        load_plugin(path)
    assert _plugins() == before
    refused = CliRunner().invoke(app, ["effects", "--plugin", str(path)])
    assert refused.exit_code == 2 and len(refused.output.splitlines()) == 1
    with pytest.raises(InputError, match=r"nothing\.py: found no Python file"):
        load_plugin(tmp_path / "nothing.py")
    assert _plugins() == before


def test_what_python_finds_odd_in_a_plugin_is_not_said(tmp_path: Path) -> None:
    """A test's warnings are errors: the plug-in would not be loaded."""
    path = tmp_path / "odd.py"
    path.write_text("NAME = 'odd'\nassert NAME is not 'even'\n", encoding="utf-8")
    load_plugin(path)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('add("stretched-belt")', "add(-90)", "effect: found the name -90, expected a text"),
        ('add("stretched-belt")', 'add("")', "found the name '', expected a text"),
        ("    slug =", "    guls =", "found the slug None, expected 'stretched-belt'"),
        ('slug = "stretched-belt"', 'slug = "belt"', "found the slug 'belt', expected 'stretched-belt'"),
        ('slug = "stretched-belt"', "slug = 3", "found the slug 3, expected"),
    ],
)
def test_an_effect_is_known_by_one_name(old: str, new: str, says: str, tmp_path: Path) -> None:
    file = tmp_path / "belt.py"
    file.write_text(BELT.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=r"belt\.py") as told:
        load_plugin(file)
    assert says in str(told.value)
    assert not [name for name in effects if name == "belt" or not isinstance(name, str)]


def test_a_plugin_that_takes_a_bundled_name_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(BELT.replace("stretched-belt", "backlash"), encoding="utf-8")
    bundled = effects.get("backlash", "")
    with pytest.raises(InputError, match=r"'backlash': found the name in truepose\.models\.effects"):
        load_plugin(tmp_path / "mine.py")
    assert effects.get("backlash", "") is bundled
