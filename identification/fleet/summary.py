"""Sums over machines that add: a fleet's statistics need nothing else, however large it is.

Every entry is a whole number (log likelihoods and moments in units of 2^-20), so that sums are exact: any order of machines,
any grouping into shards, and taking a machine out again give the very same summary. ``sums`` has, by its keys,

    mechanism|TYPE                    machines
    verdict|VERDICT                   machines
    place|TYPE|EFFECT|PLACE           machines, sum of prior log odds, of probabilities, log likelihood (j, g)
    anywhere|TYPE|EFFECT              the same of any place, log likelihood (g,)
    size|TYPE|EFFECT|PLACE|UNIT       sums of P, P y, P y^2, P e^2, P a: y +- e log size, a log amount in the unit
    class|TYPE|CLASS                  deviations, log likelihood (r,) of the spread
    constant|TYPE|NAME                machines, sums of x, x^2, e^2: deviation x +- e in tolerances
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logit

from truepose.errors import InputError
from truepose.identification.fleet.likelihood import Told, of_frequency, of_presence, of_spread

Whole = NDArray[np.int64]
Array = NDArray[np.float64]
SCHEMA = "truepose/fleet-summary/1"
KEPT = "truepose/kept/1"
UNIT = 2.0**-20
LEAST = 1e-6
"""Smallest prior probability that is told from none."""


@dataclass(frozen=True)
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
        """Of one machine, from what ``truepose.identification.fleet.evidence.kept`` keeps of it."""
        if kept.get("schema") != KEPT:
            raise InputError(
                f"schema of what was kept of a machine: found {kept.get('schema')!r}, expected {KEPT!r}"
            )
        return cls(1, dict(sorted(_sums(kept))))

    def __add__(self, other: Summary) -> Summary:
        """Of the machines of both."""
        return self._with(other, 1)

    def __sub__(self, other: Summary) -> Summary:
        """Without machines that are part of this one."""
        return self._with(other, -1)

    def _with(self, other: Summary, sign: int) -> Summary:
        out = dict(self.sums)
        for key, value in other.sums.items():
            out[key] = out[key] + sign * value if key in out else sign * value
        kept = {key: out[key] for key in sorted(out) if out[key].any()}
        return Summary(self.machines + sign * other.machines, kept)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Summary) and self.to_json() == other.to_json()

    def __hash__(self) -> int:
        return hash((self.machines, tuple(self.sums)))

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

    def to_json(self) -> dict[str, Any]:
        """For a file: texts and whole numbers."""
        sums = {key: value.tolist() for key, value in self.sums.items()}
        return {"schema": SCHEMA, "machines": self.machines, "sums": sums}

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Summary:
        """What ``to_json`` gave. Raises InputError for anything else."""
        if document.get("schema") != SCHEMA:
            raise InputError(
                f"schema of a fleet's summary: found {document.get('schema')!r}, expected {SCHEMA!r}"
            )
        try:
            sums = {str(key): np.array(value, dtype=np.int64) for key, value in document["sums"].items()}
            return cls(int(document["machines"]), dict(sorted(sums.items())))
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
            raise InputError(
                "a fleet's summary: expected `machines` and lists of whole numbers in `sums`"
            ) from None


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


def _whole(*parts: ArrayLike) -> Whole:
    flat = np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in parts])
    return np.asarray(np.rint(flat / UNIT), dtype=np.int64)


def _sums(kept: Mapping[str, Any]) -> Iterator[tuple[str, Whole]]:
    mechanism = str(kept["mechanism"])
    yield f"mechanism|{mechanism}", _whole(1.0)
    yield f"verdict|{kept['verdict']}", _whole(1.0)
    yield from _of_places(mechanism, kept["places"])
    yield from _of_effects(mechanism, kept["anywhere"])
    yield from _of_constants(mechanism, kept["parameters"])


def _log_odds(prior: float) -> float:
    return float(logit(min(max(prior, LEAST), 1.0 - LEAST)))


def _of_places(mechanism: str, places: Mapping[str, Mapping[str, list[Any]]]) -> Iterator[tuple[str, Whole]]:
    every = [(f"{effect}|{place}", one) for effect, own in places.items() for place, one in own.items()]
    told = [(name, one, one[5] if len(one) > 5 else {}) for name, one in every if one[1] > 0.0]
    if not told:
        return
    likelihoods = of_frequency(Told.of([one for _, one, _ in told]), [more for *_, more in told])
    for (name, one, more), likely in zip(told, likelihoods, strict=True):
        yield f"place|{mechanism}|{name}", _whole(1.0, _log_odds(one[1]), one[0], likely)
        if "size" in more:
            p, (y, e), a = one[0], more["size"], more.get("amount", 0.0)
            yield (
                f"size|{mechanism}|{name}|{more.get('unit', '')}",
                _whole(p, p * y, p * y**2, p * e**2, p * a),
            )


def _of_effects(mechanism: str, effects: Mapping[str, list[Any]]) -> Iterator[tuple[str, Whole]]:
    told = {name: one for name, one in effects.items() if one[1] > 0.0}
    if not told:
        return
    for (name, one), likely in zip(told.items(), of_presence(Told.of(list(told.values()))), strict=True):
        yield f"anywhere|{mechanism}|{name}", _whole(1.0, _log_odds(one[1]), one[0], likely)


def _of_constants(mechanism: str, constants: Mapping[str, list[Any]]) -> Iterator[tuple[str, Whole]]:
    count = Counter(one[2] for one in constants.values())
    for name, (x, e, _) in constants.items():
        yield f"constant|{mechanism}|{name}", _whole(1.0, x, x**2, e**2)
    for kind, number in count.items():
        own = np.array([[x, e] for x, e, one in constants.values() if one == kind])
        yield f"class|{mechanism}|{kind}", _whole(float(number), of_spread(own[:, 0], own[:, 1]))


__all__ = ["KEPT", "SCHEMA", "Summary", "total"]
