"""A machine file that states no tolerance: all is exactly known, and whatever would fit says what is missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

import truepose
from truepose.cli import app
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

ARM = """\
schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, range: [-100, 100]}
    - {name: q2, kind: revolute, alpha: 90, d: 300, r: 20, range: [-60, 60]}
frames: {tool: {in: flange, xyz: [150, 0, 40]}}
sensor: {type: position, sigma: {xyz: 0.01}}
"""
POSES = "q1,q2\n" + "".join(f"{20 * k - 95},{(37 * k) % 101 - 50}\n" for k in range(10))


def _read(folder: Path, stated: str) -> tuple[Path, Path]:
    """An arm with or without tolerances, and a recording of it."""
    machine, recording = folder / "machine.yaml", folder / "recording.csv"
    machine.write_text(ARM + stated, encoding="utf-8")
    (folder / "poses.csv").write_text(POSES, encoding="utf-8")
    command = ["simulate", str(machine), str(folder / "poses.csv"), "-o", str(recording)]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    return machine, recording


@pytest.mark.parametrize(
    "command",
    [
        *(["calibrate", "--estimator", name] for name in ("map", "ols", "liu", "ridge", "pcr", "huber")),
        *(["calibrate", "--solver", name] for name in ("gn", "lm", "ipopt")),
        ["diagnose"],
        ["identifiability"],
        ["plan", "-n", "6"],
    ],
    ids=" ".join,
)
def test_a_command_is_told_too_and_writes_nothing(tmp_path: Path, command: Sequence[str]) -> None:
    machine, rows = map(str, _read(tmp_path, ""))
    out = tmp_path / "out"
    recording = [] if command[0] == "plan" else [rows]
    done = CliRunner().invoke(app, [*command, machine, *recording, "-o", str(out)])
    assert done.exit_code == 2, done.output
    assert done.output.startswith(f"error: {machine}: tolerances: found no free parameter")
    assert len(done.output.splitlines()) == 1 and not out.exists()


@pytest.mark.parametrize("job", [truepose.calibrate, truepose.diagnose])
def test_tolerances_of_frames_alone_are_enough(
    tmp_path: Path, job: Callable[[Machine, Recording], object]
) -> None:
    tool = "xyz: [150, 0, 40]"
    machine_file, rows = _read(tmp_path, "")
    text = machine_file.read_text(encoding="utf-8").replace(tool, f"{tool}, tolerance: {{xyz: 1}}")
    machine_file.write_text(text, encoding="utf-8")
    machine = load_machine(machine_file)
    assert {p.name for p in machine.parameters if p.free} == {"tool.x", "tool.y", "tool.z"}
    assert job(machine, truepose.load_recording(machine, [rows])) is not None
