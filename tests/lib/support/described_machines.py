"""Machines from descriptions of other programs: a URDF that the machine file names, an MJCF that ``init`` reads."""

from __future__ import annotations

from pathlib import Path

from support.command import run
from support.machine_texts import machine_from
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

POSITION = "sensor: {type: position, sigma: {xyz: 0.02}}\n"


def urdf_machine(
    folder: Path, urdf: str, mechanism: str, more: str = "", *, sensor: str = POSITION
) -> Machine:
    """Return the machine of a URDF, which ``mechanism`` calls ``arm.urdf``."""
    (folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    return machine_from(folder, f"schema: truepose/machine/1\nname: arm\n{mechanism}\n{sensor}{more}", "arm")


def mjcf_machine(folder: Path, mjcf: str, *options: str) -> Machine:
    """Return the machine that ``truepose init`` makes of an MJCF."""
    (folder / "arm.xml").write_text(mjcf, encoding="utf-8")
    run("init", "--mjcf", folder / "arm.xml", "-o", folder / "m.yaml", "--force", *options)
    return load_machine(folder / "m.yaml")
