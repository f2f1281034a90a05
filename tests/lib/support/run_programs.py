"""Small robot programs drawn at random, printed in three dialects. Nothing here is the product's code. mm and rad inside."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from hypothesis import strategies as st

from support.program_robots import arms, frame, numbers_of
from truepose.arrays import Array

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
        one = st.one_of(one, one, st.tuples(st.just("shift"), st.sampled_from([0, 1]), st.integers(-20, 20)))
        one = st.one_of(one, one, st.tuples(st.sampled_from(["if", "loop"]), body))
    return st.lists(one, min_size=2, max_size=6)


def functions(dialect: str) -> st.SearchStrategy[tuple[str, list[Node], list[Node]]]:
    """A parameter, often with the name of a waypoint, the statements of its function, and a program that calls it."""
    far = st.one_of(FAR_NAME, FAR_LITERAL)
    move = st.tuples(st.just("move"), far)
    assign = st.tuples(st.just("assign"), st.sampled_from(FAR), FAR_LITERAL)
    tool = st.tuples(st.just("tool"), st.sampled_from([0, 1]))
    base = st.tuples(st.just("base"), NEAR_NAME)
    body = st.lists(st.one_of(move, move, assign, tool, base), min_size=1, max_size=3)
    call = st.tuples(st.just("call"), far)
    main = st.lists(st.one_of(move, call, call, assign, tool, base), min_size=2, max_size=6)
    return st.tuples(st.sampled_from((*FAR, "wp")), body, main)


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


def written(dialect: str, nodes: list[Node], function: tuple[str, list[Node]] | None = None) -> str:
    """The text of a program, every statement in a line; ``function`` has the name of a parameter, and statements."""
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
    called: list[str] = []
    if function is not None:
        begin, end = {"kuka": ("DEF go({}:IN)", "END"), "rapid": ("PROC go(robtarget {})", "ENDPROC"),
                      "urscript": ("def go({}):", "end")}[dialect]  # fmt: skip
        called = [begin.format(function[0]), *_lines(dialect, function[1], own), end]
    if dialect == "kuka":
        return "\n".join(["DEF job()", *body, "END", *called, ""])
    if dialect == "urscript":
        return "\n".join(["def job():", *called, *body, "end", ""])
    tools = [
        f"PERS tooldata t{k}:=[TRUE,{numbers_of(t, 'rapid')},[1,[0,0,1],[1,0,0,0],0,0,0]];"
        for k, t in enumerate(TOOLS)
    ]
    bases = [
        f'PERS wobjdata {name}:=[FALSE,TRUE,"",{numbers_of(_near([0.7 - k] * 6), "rapid")},[[0,0,0],[1,0,0,0]]];'
        for k, name in enumerate(NEAR)
    ]
    main = ["PROC main()", "ConfL\\Off;", *body, "ENDPROC"]
    return "\n".join(["MODULE job", *tools, *bases, *main, *called, "ENDMODULE", ""])


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
        elif kind == "shift":
            yield from _shift(dialect, *rest)
        elif kind == "call":
            text = _expression(dialect, rest[0])
            yield f"go {text};" if dialect == "rapid" else f"go({text})"
        elif kind == "tool":
            own["tool"] = f"t{rest[0]}"
            told = literal(dialect, TOOLS[rest[0]]) if dialect != "rapid" else ""
            yield {"kuka": f"$TOOL={told}", "urscript": f"set_tcp({told})"}.get(dialect, "! tool")
        elif kind == "base":
            if dialect == "rapid":
                own["base"] = rest[0][1] if rest[0][0] == "name" else "wobj0"
            yield f"$BASE={_expression(dialect, rest[0])}" if dialect == "kuka" else "! base"


def _shift(dialect: str, which: int, value: int) -> Iterator[str]:
    """A component of the base, or of a frame or tool in force, is changed."""
    if dialect == "kuka":
        yield f"{('$BASE', '$TOOL')[which]}.X={value}"
    elif dialect == "rapid":
        yield f"{NEAR[which]}.uframe.trans.x:={value};"
    else:
        yield f"{NEAR[which]}[0] = {value / 1000}"
        yield from ["set_tcp(fd)"] * which
