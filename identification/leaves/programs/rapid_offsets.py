"""RAPID's ``Offs`` and ``RelTool`` of constants: targets that a module works out, as literals."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.identification.leaves.programs.forms import Quaternion
from truepose.identification.leaves.programs.program import NUMBER, Number, Span, replaced
from truepose.models.lie import pose_of

_CALL = re.compile(
    r"(?i)(?P<how>Offs|RelTool)\s*\(\s*(?P<name>\w+)"
    + "".join(rf"\s*,\s*(?P<{axis}>{NUMBER})" for axis in "xyz")
    + rf"\s*(?P<turns>(?:,?\s*\\\s*R[xyz]\s*:=\s*{NUMBER}\s*)*+)\)"
)
_TURN = re.compile(rf"(?i)R(?P<axis>[xyz])\s*:=\s*(?P<deg>{NUMBER})")


@dataclass(frozen=True)
class Offset:
    """A target ``name`` (lower case) that is moved (4, 4), mm, along the axes of its work object or ``of_tool``."""

    name: str
    moved: Array
    of_tool: bool

    def literal(self, text: str, numbers: Sequence[Number]) -> str:
        """Return the literal of the moved target, of that of the target with these numbers in it."""
        form, values = Quaternion(), np.array([[n.value for n in numbers[:7]]])
        pose = form.poses(values)[0]
        new = pose @ self.moved if self.of_tool else pose.copy()
        new[:3, 3] += 0.0 if self.of_tool else self.moved[:3, 3]
        told = form.numbers(new[None], values)[0].tolist()
        texts = [n.text if v == n.value else f"{v:.10f}" for v, n in zip(told, numbers, strict=False)]
        return replaced(text, [(n.start, n.end, new) for n, new in zip(numbers, texts, strict=False)])


def offset_of(mask: str, span: Span) -> Offset | None:
    """Return what a motion goes to, where that is an offset by plain numbers."""
    m = _CALL.fullmatch(mask, *span)
    if m is None:
        return None
    turns = {t["axis"].lower(): float(t["deg"]) for t in _TURN.finditer(m["turns"])}
    of_tool = m["how"].lower() == "reltool"
    if turns and not of_tool:
        return None
    turn = Rotation.from_euler("XYZ", [turns.get(axis, 0.0) for axis in "xyz"], degrees=True).as_matrix()
    moved = pose_of(turn, [float(m[axis]) for axis in "xyz"])
    return Offset(m["name"].lower(), moved, of_tool)
