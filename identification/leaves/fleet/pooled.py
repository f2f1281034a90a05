"""What is kept of many machines, as tables: a row for each thing that one of them says something of.

Sums over machines are of numbers rounded to ``UNIT``, so that they are exact: in any order, and with a machine taken out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import logit

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.leaves.fleet.evidence import KEPT

UNIT = 2.0**-20
"""What every number is rounded to before it is added up."""
LEAST = 1e-6
"""Smallest prior probability that is told from none."""
NUMBERS = ["probability", "prior", "log_factor", "unseen", "credit"]
PLACE = ["machine", "mechanism", "effect", "place"]
PLACES = [*PLACE, *NUMBERS, "sizes"]
ANYWHERE = ["machine", "mechanism", "effect", *NUMBERS]
SIZES = [*PLACE, "unit", "probability", "log_size", "log_std", "log_amount"]
OTHERS = {"machine", "mechanism", "effect", "place", "unit", "name", "parts", "sizes"}
"""Columns that are no numbers."""
CONSTANTS = ["machine", "mechanism", "name", "parts", "deviation", "std"]


@dataclass(frozen=True)
class Pooled:
    """Tables of machines that are numbered from 0.

    mechanisms: machines of each type; places, anywhere: what is said of an effect, where a prior holds it possible; sizes: of
    what may be there; constants: deviation and 1-sigma in tolerances.
    """

    machines: int
    mechanisms: Mapping[str, int]
    places: pd.DataFrame
    anywhere: pd.DataFrame
    sizes: pd.DataFrame
    constants: pd.DataFrame

    @classmethod
    def of(cls, every: Sequence[Mapping[str, Any]]) -> Pooled:
        """Pool what ``evidence.kept`` keeps of each machine. Raises InputError for anything else."""
        places, anywhere, sizes, constants = list[Any](), list[Any](), list[Any](), list[Any]()
        for k, kept in enumerate(every):
            if kept.get("schema") != KEPT:
                raise InputError(
                    f"schema of what was kept of a machine: found {kept.get('schema')!r}, expected {KEPT!r}"
                )
            kind = kept["mechanism"]
            for effect, place, one in _possible(kept["places"]):
                more = one[5] if len(one) > 5 else {}
                where = (k, kind, effect, place)
                places.append((*where, *one[:5], more.get("sizes")))
                if "size" in more:
                    unit, amount = more.get("unit", ""), more.get("amount", 0.0)
                    sizes.append((*where, unit, one[0], *more["size"], amount))
            anywhere += [(k, kind, effect, *one) for effect, one in kept["anywhere"].items() if one[1] > 0.0]
            constants += [(k, kind, name, parts, x, e) for name, (x, e, parts) in kept["parameters"].items()]
        return cls(
            len(every),
            dict(sorted(Counter(kept["mechanism"] for kept in every).items())),
            _table(places, PLACES),
            _table(anywhere, ANYWHERE),
            _table(sizes, SIZES),
            _table(constants, CONSTANTS),
        )


def _table(rows: Sequence[Any], columns: Sequence[str]) -> pd.DataFrame:
    """Return a table whose numbers are such without a row, too."""
    table = pd.DataFrame(rows, columns=list(columns))
    return table.astype({name: float for name in columns if name not in OTHERS})


def _possible(places: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, str, Sequence[Any]]]:
    """Yield effect, place and what is kept of both, where the prior holds it possible."""
    for effect, own in places.items():
        yield from ((effect, place, one) for place, one in own.items() if one[1] > 0.0)


def rows_of(table: pd.DataFrame) -> Iterator[Any]:
    """Yield each row, with a field for each column."""
    yield from table.itertuples(index=False)


def grouped(table: pd.DataFrame, *by: str) -> Iterator[tuple[Any, pd.DataFrame]]:
    """Yield the names of each thing that these columns tell apart, in order, with its rows."""
    yield from table.groupby(list(by))


def whole(values: Array) -> Array:
    """Round numbers to whole ones of ``UNIT``."""
    return np.asarray(np.rint(values / UNIT))


def summed(rows: Array) -> Array:
    """Return the exact sum (c,) of rows (r, c)."""
    return np.asarray(whole(rows).sum(axis=0) * UNIT)


def others(rows: pd.DataFrame, by: Sequence[str], values: Array) -> Array:
    """Return the sums (r, c) of ``values`` over all other rows that are of the same thing, named by these columns."""
    own = pd.DataFrame(whole(values), index=rows.index)
    total = own.groupby([rows[name] for name in by]).transform("sum")
    return np.asarray((total - own) * UNIT)


def effect_moments(rows: pd.DataFrame) -> Array:
    """Return (r, 3) of rows about effects: machines, prior log odds, probability."""
    odds = logit(rows["prior"].clip(LEAST, 1.0 - LEAST))
    return np.column_stack([np.ones(len(rows)), odds, rows["probability"]])


def size_moments(rows: pd.DataFrame) -> Array:
    """Return (r, 5) of rows about sizes y +- e and amounts a of probability P: P, P y, P y^2, P e^2, P a."""
    p, y, e, a = (rows[name].to_numpy() for name in ("probability", "log_size", "log_std", "log_amount"))
    return np.column_stack([p, p * y, p * y**2, p * e**2, p * a])


def constant_moments(rows: pd.DataFrame) -> Array:
    """Return (r, 4) of rows about deviations x +- e: machines, x, x^2, e^2."""
    x, e = (rows[name].to_numpy() for name in ("deviation", "std"))
    return np.column_stack([np.ones(len(rows)), x, x**2, e**2])
