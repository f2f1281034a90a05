"""Small robot programs drawn at random, printed in three dialects, and an evaluator that runs their text as a controller does.

Nothing here is the product's code: lines are read by patterns of this file, poses are numpy's. mm and rad inside.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from support.program_robots import Arm, arms, frame, numbers_of

Array = NDArray[np.float64]
Q0 = np.array([0.35, 0.25, -0.3, 0.4, 0.9, -0.5])
"""Joints far from singular poses and ends of ranges; all that is drawn is near."""
DRAWN, REAL = arms()
TOOLS = [frame((12.0, -7.0, 93.0, 3.0, -5.0, 20.0)), frame((30.0, 0.0, 80.0, 0.0, 20.0, 15.0))]
FAR, NEAR = ("wa", "wb"), ("fc", "fd")
"""Names of waypoints, and of small frames and offsets."""
Expr = tuple[Any, ...]
Node = tuple[Any, ...]


def _far(numbers: list[float]) -> Array:
    return DRAWN.with_tool(TOOLS[0]).pose(Q0 + 0.08 * np.array(numbers))


def _near(numbers: list[float]) -> Array:
    return frame((*(15.0 * v for v in numbers[:3]), *(4.0 * v for v in numbers[3:])))


SIX = st.lists(st.floats(-1, 1).map(lambda v: round(v, 3)), min_size=6, max_size=6)
FAR_LITERAL = SIX.map(lambda n: ("literal", _far(n)))
NEAR_LITERAL = SIX.map(lambda n: ("literal", _near(n)))
NEAR_NAME, FAR_NAME = (
    st.sampled_from(NEAR).map(lambda n: ("name", n)),
    st.sampled_from(FAR).map(lambda n: ("name", n)),
)
NEAR_EXPR = st.one_of(NEAR_NAME, NEAR_LITERAL, st.tuples(st.just("product"), NEAR_NAME, NEAR_LITERAL))
FAR_EXPR = st.one_of(
    FAR_NAME, FAR_NAME, FAR_LITERAL,
    st.tuples(st.just("product"), NEAR_EXPR, FAR_NAME), st.tuples(st.just("product"), FAR_NAME, NEAR_EXPR),
    st.tuples(st.just("product"), NEAR_NAME, st.tuples(st.just("product"), NEAR_LITERAL, FAR_NAME)),
)  # fmt: skip
OFFSETS = st.tuples(
    st.sampled_from(["Offs", "RelTool"]), st.sampled_from(FAR), st.tuples(*[st.integers(-20, 20)] * 3)
)
"""RAPID's expressions: its poses have no products."""


def programs(dialect: str, blocks: bool) -> st.SearchStrategy[list[Node]]:
    """Lists of statements; with ``blocks`` some of them in branches and loops."""
    far = st.one_of(FAR_NAME, FAR_LITERAL, OFFSETS) if dialect == "rapid" else FAR_EXPR
    whole = FAR_LITERAL if dialect == "rapid" else far
    kinds: list[st.SearchStrategy[Node]] = [
        *[st.tuples(st.just("move"), far)] * 4,
        st.tuples(st.just("assign"), st.sampled_from(FAR), whole),
        st.tuples(st.just("tool"), st.sampled_from([0, 1])),
        st.tuples(st.just("base"), st.one_of(NEAR_NAME, NEAR_LITERAL)),
    ]
    if dialect != "rapid":
        kinds.append(st.tuples(st.just("assign"), st.sampled_from(NEAR), NEAR_LITERAL))
    if dialect == "urscript":
        kinds = [kind for k, kind in enumerate(kinds) if k != 6]
    one = st.one_of(kinds)
    body = st.lists(one, min_size=1, max_size=3)
    if blocks:
        one = st.one_of(one, one, st.tuples(st.sampled_from(["if", "loop"]), body))
    return st.lists(one, min_size=2, max_size=6)


def _expression(dialect: str, expr: Expr) -> str:
    kind = expr[0]
    if kind == "name":
        return str(expr[1])
    if kind == "literal":
        return literal(dialect, expr[1])
    if kind == "product":
        first, second = (_expression(dialect, one) for one in expr[1:])
        return f"{first}:{second}" if dialect == "kuka" else f"pose_trans({first}, {second})"
    return f"{kind}({expr[1]},{','.join(map(str, expr[2]))})"


def literal(dialect: str, pose: Array) -> str:
    text = numbers_of(pose, dialect)
    return f"{text[:-1]},[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]" if dialect == "rapid" else text


def written(dialect: str, nodes: list[Node]) -> str:
    """The text of a program, every statement in a line."""
    start = [("assign", name, ("literal", _far([0.5 - k] * 6))) for k, name in enumerate(FAR)]
    near = [("assign", name, ("literal", _near([0.7 - k] * 6))) for k, name in enumerate(NEAR)]
    head: list[Node] = [*start, *([] if dialect == "rapid" else near), ("tool", 0)]
    own = {"base": "wobj0", "tool": "tool0"}
    joints = np.degrees(Q0) if dialect != "urscript" else Q0
    told = ",".join(f"{v:.6f}" for v in joints)
    first = {
        "kuka": "PTP {" + ",".join(f"A{k + 1} {v:.6f}" for k, v in enumerate(joints)) + "}",
        "rapid": f"MoveAbsJ [[{told}],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;",
        "urscript": f"movej([{told}])",
    }[dialect]
    body = [*_lines(dialect, head, own), first, *_lines(dialect, nodes, own)]
    if dialect == "kuka":
        return "\n".join(["DEF job()", *body, "END", ""])
    if dialect == "urscript":
        return "\n".join(["def job():", *body, "end", ""])
    tools = [
        f"PERS tooldata t{k}:=[TRUE,{numbers_of(t, 'rapid')},[1,[0,0,1],[1,0,0,0],0,0,0]];"
        for k, t in enumerate(TOOLS)
    ]
    bases = [
        f'PERS wobjdata {name}:=[FALSE,TRUE,"",{numbers_of(_near([0.7 - k] * 6), "rapid")},[[0,0,0],[1,0,0,0]]];'
        for k, name in enumerate(NEAR)
    ]
    return "\n".join(
        ["MODULE job", *tools, *bases, "PROC main()", "ConfL\\Off;", *body, "ENDPROC", "ENDMODULE", ""]
    )


def _lines(dialect: str, nodes: list[Node], own: dict[str, str]) -> Iterator[str]:
    opened = {"kuka": ("IF C THEN", "ENDIF", "LOOP", "ENDLOOP"), "rapid": ("IF c THEN", "ENDIF", "WHILE c DO", "ENDWHILE"),
              "urscript": ("if c:", "end", "while c:", "end")}[dialect]  # fmt: skip
    for kind, *rest in nodes:
        if kind in ("if", "loop"):
            begin, end = opened[:2] if kind == "if" else opened[2:]
            yield from (begin, *_lines(dialect, rest[0], own), end)
        elif kind == "assign":
            text = _expression(dialect, rest[1])
            first = rest[0] not in own
            own[rest[0]] = ""
            sign = {"kuka": "=", "urscript": " = "}.get(dialect, ":=")
            yield f"{'VAR robtarget ' if dialect == 'rapid' and first else ''}{rest[0]}{sign}{text}{';' * (dialect == 'rapid')}"
        elif kind == "move":
            text = _expression(dialect, rest[0])
            tail = f",v100,fine,{own['tool']}\\WObj:={own['base']};"
            yield {"kuka": f"LIN {text}", "urscript": f"movel({text}, a=1.2, v=0.25)"}.get(
                dialect, f"MoveL {text}{tail}"
            )
        elif kind == "tool":
            own["tool"] = f"t{rest[0]}"
            told = literal(dialect, TOOLS[rest[0]]) if dialect != "rapid" else ""
            yield {"kuka": f"$TOOL={told}", "urscript": f"set_tcp({told})"}.get(dialect, "! tool")
        elif kind == "base":
            if dialect == "rapid":
                own["base"] = rest[0][1] if rest[0][0] == "name" else "wobj0"
            yield f"$BASE={_expression(dialect, rest[0])}" if dialect == "kuka" else "! base"


@dataclass(frozen=True)
class Moved:
    """A motion that was run: its line, the pose (4, 4) in the robot's base, and the tool."""

    line: int
    pose: Array
    tool: Array


class Controller:
    """Runs a text line by line: branches where ``taken``, loops twice."""

    def __init__(self, dialect: str, text: str, taken: bool) -> None:
        self.dialect, self.taken = dialect, taken
        self.lines = [re.sub(r"!.*", "", line).strip() for line in text.splitlines()]
        self.values: dict[str, Array] = {"wobj0": np.eye(4)}
        self.base, self.tool = np.eye(4), np.eye(4)
        self.moved: list[Moved] = []
        self._block(0, len(self.lines))

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
        if m := re.match(
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
        elif m := re.match(r"(?:VAR robtarget )?(\w+)\s*:?=\s*(.*)$", line):
            self.values[m[1]] = self.value(m[2])

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


__all__ = ["DRAWN", "REAL", "Controller", "Moved", "Node", "programs", "stands", "written"]
