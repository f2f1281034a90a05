"""Mutants: one small change of one expression or statement each, found in a module's syntax tree.

Left alone: docstrings and all texts, annotations, decorators, ``__all__``, what only words an error (``raise``), and
guards against zero (constants below 1e-99).
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
BOUNDARY: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
}
"""Only beside a whole number: between floats the two are the same."""
COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
_PAIRS = "min max, any all, argmin argmax, minimum maximum, floor ceil, sin cos, first last, keys values, lower upper"
CALLED = {a: b for pair in _PAIRS.split(", ") for a, b in (pair.split(), pair.split()[::-1])}


@dataclass(frozen=True)
class Mutant:
    """A change of ``file`` (from the root): its bytes ``start`` to ``stop`` become ``text``.

    key: file, function and change: the same wherever in its function the line has gone.
    lines: of the statement, at least one of which a test must run to see it; none for what runs at import, of which
    ``names`` say who uses it.
    """

    key: str
    file: str
    line: int
    lines: tuple[int, ...]
    names: tuple[str, ...]
    start: int
    stop: int
    text: str

    def applied(self, source: bytes) -> bytes:
        """The module with the change."""
        return source[: self.start] + self.text.encode() + source[self.stop :]

    def compiles(self, root: Path) -> bool:
        """Whether Python takes it; what it would not take is no mutant."""
        try:
            compile(self.applied((root / self.file).read_bytes()), self.file, "exec")
        except SyntaxError:
            return False
        return True


def mutants_of(root: Path, file: str) -> list[Mutant]:
    """All mutants of one module, in the order of its lines."""
    source = (root / file).read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found: list[Mutant] = []
    seen: dict[str, int] = {}
    for node, new, statement, path in _changes(ast.parse(source), [], None):
        assert node.end_lineno and node.end_col_offset is not None
        start = starts[node.lineno - 1] + node.col_offset
        stop = starts[node.end_lineno - 1] + node.end_col_offset
        before = " ".join(source[start:stop].decode().split())
        text = ast.unparse(ast.fix_missing_locations(new))
        if isinstance(new, ast.expr) and not isinstance(
            new, ast.Constant | ast.Name | ast.Attribute | ast.Call
        ):
            text = f"({text})"
        inside = bool(path) and not path[-1].lstrip("_")[:1].isupper()
        own = _own_lines(statement) if inside else ()
        names = () if inside else tuple(n.id for n in ast.walk(statement) if isinstance(n, ast.Name))[:1]
        key = f"{file}:{'.'.join(path)}: {before} -> {text}"
        seen[key] = seen.get(key, 0) + 1
        key += f" #{seen[key]}" if seen[key] > 1 else ""
        found.append(Mutant(key, file, node.lineno, own, names, start, stop, text))
    return found


def _own_lines(statement: ast.stmt) -> tuple[int, ...]:
    """A statement's lines, of a compound one those of its head."""
    first, last = statement.lineno, statement.end_lineno or statement.lineno
    if isinstance(statement, ast.FunctionDef):  # a default: every line of the function may use it
        return tuple(range(statement.body[0].lineno, last + 1))
    body = getattr(statement, "body", None)
    return tuple(range(first, (max(first, body[0].lineno - 1) if body else last) + 1))


_Change = tuple[ast.expr | ast.stmt, ast.AST, ast.stmt, list[str]]


def _changes(node: ast.AST, path: list[str], statement: ast.stmt | None) -> Iterator[_Change]:
    """Every node to change, what it becomes, its statement, and the names of what it is in."""
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert | ast.Import | ast.ImportFrom):
        return
    if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) in ("__all__", "__slots__"):
        return
    if isinstance(node, ast.stmt):
        statement = node
    if isinstance(node, ast.If) and isinstance(node.test, ast.Name | ast.Call | ast.Attribute):
        yield node.test, ast.UnaryOp(ast.Not(), node.test), node, path
    if statement is not None and isinstance(node, ast.expr | ast.stmt):
        for new in _replacements(node):
            yield node, new, statement, path
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        path = [*path, node.name]
        if isinstance(node, ast.FunctionDef) and node.returns and ast.unparse(node.returns) == "bool":
            yield from (
                (r, ast.Return(ast.Constant(v)), r, path) for r in _returns(node) for v in (True, False)
            )
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "bases", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _changes(child, path, statement)


def _returns(function: ast.FunctionDef) -> list[ast.Return]:
    return [s for s in function.body if isinstance(s, ast.Return) and not isinstance(s.value, ast.Constant)]


def _replacements(node: ast.expr | ast.stmt) -> Iterator[ast.AST]:  # noqa: PLR0912 - one case a kind
    """What a node may become."""
    match node:
        case ast.Compare(ops=[op], left=left, comparators=[right]):
            yield ast.Compare(left, [COMPARED[type(op)]()], [right])
            if type(op) in BOUNDARY and (_whole(left) or _whole(right)):
                yield ast.Compare(left, [BOUNDARY[type(op)]()], [right])
        case ast.BinOp(op=op, left=left, right=right) if type(op) in COMPUTED and not _texts(left, right):
            yield ast.BinOp(left, COMPUTED[type(op)](), right)
        case ast.AugAssign(op=op, target=target, value=value):
            yield ast.Pass()
            if type(op) in COMPUTED and not _texts(value):
                yield ast.AugAssign(target, COMPUTED[type(op)](), value)
        case ast.BoolOp(op=op, values=values):
            yield ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
        case ast.UnaryOp(operand=operand) if not isinstance(operand, ast.Constant):
            yield operand
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value)):
            # 101 instead of 100 is hardly a change
            yield ast.Constant(value + 1 if abs(value) < 10 else 2 * value)
        case ast.Constant(value=float(value)) if value == 0.0 or abs(value) > 1e-99:
            yield ast.Constant(2.0 * value or 1.0)
        case ast.Call(func=ast.Name(id=name)) if name in CALLED:
            yield ast.Call(ast.Name(CALLED[name]), node.args, node.keywords)
        case ast.Call(func=ast.Attribute(value=value, attr=name)) if name in CALLED:
            yield ast.Call(ast.Attribute(value, CALLED[name]), node.args, node.keywords)
        case ast.IfExp(test=test, body=body, orelse=orelse):
            yield ast.IfExp(test, orelse, body)
        case ast.Expr(value=ast.Call()) | ast.Continue():
            yield ast.Pass() if isinstance(node, ast.Expr) else ast.Break()


def _whole(node: ast.expr) -> bool:
    """Whether a value is a whole number for certain."""
    match node:
        case ast.Constant(value=int()) | ast.Call(func=ast.Name(id="len" | "sum" | "int" | "round")):
            return True
        case ast.Attribute(attr="size" | "ndim"):
            return True
    return False


def _texts(*nodes: ast.expr) -> bool:
    return any(
        isinstance(n, ast.JoinedStr) or (isinstance(n, ast.Constant) and isinstance(n.value, str))
        for n in nodes
    )
