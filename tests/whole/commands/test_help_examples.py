"""Every example that ``--help`` shows runs as it stands there, beside small files of the names that it uses."""

from __future__ import annotations

import inspect
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from support.simulated import machine_from
from support.tiny_fleets import write_fleet
from truepose.cli import app

EXAMPLE = re.compile(r"^\s*Example: (truepose .*)$", re.MULTILINE)
HEAVY = (
    "numpy",
    "casadi",
    "pandas",
    "scipy",
    "pint",
    "pydantic",
    "pyarrow",
    "jinja2",
    "joblib",
    "yaml",
)
COMMANDS = {
    command.callback.__name__: command.callback
    for command in app.registered_commands
    if command.callback and not command.hidden
}
NAMES = {name: name.rstrip("_").replace("_", "-") for name in COMMANDS}
SLOW = ("demo",)
"""Examples of these take long: tests of their own run the same commands on less."""
MACHINE = """
schema: truepose/machine/1
name: arm
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-100, 100]}
    - {name: q2, kind: revolute, alpha: 90, d: 25, range: [-60, 60]}
    - {name: q3, kind: revolute, d: 450, range: [-60, 60]}
    - {name: rho4, kind: revolute, alpha: 90, d: 35, r: 420, range: [-90, 90]}
    - {name: q5, kind: revolute, alpha: -90, range: [20, 90]}
    - {name: q6, kind: revolute, alpha: 90, range: [-90, 90]}
frames:
  base: {in: world, tolerance: {xyz: 1, rpy: 0.1}}
  tool: {in: flange, xyz: [60, 30, 40], tolerance: {xyz: 1}}
masses: {payload: {kg: 1, com: [0, 0, 0], in: tool}}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0.1, angle: 0.1}
"""

TABLE = """name,a [mm],alpha [deg],d [mm],theta [deg]
q1,25,-90,400,0
q2,560,0,0,-90
q3,35,-90,0,0
q4,0,90,515,0
q5,0,-90,0,0
q6,0,0,80,0
"""
POINTS = """// SpatialAnalyzer, units: mm
Cell::A::P1, 1240.512, -318.227, 902.118
Cell::A::P2, 1105.090, -77.914, 1210.332
"""
JOINTS = """point,q1,q2,q3,q4,q5,q6
P1,-31.2,42.0,-18.5,101.0,-40.3,12.0
P2,-8.0,20.5,-31.0,66.0,-71.9,-88.0
"""
JOB = """DEF job()
$BASE=BASE_DATA[1]
PTP {A1 10.0,A2 20.0,A3 -15.0,A4 30.0,A5 45.0,A6 5.0}
END
"""


def examples() -> list[str]:
    """Every command line."""
    found = [line for text in COMMANDS.values() for line in EXAMPLE.findall(inspect.getdoc(text) or "")]
    return [part.strip() for line in found for part in line.split(";")]


EXAMPLES = [line for line in examples() if shlex.split(line)[1] not in SLOW]
READ = [
    line
    for line in EXAMPLES
    if shlex.split(line)[1] in ("calibrate", "diagnose") and "improved.yaml" not in line
]
"""Examples whose results others read."""


def run(arguments: list[str]) -> Result:
    return CliRunner().invoke(app, arguments)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Small files of the names that the examples use: an arm that gives way and has play, and what was read of it."""
    folder = tmp_path_factory.mktemp("examples")
    rng = np.random.default_rng(1)
    machine = machine_from(folder, MACHINE, "machine")
    ranges = {a.reading: np.degrees(a.range).tolist() for a in machine.mechanism.actuators if a.range}
    for name, rows in (("poses.csv", 30), ("path.csv", 5)):
        values = {joint: rng.uniform(low, high, rows) for joint, (low, high) in ranges.items()}
        way = {f"approach.{joint}": rng.choice([-1, 1], rows) for joint in ("q2", "q3")}
        weight = {"payload": rng.choice([0.0, 2.5, 5.0], rows)}
        pd.DataFrame(values | way | weight).to_csv(folder / name, index=False)
    effect = ["--effect", "joint-compliance@q2:c=2e-5", "--effect", "backlash@q3:b=1e-3"]
    for seed, name in enumerate(
        ("recording.csv", "day0.csv", "day1.csv", "day2.csv", "day8.csv", "other.csv")
    ):
        made = run(["simulate", str(folder / "machine.yaml"), str(folder / "poses.csv"), "-o", str(folder / name), *effect,
                    "--seed", str(seed)])  # fmt: skip
        assert made.exit_code == 0, made.output
    for name, text in (("kr10.csv", TABLE), ("points.txt", POINTS), ("joints.csv", JOINTS), ("job.src", JOB)):
        (folder / name).write_text(text, encoding="utf-8")
    write_fleet(folder / "line1", {"a": []})
    points = rng.uniform(-100, 100, (4, 3))
    pd.DataFrame(points, columns=["x", "y", "z"]).assign(point=["P1", "P2", "P3", "P4"]).to_csv(
        folder / "body.csv", index=False
    )
    seen = {
        f"P{k + 1}.{axis}": points[k, j] + rng.normal(0.0, 0.005, 6)
        for k in range(4)
        for j, axis in enumerate("xyz")
    }
    pd.DataFrame(seen).to_csv(folder / "points.csv", index=False)
    return folder


@pytest.fixture(scope="module")
def ran() -> dict[str, Result]:
    """Examples that ran, with what came out."""
    return {}


def tried(line: str, folder: Path, ran: dict[str, Result]) -> Result:
    """Run an example once; first those whose results it reads, which another worker may have had to try."""
    for needed in READ:
        if line not in READ:
            tried(needed, folder, ran)
    if line not in ran:
        kept = (folder / "recording.csv").read_bytes(), (folder / "poses.csv").read_bytes()
        ran[line] = run(shlex.split(line)[1:])
        (folder / "recording.csv").write_bytes(kept[0])
        (folder / "poses.csv").write_bytes(kept[1])
    return ran[line]


@pytest.mark.parametrize("line", EXAMPLES)
def test_the_example_runs(
    line: str, folder: Path, ran: dict[str, Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    done = tried(line, folder, ran)
    assert done.exit_code == 0, f"{line}\n{done.output}"


def test_every_command_has_an_example_that_is_run_here_or_where_it_says() -> None:
    told = {shlex.split(line)[1] for line in examples()}
    assert told == set(NAMES.values())


@pytest.mark.parametrize("arguments", [["--help"], ["-h"], ["calibrate", "--help"], ["--version"]])
def test_help_waits_for_no_library(arguments: list[str]) -> None:
    """What takes long to import is imported when it is needed: help is there in a fifth of a second.

    The help of one command may take pydantic, with which newer versions of typer read types.
    """
    heavy = [name for name in HEAVY if name != "pydantic" or arguments[0].startswith("-")]
    probe = (
        "import sys, truepose.cli\n"
        f"sys.argv = ['truepose', *{arguments!r}]\n"
        "try:\n    truepose.cli.main()\nexcept SystemExit:\n    pass\n"
        f"sys.stderr.write(' '.join(name for name in {heavy!r} if name in sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout and done.stderr == ""
