"""A plug-in that fails, wherever it does: one line that names its file and its entry, and nothing is written."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from truepose.cli import app
from truepose.models.effects.base import effects

EFFECT = """
from truepose.models.effects.base import Coefficient, Effect, effects

@effects.add("odd")
class Odd(Effect):
    slug = "odd"

    def places(self, machine):
        {places}

    def coefficients(self, machine, place, settings):
        {coefficients}

    def shifts(self, site):
        {shifts}
"""
RIGHT = {
    "places": "return [('q1',)]",
    "coefficients": "return (Coefficient('c', 'mm', 1.0),)",
    "shifts": "return {site.port('q1'): site.c['c']}",
}
SENSOR = """
import casadi as ca
import numpy as np
from truepose.models.machine.sensor import Channel, Sensor, sensors

@sensors.add("odd")
class Odd(Sensor):
    type = "odd"
    columns = {{"h": "mm"}}

    @classmethod
    def build(cls, section, context):
        {build}

    @property
    def channels(self):
        {channels}

    def predict(self, world, s):
        {predict}
"""
SENSES = {
    "build": "return cls()",
    "channels": "return (Channel('h', 'mm', 0.01, 'distance', 'tip'),)",
    "predict": "return world[2, 3]",
}
BUILDER = """
from truepose.models.machine.builder import builders

@builders.add("odd")
def build(section, context):
    {build}
"""
MACHINE = """schema: truepose/machine/1
name: odd
mechanism:
  type: {mechanism}
  joints:
    - {{name: q1, kind: prismatic, range: [-100, 100]}}
    - {{name: q2, kind: revolute, d: 50, range: [-90, 90]}}
frames: {{tool: {{in: flange, xyz: [100, 0, 0]}}}}
sensor: {{{sensor}}}
tolerances: {{length: 0.1, angle: 0.1}}
"""
POSITION = "type: position, sigma: {xyz: 0.01}"
FAILURE = "raise OSError(28, 'full')"


@pytest.fixture
def poses(tmp_path: Path) -> Path:
    path = tmp_path / "poses.csv"
    path.write_text("q1,q2\n0,0\n10,20\n-30,40\n", encoding="utf-8")
    return path


def run(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


def told(result: Result, *expected: str) -> None:
    assert result.exit_code == 2, result.output
    assert result.stdout == "" and re.fullmatch(r"error: [^\n]+\n", result.stderr), result.stderr
    assert all(re.search(text, result.stderr) for text in expected), result.stderr


def simulated(
    folder: Path, plugin: str, *words: str, mechanism: str = "serial", sensor: str = POSITION
) -> Result:
    (folder / "mine.py").write_text(plugin, encoding="utf-8")
    (folder / "m.yaml").write_text(MACHINE.format(mechanism=mechanism, sensor=sensor), encoding="utf-8")
    options = ["-o", folder / "out.csv", "--plugin", folder / "mine.py", *words]
    result = run("simulate", folder / "m.yaml", folder / "poses.csv", *options)
    assert (folder / "out.csv").exists() == (result.exit_code == 0)
    return result


@pytest.mark.parametrize("part", RIGHT)
def test_an_effect_that_fails_when_used(part: str, poses: Path) -> None:
    plugin = EFFECT.format(**{**RIGHT, part: FAILURE})
    told(simulated(poses.parent, plugin, "--effect", "odd@q1:c=0.5"), r"mine\.py: line \d+", part, "full")


@pytest.mark.parametrize("command", ["calibrate", "diagnose", "codegen"])
def test_other_commands_tell_the_same(command: str, poses: Path) -> None:
    folder = poses.parent
    right = simulated(folder, EFFECT.format(**RIGHT), "--effect", "odd@q1:c=0.5")
    assert right.exit_code == 0, right.output
    (folder / "out.csv").rename(folder / "rows.csv")
    text = (folder / "m.yaml").read_text(encoding="utf-8")
    entry = "effects: [{effect: odd, place: [q1], parameters: {c: {value: 0.5, unit: mm}}}]\n"
    (folder / "m.yaml").write_text(text + entry, encoding="utf-8")
    (folder / "mine.py").write_text(EFFECT.format(**{**RIGHT, "shifts": "return 1 / 0"}), encoding="utf-8")
    rows = [] if command == "codegen" else [folder / "rows.csv"]
    options = ["-o", folder / "result", "--plugin", folder / "mine.py", "--anyway"]
    told(
        run(command, folder / "m.yaml", *rows, *options),
        r"mine\.py",
        "shifts",
        "ZeroDivision",
    )
    assert not (folder / "result").exists()


@pytest.mark.parametrize("part", SENSES)
def test_a_sensor_that_fails_when_used(part: str, poses: Path) -> None:
    result = simulated(poses.parent, SENSOR.format(**{**SENSES, part: FAILURE}), sensor="type: odd")
    told(result, r"mine\.py: line \d+", part, "full")


def test_a_sensor_of_a_part_of_a_point_is_refused(poses: Path) -> None:
    height = SENSES | {"channels": "return (Channel('h', 'mm', 0.01, 'position', 'tip'),)"}
    told(
        simulated(poses.parent, SENSOR.format(**height), sensor="type: odd"),
        "found 1 of the three channels of kind position",
    )


def test_a_builder_that_fails_when_used(poses: Path) -> None:
    result = simulated(poses.parent, BUILDER.format(build=FAILURE), mechanism="odd")
    told(result, r"mine\.py: line \d+", "build", "full")


LOADS = {
    "syntax": (b"def broken(:\n", "SyntaxError"),
    "bytes": (b"# \xff\xfe\nx = '\xe9'\n", "SyntaxError"),
    "exit": (b"import sys\nsys.exit(3)\n", "SystemExit"),
    "base": (b"raise BaseException('no')\n", "no"),
    "generator": (b"raise StopIteration\n", "StopIteration"),
    "no class": (b"from truepose.models.effects.base import effects\neffects.add('odd')(42)\n", "effect"),
    "abstract": (
        b"from truepose.models.effects.base import Effect, effects\n"
        b"@effects.add('odd')\nclass Odd(Effect):\n    slug = 'odd'\n",
        "coefficients, places, shifts",
    ),
}


@pytest.mark.parametrize("how", LOADS)
def test_one_that_cannot_be_loaded(how: str, tmp_path: Path) -> None:
    text, words = LOADS[how]
    (tmp_path / "mine.py").write_bytes(text)
    told(run("effects", "--plugin", tmp_path / "mine.py"), r"mine\.py", words)
    assert "odd" not in set(effects)


@pytest.mark.parametrize("name", [".", "none.py", "x" * 300, "loop.py", "text.txt"])
def test_one_that_is_no_file_of_python(name: str, tmp_path: Path) -> None:
    (tmp_path / "loop.py").symlink_to("loop.py")
    (tmp_path / "text.txt").touch()
    told(run("effects", "--plugin", tmp_path / name), "expected a plugin")
