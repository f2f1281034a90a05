"""Machines from descriptions of other programs: a URDF that the machine file names, an MJCF that ``init`` reads."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from truepose.cli import app
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

POSITION = "sensor: {type: position, sigma: {xyz: 0.02}}\n"


def urdf_machine(
    folder: Path, urdf: str, mechanism: str, more: str = "", *, sensor: str = POSITION
) -> Machine:
    """Return the machine of a URDF, which ``mechanism`` calls ``arm.urdf``."""
    (folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    path = folder / "arm.yaml"
    path.write_text(f"schema: truepose/machine/1\nname: arm\n{mechanism}\n{sensor}{more}", encoding="utf-8")
    return load_machine(path)


def mjcf_machine(folder: Path, mjcf: str, *options: str) -> Machine:
    """Return the machine that ``truepose init`` makes of an MJCF."""
    (folder / "arm.xml").write_text(mjcf, encoding="utf-8")
    words = ["init", "--mjcf", str(folder / "arm.xml"), "-o", str(folder / "m.yaml"), "--force", *options]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    return load_machine(folder / "m.yaml")
