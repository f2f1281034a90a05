"""The section ``forces`` of a machine file: forces that a recording's columns hold, and where they push at the machine."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator

from truepose.models.file.fields import LengthVector, Section, bad_value

FORCE, WRENCH = 3, 6
"""How many columns a force alone has, and one with its moment."""


class ForceSection(Section):
    """A measured force, with or without a moment."""

    columns: tuple[str, ...]
    """Columns of the recording: the force along x, y, z (N) and, where six are named, the moment about them (N*m)."""
    in_: str = Field(default="tool", alias="in")
    """What it pushes at: `tool`, a further frame (that of the force sensor), or a body as for masses."""
    at: LengthVector = (0.0, 0.0, 0.0)
    """The point that it pushes at, in that frame; moments are about it."""
    axes: str | None = None
    """Frame along whose axes the columns are given: `base`, `tool`, a further frame or a body; left out: that of `in`."""
    sign: Literal[1, -1] = 1
    """1: the columns hold what pushes at the machine; -1: what the machine pushes with."""

    @field_validator("columns")
    @classmethod
    def _three_or_six(cls, columns: tuple[str, ...]) -> tuple[str, ...]:
        if len(columns) not in (FORCE, WRENCH) or len(set(columns)) != len(columns) or not all(columns):
            raise bad_value(
                "3 names of columns (force) or 6 (force, then moment), all different", list(columns)
            )
        return columns


__all__ = ["FORCE", "WRENCH", "ForceSection"]
