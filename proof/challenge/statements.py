"""What a diagnosis said with a probability, and whether it was so: names, classes, rows set aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from challenge.findings import Found, Judge, Reply, Said
from challenge.solutions import Solution

SURE = 0.9


@dataclass(frozen=True)
class Statement:
    """Something said with a probability, and whether it was so; ``fair``: or as good as so."""

    probability: float
    right: bool
    fair: bool = False


@dataclass(frozen=True)
class Rows:
    """Fitted rows: how many were set aside though nothing was wrong with them, of how many; how many wild ones were
    kept, of how many. ``invented``: rows were set aside where none were wild at all."""

    false: int = 0
    calm: int = 0
    kept: int = 0
    wild: int = 0
    invented: bool = False


def name_said(judge: Judge, said: Said) -> Statement:
    """One name: right when it is the very truth, at each of its places where it has several, or says without a name what
    has none."""
    right = judge.names(said) or judge.unnamed(said)
    return Statement(said.probability, right, right or judge.as_good(said))


def names_said(judge: Judge, found: Sequence[Found]) -> tuple[Statement, ...]:
    """Every explanation in every class."""
    return tuple(name_said(judge, said) for one in found for said in one.members)


def classes_said(judge: Judge, found: Sequence[Found]) -> tuple[Statement, ...]:
    """Every class: right when it holds a truth or what is as good."""
    out = []
    for one in found:
        right = any(judge.covers(one, t) for t in judge.truths)
        out.append(Statement(one.certainty, right, right))
    return tuple(out)


def inclusion_said(judge: Judge, reply: Reply) -> tuple[Statement, ...]:
    """The probability of every effect at every place that the diagnosis lists, in a finding or not."""
    return tuple(
        Statement(said.probability, right := judge.names(said), right or judge.as_good(said))
        for said in reply.inclusion
    )


def rows_said(reply: Reply, solution: Solution) -> tuple[Statement, ...]:
    """Findings on rows: right when most of the rows they name are wild."""
    wild = set(solution.wild)
    out = []
    for found in reply.of_rows:
        rows = found.rows
        right = len(rows & wild) > len(rows) / 2
        out.append(Statement(found.certainty, right, right))
    return tuple(out)


def rows_judged(reply: Reply, solution: Solution) -> Rows:
    """Which rows were set aside, against those that are wild."""
    wild, fitted = set(solution.wild), set(solution.rows)
    aside = frozenset[int]().union(*(f.rows for f in reply.of_rows)) & fitted
    return Rows(
        false=len(aside - wild),
        calm=len(fitted - wild),
        kept=len(wild - aside),
        wild=len(wild),
        invented=bool(aside) and not wild,
    )


__all__ = [
    "SURE", "Rows", "Statement", "classes_said", "inclusion_said", "name_said", "names_said", "rows_judged", "rows_said",
]  # fmt: skip
