"""What is kept of many machines, as columns of numbers: a row for each thing that one of them says something of.

Sums and judgements over machines are worked out from these, for a group of machines at once. Nothing that comes of a row
depends on the rows beside it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logit

from truepose.arrays import Array, Index
from truepose.errors import InputError
from truepose.identification.leaves.fleet.likelihood import SLAB

Whole = NDArray[np.int64]
KEPT = "truepose/kept/1"
UNIT = 2.0**-20
"""Of whole numbers, in which everything is added up."""
LEAST = 1e-6
"""Smallest prior probability that is told from none."""


@dataclass(frozen=True)
class Said:
    """Rows about things of one kind: those of a thing follow each other, and among them those of a machine.

    keys (k,): the things, each with a row at least; thing (r,), machine (r,): which of them a row is of; numbers (r, c): what
    it says.
    """

    keys: tuple[str, ...]
    thing: Index
    machine: Index
    numbers: Array

    @property
    def first(self) -> Index:
        """(k,) the first row of each thing."""
        return np.searchsorted(self.thing, np.arange(len(self.keys)))


@dataclass(frozen=True)
class Columns:
    """machines: how many; mechanisms, verdicts: how many of each; by what follows its kind in the keys of ``Summary``:

    places (r, 5 + s), anywhere (r, 5): probability, prior, log Bayes factor, unseen, credit, where a prior holds them possible;
    at places how probable each size is besides, NaN where that is not kept; sizes (r, 4): probability, mean and 1-sigma of the
    log size, mean of its log amount; constants, classes (r, 2): deviation and 1-sigma in tolerances.
    """

    machines: int
    mechanisms: Mapping[str, int]
    verdicts: Mapping[str, int]
    places: Said
    anywhere: Said
    sizes: Said
    constants: Said
    classes: Said

    @classmethod
    def of(cls, every: Iterable[Mapping[str, Any]]) -> Columns:
        """Of all of them, from what ``Gathered`` takes."""
        out = Gathered()
        for kept in every:
            out.take(kept)
        return out.columns


class Gathered:
    """Machines, one after the other. Of each only numbers and names stay: its nested lists, held together with those of others,
    would keep Python's garbage collector busy for as long as all the rest takes."""

    def __init__(self) -> None:
        self.machines = 0
        self._mechanisms, self._verdicts = Counter[str](), Counter[str]()
        self._places, self._anywhere, self._sizes = _Rows(5), _Rows(5), _Rows(4)
        self._constants, self._classes = _Rows(2), _Rows(2)
        self._shown: dict[int, Sequence[float]] = {}

    def take(self, kept: Mapping[str, Any]) -> None:
        """What ``evidence.kept`` keeps of a machine. Raises InputError for anything else."""
        if kept.get("schema") != KEPT:
            raise InputError(
                f"schema of what was kept of a machine: found {kept.get('schema')!r}, expected {KEPT!r}"
            )
        self.machines += 1
        kind = str(kept["mechanism"])
        self._mechanisms[kind] += 1
        self._verdicts[str(kept["verdict"])] += 1
        self._take_places(
            [
                (f"{kind}|{effect}|{place}", one)
                for effect, places in kept["places"].items()
                for place, one in places.items()
                if one[1] > 0.0
            ]
        )
        self._anywhere.take(
            [(f"{kind}|{effect}", one) for effect, one in kept["anywhere"].items() if one[1] > 0.0]
        )
        constants = kept["parameters"]
        self._constants.take([(f"{kind}|{name}", one) for name, one in constants.items()])
        self._classes.take([(f"{kind}|{one[2]}", one) for one in constants.values()])

    def _take_places(self, told: Sequence[tuple[str, Sequence[Any]]]) -> None:
        before, sizes = len(self._places), []
        self._places.take(told)
        for row, (key, one) in enumerate(told, start=before):
            if len(one) > 5:
                more = one[5]
                if "sizes" in more:
                    self._shown[row] = more["sizes"]
                if "size" in more:
                    size = one[0], *more["size"], more.get("amount", 0.0)
                    sizes.append((f"{key}|{more.get('unit', '')}", size))
        self._sizes.take(sizes)

    @property
    def columns(self) -> Columns:
        """Of all machines that were taken."""
        shown = np.full((len(self._places), len(SLAB)), np.nan)
        if self._shown:
            shown[list(self._shown)] = list(self._shown.values())
        rest = (rows.said() for rows in (self._anywhere, self._sizes, self._constants, self._classes))
        return Columns(self.machines, self._mechanisms, self._verdicts, self._places.said(shown), *rest)


class _Rows:
    """Rows of so many columns, machine after machine."""

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self._keys, self._counts, self._numbers = list[str](), list[int](), list[float]()

    def __len__(self) -> int:
        return len(self._keys)

    def take(self, told: Sequence[tuple[str, Sequence[Any]]]) -> None:
        """What the next machine says of which thing."""
        self._counts.append(len(told))
        self._keys += [key for key, _ in told]
        self._numbers += chain.from_iterable([one[: self._columns] for _, one in told])

    def said(self, *more: Array) -> Said:
        """Rows of a thing together; with more columns (r, c)."""
        number = {key: k for k, key in enumerate(dict.fromkeys(self._keys))}
        thing = np.array([number[key] for key in self._keys], dtype=np.intp)
        machine = np.repeat(np.arange(len(self._counts)), self._counts)
        numbers = np.array(self._numbers, dtype=float).reshape(-1, self._columns)
        order = np.argsort(thing, kind="stable")
        return Said(tuple(number), thing[order], machine[order], np.hstack([numbers, *more])[order])


def whole(*columns: ArrayLike) -> Whole:
    """(r, c) whole numbers of ``UNIT`` from columns (r,)."""
    return np.asarray(np.rint(np.column_stack(columns) / UNIT), dtype=np.int64)


def effect_moments(said: Said) -> Whole:
    """(r, 3) of rows about effects: machines, prior log odds, probability."""
    p, prior = said.numbers[:, :2].T
    return whole(np.ones_like(p), logit(np.clip(prior, LEAST, 1.0 - LEAST)), p)


def size_moments(said: Said) -> Whole:
    """(r, 5) of rows (r, 4): P, P y, P y^2, P e^2, P a."""
    p, y, e, a = said.numbers.T
    return whole(p, p * y, p * y**2, p * e**2, p * a)


def constant_moments(said: Said) -> Whole:
    """(r, 4) of rows (r, 2): machines, x, x^2, e^2."""
    x, e = said.numbers.T
    return whole(np.ones_like(x), x, x**2, e**2)


__all__ = [
    "KEPT",
    "UNIT",
    "Columns",
    "Gathered",
    "Said",
    "constant_moments",
    "effect_moments",
    "size_moments",
    "whole",
]
