"""Blocks of the pages in ``docs/``, and how their examples are tried.

A fence may say more than its language: the name of the file that it shows (```` ```yaml title="arm.yaml" ````), which is
written where the page's commands run.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from truepose.models.file.machine_file import write_machine

_FENCE = re.compile(r'^```(\w+)(?: (?:title=")?([^\s"]+)"?)?\n(.*?)^```', re.DOTALL | re.MULTILINE)
_OTHER_MACHINE = ("gravity", "masses", "tolerances")
"""What a page's example says of its own machine only."""


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the name of the file that it shows (empty for none), and its text."""

    language: str
    file: str
    text: str

    @property
    def whole(self) -> bool:
        """Whether it is a machine file, not a part of one."""
        return self.language == "yaml" and "\nschema:" in f"\n{self.text}"

    @property
    def fields(self) -> dict[str, Any]:
        """What a block of YAML says."""
        found: dict[str, Any] = yaml.safe_load(self.text)
        return found


def blocks(page: Path) -> list[Block]:
    """All fenced blocks of a page, in order."""
    return [Block(*found) for found in _FENCE.findall(page.read_text(encoding="utf-8"))]


def write_files(page: Path, folder: Path) -> None:
    """Write every block that shows a file."""
    for block in blocks(page):
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")


def complete(part: Mapping[str, Any], page: Path, folder: Path) -> Path:
    """A machine file with a part from a page: the page's first example has the rest."""
    whole = next(block.fields for block in blocks(page) if block.whole)
    if "mechanism" in part:
        whole = {key: value for key, value in whole.items() if key not in _OTHER_MACHINE}
    write_machine(folder / "part.yaml", {**whole, **part})
    return folder / "part.yaml"
