"""Formulas that a machine file writes as text: read by their syntax tree, never executed, into CasADi expressions.

Numbers, names that are known, ``+ - * / **``, brackets, and the functions below. Angles are in the file's unit, in and out.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final

import casadi as ca

from truepose.errors import InputError
from truepose.models.file.fields import as_number
from truepose.wording import close_matches

LONGEST: Final = 1000
"""Characters of a formula: a linkage's law takes a hundred."""
Functions = Mapping[str, Callable[..., ca.SX]]
_POWERS: Final[Mapping[type[ast.operator], Callable[[ca.SX, ca.SX], ca.SX]]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_OF_ANGLES: Final[Functions] = {"sin": ca.sin, "cos": ca.cos, "tan": ca.tan}
_TO_ANGLES: Final[Functions] = {"asin": ca.asin, "acos": ca.acos, "atan": ca.atan, "atan2": ca.atan2}
_PLAIN: Final[Functions] = {"sqrt": ca.sqrt, "abs": ca.fabs}
_BY_NAME: Final[Functions] = {**_OF_ANGLES, **_TO_ANGLES, **_PLAIN}
_END, _LEAST = 1.0 - 1e-12, 1e-300
"""Where arcs and roots end: just inside, so that their derivatives are finite."""
_TWO: Final = ("atan2",)
FUNCTIONS: Final = tuple(_BY_NAME)


@dataclass(frozen=True)
class Formula:
    """A formula that was read; ``names`` are those that stand in it, in order; ``angle`` is a unit of angles in rad."""

    text: str
    names: tuple[str, ...]
    angle: float

    @classmethod
    def read(cls, text: str, known: Collection[str], angle: float, where: str) -> Formula:
        """Raises InputError, which opens with ``where``, for what is no formula of the ``known`` names."""
        tree = _tree(text, where)
        try:
            _Value(text.strip(), {name: ca.SX.sym(name) for name in known}, _BY_NAME, angle, where).visit(
                tree
            )
        except RecursionError:
            raise InputError(
                f"{where}: found {text!r}, expected a shorter one, or fewer brackets in brackets"
            ) from None
        found = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id not in FUNCTIONS]
        ordered = sorted(found, key=lambda node: node.col_offset)
        return cls(text, tuple(dict.fromkeys(node.id for node in ordered)), angle)

    def value(self, at: Mapping[str, ca.SX], *, bounded: bool = False) -> ca.SX:
        """The formula where its names have the values ``at``.

        bounded: roots and arcs of what has none are those of the nearest that has, so that a step out there finds back.
        """
        known = {name: _bounded(name) if bounded else function for name, function in _BY_NAME.items()}
        return _Value(self.text.strip(), at, known, self.angle, "formula").visit(_tree(self.text, "formula"))


@dataclass(frozen=True)
class Law:
    """A formula of other joints' displacements, written in units of its own: ``scale`` (mm or rad) is one of its result's.

    ``readings`` and ``lengths`` (parameters) by the names that stand in it, each with one of its written units in mm or rad.
    """

    formula: Formula
    scale: float
    readings: tuple[tuple[str, float], ...]
    lengths: tuple[tuple[str, str, float], ...]

    def value(
        self, displacement: Mapping[str, ca.SX], values: Mapping[str, ca.SX], *, bounded: bool = True
    ) -> ca.SX:
        """mm or rad, of displacements by reading and of parameters by name; ``bounded``: as `Formula.value`."""
        at = {name: displacement[name] / unit for name, unit in self.readings}
        at |= {name: values[parameter] / unit for name, parameter, unit in self.lengths}
        return self.scale * self.formula.value(at, bounded=bounded)


def _bounded(name: str) -> Callable[..., ca.SX]:
    """A function that has a value, and a derivative, for every number."""
    function = _BY_NAME[name]
    if name in ("asin", "acos"):
        return lambda a: function(ca.fmax(-_END, ca.fmin(_END, a)))
    return (lambda a: function(ca.fmax(a, _LEAST))) if name == "sqrt" else function


def _tree(text: str, where: str) -> ast.Expression:
    if len(text) > LONGEST:
        raise InputError(f"{where}: found {len(text)} characters, expected a formula of at most {LONGEST}")
    try:
        return ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(f"{where}: found {text!r}, expected a formula such as 90 - q2 - q3") from None


@dataclass(frozen=True)
class _Value(ast.NodeVisitor):
    """The value of a formula, node by node; refuses all that is not arithmetic of known names."""

    text: str
    at: Mapping[str, ca.SX]
    functions: Functions
    angle: float
    where: str

    def visit(self, node: ast.AST) -> ca.SX:
        value: ca.SX = super().visit(node)
        return value

    def visit_Expression(self, node: ast.Expression) -> ca.SX:
        return self.visit(node.body)

    def visit_BinOp(self, node: ast.BinOp) -> ca.SX:
        """Return the value of a chain of terms from its first one on: a long sum is deep only in the tree."""
        chain, first = [node], node.left
        while isinstance(first, ast.BinOp):
            chain, first = [*chain, first], first.left
        for one in chain:
            if isinstance(one.op, ast.BitXor):
                raise self._bad(one, "** for a power")
            if type(one.op) not in _POWERS:
                raise self._bad(one, "+ - * / or **")
        value = self.visit(first)
        for one in reversed(chain):
            value = _POWERS[type(one.op)](value, self.visit(one.right))
        return value

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ca.SX:
        if not isinstance(node.op, (ast.USub, ast.UAdd)):
            raise self._bad(node, "+ or - before a term")
        inner = self.visit(node.operand)
        return -inner if isinstance(node.op, ast.USub) else inner

    def visit_Call(self, node: ast.Call) -> ca.SX:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in FUNCTIONS:
            raise self._bad(node.func, f"a function; {close_matches(name, FUNCTIONS)}")
        count = 2 if name in _TWO else 1
        if node.keywords or len(node.args) != count:
            raise self._bad(node, f"{name} of {count} {'values' if count > 1 else 'value'}")
        arguments = [self.visit(argument) for argument in node.args]
        out: ca.SX = self.functions[name](*(a * self.angle if name in _OF_ANGLES else a for a in arguments))
        return out / self.angle if name in _TO_ANGLES else out

    def visit_Name(self, node: ast.Name) -> ca.SX:
        if node.id not in self.at:
            hint = close_matches(node.id, self.at)
            raise self._bad(node, f"a driven joint or a length of this joint; {hint}")
        return self.at[node.id]

    def visit_Constant(self, node: ast.Constant) -> ca.SX:
        number = as_number(node.value)
        if number is None or abs(number) > sys.float_info.max:
            raise self._bad(node, "a number")
        return ca.SX(number)

    def generic_visit(self, node: ast.AST) -> ca.SX:
        raise self._bad(node, f"numbers, joints, + - * / **, brackets and {', '.join(FUNCTIONS)}")

    def _bad(self, node: ast.AST, expected: str) -> InputError:
        found = ast.get_source_segment(self.text, node) or self.text
        return InputError(f"{self.where}: found {found!r} in {self.text!r}, expected {expected}")
