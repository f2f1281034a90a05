"""A machine file without a sensor: what needs none goes on, all else says so in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.command import refused, run

ARM = """
schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-150, 150]}
    - {name: q2, kind: revolute, alpha: -90, d: 100, range: [-90, 90]}
    - {name: q3, kind: prismatic, alpha: 90, r: 200, range: [-50, 50]}
tolerances: {length: 0.1, angle: 0.1}
"""
ROWS = "q1,q2,q3\n" + "".join(f"{10 * k},{5 * k - 20},{k}\n" for k in range(12))


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    (tmp_path / "rows.csv").write_text(ROWS, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "command",
    [
        "predict arm.yaml rows.csv -o out.csv",
        "simulate arm.yaml rows.csv -o out.csv",
        "calibrate arm.yaml rows.csv -o out --anyway",
        "diagnose arm.yaml rows.csv -o out --anyway",
        "drift arm.yaml rows.csv rows.csv -o out --anyway",
        "identifiability arm.yaml rows.csv -o out",
        "plan arm.yaml -n 4 -o out.csv",
    ],
)
def test_what_needs_a_sensor_is_refused_in_one_line(command: str, here: Path) -> None:
    refused(command, said="sensor")
    assert not (here / "out").exists() and not (here / "out.csv").exists()


@pytest.mark.parametrize("command", ["codegen arm.yaml -o out", "export arm.yaml -o out.urdf"])
def test_what_needs_none_goes_on(command: str) -> None:
    run(command)
