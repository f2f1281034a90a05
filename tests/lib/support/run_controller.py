"""An evaluator that runs the text of a small robot program as a controller does, in three dialects.

Nothing here is the product's code: lines are read by patterns of this file, poses are numpy's. mm and rad inside.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from support.program_robots import Arm
from support.run_programs import DRAWN, Q0
from truepose.arrays import Array


@dataclass(frozen=True)
class Moved:
    """A motion that was run: its line, the pose (4, 4) in the robot's base, and the tool."""

    line: int
    pose: Array
    tool: Array


class Controller:
    """Runs the first function of a text line by line: branches where ``taken``, loops twice."""

    def __init__(self, dialect: str, text: str, taken: bool) -> None:
        self.dialect, self.taken = dialect, taken
        self.lines = [re.sub(r"!.*", "", line).strip() for line in text.splitlines()]
        self.values: dict[str, Array] = {"wobj0": np.eye(4)}
        self.base, self.tool = np.eye(4), np.eye(4)
        self.moved: list[Moved] = []
        ends = [k for k, line in enumerate(self.lines) if re.fullmatch(r"(?i)end(proc)?", line)]
        self.called: tuple[str, int, int] = ("", 0, 0)
        for k, line in enumerate(self.lines):
            if m := re.match(r"(?i)(?:def|proc) go\((?:robtarget )?(\w+)", line):
                self.called = (m[1], k, next(end for end in ends if end > k))
        _, begin, end = self.called
        whole = (
            [(0, begin), (end + 1, len(self.lines))]
            if dialect == "urscript"
            else [(0, begin or len(self.lines))]
        )
        for one in whole:
            self._block(*one)

    def _block(self, begin: int, end: int) -> None:
        k = begin
        while k < end:
            how = re.match(r"(?i)(if|loop|while)\b", self.lines[k])
            if how is None:
                self._line(k)
                k += 1
                continue
            stop = next(j for j in range(k, end) if re.fullmatch(r"(?i)end(if|loop|while)?", self.lines[j]))
            for _ in range(int(self.taken) if how[1].lower() == "if" else 2):
                self._block(k + 1, stop)
            k = stop + 1

    def _line(self, k: int) -> None:
        line = self.lines[k].rstrip(";")
        if m := re.match(r"go\((.*)\)$|go (.*)$", line):
            self._call(self.value(m[1] or m[2]))
        elif m := re.match(
            r"PERS (?:tooldata|wobjdata) (\w+):=[^\[]*\[(?:TRUE|FALSE,TRUE,\"\"),(\[\[.*?\],\[.*?\]\])", line
        ):
            self.values[m[1]] = self.value(m[2])
        elif m := re.match(r"MoveL (.*),v100,fine,(\w+)\\WObj:=(\w+)$", line):
            self.moved.append(Moved(k + 1, self.values[m[3]] @ self.value(m[1]), self.values[m[2]]))
        elif m := re.match(r"movel\((.*), a=1.2, v=0.25\)$", line):
            self.moved.append(Moved(k + 1, self.value(m[1]), self.tool))
        elif m := re.match(r"LIN (.*)$", line):
            self.moved.append(Moved(k + 1, self.base @ self.value(m[1]), self.tool))
        elif m := re.match(r"set_tcp\((.*)\)$|\$TOOL=(.*)$", line):
            self.tool = self.value(m[1] or m[2])
        elif m := re.match(r"\$BASE=(.*)$", line):
            self.base = self.value(m[1])
        elif m := re.match(r"(\$?\w+)(?:\.X|\.uframe\.trans\.x|\[0\])\s*:?=\s*(.*)$", line):
            self._shift(m[1], float(m[2]) * (1000.0 if self.dialect == "urscript" else 1.0))
        elif m := re.match(r"(?:VAR robtarget )?(\w+)\s*:?=\s*(.*)$", line):
            self.values[m[1]] = self.value(m[2])

    def _shift(self, name: str, value: float) -> None:
        moved = {"$BASE": self.base, "$TOOL": self.tool}.get(name, self.values.get(name, np.eye(4))).copy()
        moved[0, 3] = value
        self.values[name] = moved
        self.base = moved if name == "$BASE" else self.base
        self.tool = moved if name == "$TOOL" else self.tool

    def _call(self, argument: Array) -> None:
        """Run the function; what its parameter hides comes back behind it."""
        name, begin, end = self.called
        hidden = self.values.get(name)
        self.values[name] = argument
        self._block(begin + 1, end)
        self.values.pop(name)
        if hidden is not None:
            self.values[name] = hidden

    def value(self, text: str) -> Array:
        """The pose (4, 4) of an expression."""
        text = text.strip()
        if m := re.match(r"(Offs|RelTool)\((.*),([^,]*),([^,]*),([^,]*)\)$", text):
            out, step = self.value(m[2]).copy(), np.array([float(m[k]) for k in (3, 4, 5)])
            out[:3, 3] += step if m[1] == "Offs" else out[:3, :3] @ step
            return out
        if text.startswith("pose_trans("):
            inside = text[len("pose_trans(") : -1]
            depths = np.cumsum([(c in "([") - (c in ")]") for c in inside])
            cut = next(k for k, c in enumerate(inside) if c == "," and depths[k] == 0)
            return self.value(inside[:cut]) @ self.value(inside[cut + 1 :])
        if ":" in text:
            first, _, rest = text.partition(":")
            return self.value(first) @ self.value(rest)
        if text in self.values:
            return self.values[text]
        numbers = [float(v) for v in re.findall(r"(?<![A-Za-z\d])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?", text)]
        out = np.eye(4)
        if self.dialect == "kuka":
            out[:3, :3] = Rotation.from_euler("ZYX", numbers[3:6], degrees=True).as_matrix()
        elif self.dialect == "rapid":
            out[:3, :3] = Rotation.from_quat(np.roll(numbers[3:7], -1)).as_matrix()
        else:
            out[:3, :3] = Rotation.from_rotvec(numbers[3:6]).as_matrix()
        out[:3, 3] = np.array(numbers[:3]) * (1000.0 if self.dialect == "urscript" else 1.0)
        return out


def stands(moved: Moved, arm: Arm) -> Array:
    """Where an arm's tool comes (4, 4) when a controller that believes the drawing is sent there."""
    q = DRAWN.with_tool(moved.tool).inverse(moved.pose, Q0)
    return arm.with_tool(moved.tool).pose(q)
