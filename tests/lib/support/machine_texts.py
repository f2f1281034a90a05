"""Machines by their texts."""

from __future__ import annotations

from pathlib import Path

from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine


def machine_from(folder: Path, text: str, name: str = "machine") -> Machine:
    """Return the machine of a text, by way of its file in a folder."""
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return load_machine(path)
