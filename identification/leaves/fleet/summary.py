"""Sums over machines that add: a fleet's statistics need nothing else, however large it is.

Every entry is a whole number (log likelihoods and moments in units of 2^-20), so that sums are exact: any order of machines
and any grouping into shards give the very same summary. ``sums`` has, by its keys,

    mechanism|TYPE                    machines
    verdict|VERDICT                   machines
    place|TYPE|EFFECT|PLACE           machines, sum of prior log odds, of probabilities, log likelihood (j, g)
    anywhere|TYPE|EFFECT              the same of any place, log likelihood (g,)
    size|TYPE|EFFECT|PLACE|UNIT       sums of P, P y, P y^2, P e^2, P a: y +- e log size, a log amount in the unit
    class|TYPE|CLASS                  deviations, log likelihood (r,) of the spread
    constant|TYPE|NAME                machines, sums of x, x^2, e^2: deviation x +- e in tolerances
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.fleet.columns import (
    LOG_ODDS,
    RATIOS,
    SLAB,
    UNIT,
    Columns,
    Said,
    Told,
    Whole,
    constant_moments,
    effect_moments,
    of_frequency,
    of_presence,
    of_spread,
    size_moments,
    whole,
)


@dataclass(frozen=True, eq=False)
class Summary:
    """machines: how many; sums: whole numbers (k,) by what they are sums of."""

    machines: int
    sums: Mapping[str, Whole]

    @classmethod
    def empty(cls) -> Summary:
        """Of no machine."""
        return cls(0, {})

    @classmethod
    def of(cls, kept: Mapping[str, Any]) -> Summary:
        """Of one machine, from what ``truepose.identification.leaves.fleet.columns.kept`` keeps of it."""
        return cls.of_columns(Columns.of([kept]))

    @classmethod
    def of_columns(cls, columns: Columns) -> Summary:
        """Of machines that were gathered: the same as ``total`` of each, and quicker; takes 0.3 MB a machine meanwhile."""
        return cls(columns.machines, dict(sorted(_sums(columns))))

    def __add__(self, other: Summary) -> Summary:
        """Of the machines of both."""
        return total((self, other))

    def among(self, kind: str) -> dict[tuple[str, ...], Array]:
        """Sums of one kind by what follows it in their keys, counts and numbers in their own units."""
        out = dict[tuple[str, ...], Array]()
        for key, value in self.sums.items():
            first, *rest = key.split("|")
            if first == kind:
                out[tuple(rest)] = np.asarray(value * UNIT, dtype=np.float64)
        return out

    @property
    def mechanisms(self) -> dict[str, int]:
        """Machines of each type of mechanism."""
        return {key[0]: round(value[0]) for key, value in self.among("mechanism").items()}


def total(summaries: Iterable[Summary]) -> Summary:
    """Of all of them, as quick as one sum: each is added in place."""
    machines, sums = 0, dict[str, Whole]()
    for one in summaries:
        machines += one.machines
        for key, value in one.sums.items():
            if key in sums:
                sums[key] += value
            else:
                sums[key] = value.copy()
    return Summary(machines, {key: sums[key] for key in sorted(sums) if sums[key].any()})


def _sums(columns: Columns) -> Iterator[tuple[str, Whole]]:
    for kind, counts in (("mechanism", columns.mechanisms), ("verdict", columns.verdicts)):
        for name, count in counts.items():
            yield f"{kind}|{name}", whole([float(count)])[0]
    places, anywhere, classes = columns.places, columns.anywhere, columns.classes
    frequency = of_frequency(Told.of(places.numbers[:, :5]), places.numbers[:, 5:])
    flat = frequency.reshape(len(frequency), SLAB.size * LOG_ODDS.size)
    yield from _added("place", places, effect_moments(places), whole(flat))
    presence = of_presence(Told.of(anywhere.numbers))
    yield from _added("anywhere", anywhere, effect_moments(anywhere), whole(presence))
    yield from _added("size", columns.sizes, size_moments(columns.sizes))
    yield from _added("constant", columns.constants, constant_moments(columns.constants))
    yield from _added("class", *_spreads(classes))


def _spreads(said: Said) -> tuple[Said, Whole]:
    """A row for each class of each machine: deviations, log likelihood (g,) of the spread."""
    x, e = said.numbers.T
    new = (np.diff(said.thing, prepend=-1) != 0) | (np.diff(said.machine, prepend=-1) != 0)
    first = np.flatnonzero(new)
    likely = np.add.reduceat(of_spread(x, e), first, axis=0) if first.size else np.empty((0, len(RATIOS)))
    rows = Said(said.keys, said.thing[first], said.machine[first], said.numbers[first])
    return rows, whole(np.diff(first, append=len(new)), likely)


def _added(kind: str, said: Said, *parts: Whole) -> Iterator[tuple[str, Whole]]:
    """Sums over machines, of each thing."""
    if said.keys:
        sums = np.concatenate([np.add.reduceat(part, said.first, axis=0) for part in parts], axis=1)
        yield from zip((f"{kind}|{key}" for key in said.keys), sums, strict=True)
