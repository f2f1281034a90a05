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
from truepose.models.load import load_machine
from truepose.models.machine.sensor import sensors
from truepose.models.registry import load_plugin

DIAL = '''
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import casadi as ca

from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import Parameter
from truepose.models.machine.sensor import Channel, Sensor, sensors
from truepose.models.file.fields import Length, Section


class Dials(Section):
    type: str
    zero: Length = 0.0


@sensors.add("{name}")
@dataclass(frozen=True)
class Dial(Sensor):
    """The tool's height."""

    zero: Parameter
    _: KW_ONLY
    sigma: float = 1e-3
    type: ClassVar[str] = "{name}"
    columns: ClassVar[Mapping[str, str]] = {{"height": "mm"}}

    @property
    def channels(self) -> tuple[Channel, ...]:
        return (Channel("height", "mm", self.sigma, "distance", "tip"),)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (self.zero,)

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Dial:
        zero = context.parse(Dials, section).zero
        return cls(context.parameter("zero", "mm", zero, ("zero",), "sensor", 10.0))

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        return world[2, 3] - s["zero"]
'''
ARM = """\
schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, range: [-100, 100]}
    - {name: q2, kind: revolute, alpha: 90, d: 300, r: 20, range: [-60, 60]}
frames: {tool: {in: flange, xyz: [200, 0, 0], tolerance: {xyz: 1}}}
sensor: {type: late-dial, zero: 0.5}
tolerances: {length: 0.1, angle: 0.1}
"""


def _plugins() -> set[str]:
    return {name for name in sys.modules if name.startswith("truepose_plugin_")}


def _dial(folder: Path, name: str = "late-dial") -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / "dial.py"
    path.write_text(DIAL.format(name=name), encoding="utf-8")
    return path


def test_a_sensor_whose_annotations_are_texts_is_fitted(tmp_path: Path) -> None:
    plugin = _dial(tmp_path)
    (tmp_path / "machine.yaml").write_text(ARM, encoding="utf-8")
    rows = [f"{20 * k - 90},{(7 * k) % 100 - 50}" for k in range(10)]
    (tmp_path / "poses.csv").write_text("\n".join(["q1,q2", *rows]) + "\n", encoding="utf-8")
    machine, poses, read, out = (str(tmp_path / n) for n in ("machine.yaml", "poses.csv", "read.csv", "out"))
    for arguments in (
        ["simulate", machine, poses, "-o", read],
        ["calibrate", machine, read, "-o", out, "--anyway"],
    ):
        done = CliRunner().invoke(app, [*arguments, "--plugin", str(plugin)])
        assert done.exit_code == 0, done.output
    assert [p.name for p in load_machine(Path(out) / "calibrated.yaml").parameters][-1] == "zero"


def test_files_of_one_name_do_not_clash(tmp_path: Path) -> None:
    first = load_plugin(_dial(tmp_path / "a"))
    second = load_plugin(_dial(tmp_path / "b", "other-dial"))
    assert first.__name__ != second.__name__
    for module, name in ((first, "late-dial"), (second, "other-dial")):
        assert sys.modules[module.__name__] is module
        kind = sensors.get(name, "")
        assert kind.type == name and pickle.loads(pickle.dumps(kind)) is kind


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
