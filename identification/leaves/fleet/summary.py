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

What is kept of many machines, as columns of numbers: a row for each thing that one of them says something of.

Sums and judgements over machines are worked out from these, for a group of machines at once. Nothing that comes of a row
depends on the rows beside it.

What one machine adds to the log likelihood of a fleet's unknowns, on grids: how frequent and how large an effect is, how
far constants are from their drawing.

An effect is there with a frequency q, and its size is drawn around the fleet's usual size j by the kernel K. One machine says

    p(readings | q, j) / p(readings | absent) = 1 - q + q sum_s K(s | j) B_s

with B_s the Bayes factor of the effect at size s, 1 at sizes that its recording would not show. Where rivals explain the same
with a probability r, the machine counts 1 - r as above, with B against nothing at all, and r as one in which no size that would
be noticed is there: a step of EM over which of them it is, so that rivals together are counted once.

A constant's deviation x +- e (in tolerances) says N(x; 0, r^2 + e^2), with r the true spread over the stated tolerance.

What is kept of one diagnosed machine for the statistics of its fleet: a few kB that JSON can hold.

``kept`` stores evidence, not conclusions: of every effect at every place a Bayes factor that is free of the prior that the
diagnosis was made with, so that a fleet can be summed up under any prior, and never counts what a prior said twice.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, logit

from truepose.arrays import Array, Index
from truepose.errors import InputError
from truepose.identification.diagnosis.place_evidence import PlaceEvidence
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tolerance_classes import part_classes
from truepose.identification.prior import FLEET_SIZES, SIZES

# -- What one machine adds to the log likelihood of a fleet's unknowns, on grids

LOG_ODDS: Array = np.linspace(-11.0, 5.0, 33)
"""(g,) grid of the log odds of a frequency; between its points a log likelihood is smooth."""
RATIOS: Array = np.geomspace(0.05, 20.0, 61)
"""(r,) grid of true spreads over stated tolerances."""
LARGEST = 15.0
"""Log Bayes factor beyond which a posterior tells no more."""
SLAB: Array = np.exp(SIZES.log_prior)
"""(s,) prior share of each size."""


def _kernel() -> Array:
    """(j, s) how sizes of machines scatter about the fleet's usual one. The slab is what it leaves unchanged (detailed
    balance), so that a fleet of which nothing is known has the sizes of the slab."""
    steps = np.abs(np.subtract.outer(np.arange(len(SLAB)), np.arange(len(SLAB))))
    offered = FLEET_SIZES**steps
    out = offered / offered.sum(axis=1).max() * np.minimum(1.0, SLAB / SLAB[:, None])
    np.fill_diagonal(out, 0.0)
    np.fill_diagonal(out, 1.0 - out.sum(axis=1))
    return np.asarray(out)


KERNEL: Array = _kernel()


@dataclass(frozen=True)
class Told:
    """What machines say of an effect each (p,): log Bayes factor against nothing, prior share of sizes that are not seen,
    and the probability that a rival explains what it would."""

    log_factor: Array
    unseen: Array
    rival: Array

    @classmethod
    def of(cls, numbers: Array) -> Told:
        """From rows (p, 5): probability, prior, log Bayes factor, unseen, credit."""
        p, _, log_factor, unseen, credit = numbers.T
        rival = np.minimum(p * (1.0 - credit) / np.maximum(credit, 1e-9), 1.0 - p)
        nothing = np.maximum(1.0 - p - rival, np.exp(-LARGEST))
        against = log_factor + np.log(np.maximum(1.0 - p, np.exp(-LARGEST))) - np.log(nothing)
        return cls(np.minimum(against, LARGEST), unseen, rival)


def _shown(unseen: Array) -> Array:
    """(p, s) share of each size that a recording would show: small ones are those that are not seen."""
    return np.clip((np.cumsum(SLAB) - unseen[:, None]) / SLAB, 0.0, 1.0)


def by_size(log_factor: Array, unseen: Array, sizes: Array) -> Array:
    """(p, s) Bayes factor of effects (p,) at each size. sizes (p, s): how probable each is, rows of NaN where nobody knows."""
    shown = _shown(unseen)
    share = np.where(np.isnan(sizes), SLAB * shown, sizes)
    share /= np.maximum(share.sum(axis=1, keepdims=True), 1e-300)
    return np.asarray((1.0 - shown) + (np.exp(log_factor) * (1.0 - unseen))[:, None] * share / SLAB)


def of_frequency(told: Told, sizes: Array) -> Array:
    """(p, j, g) log likelihood of frequencies and usual sizes; sizes (p, s) as in ``by_size``."""
    out = _log_mixed(_scattered(by_size(told.log_factor, told.unseen, sizes)))
    at = np.flatnonzero(told.rival > 0.0)  # few: where a recording cannot tell two effects apart
    r = told.rival[at, None, None]
    out[at] = (1.0 - r) * out[at] + r * _log_mixed(_scattered(1.0 - _shown(told.unseen[at])))
    return out


def _scattered(factors: Array) -> Array:
    """(p, j) Bayes factors by the fleet's usual size, from those by size (p, s). No product of matrices: its rounding would
    depend on how many rows there are, and sums of machines have to be the same in any grouping."""
    return np.asarray(sum(factors[:, s, None] * KERNEL[:, s] for s in range(len(SLAB))))


def of_presence(told: Told) -> Array:
    """(p, g) log likelihood of frequencies, whatever the size."""
    there = told.unseen + (1.0 - told.unseen) * np.exp(told.log_factor)
    r = told.rival[:, None]
    return np.asarray((1.0 - r) * _log_mixed(there) + r * _log_mixed(told.unseen))


def _log_mixed(there: Array) -> Array:
    """(..., g) of an effect that is there with each frequency, from its Bayes factors (...)."""
    q = expit(LOG_ODDS)
    out = q * there[..., None]
    out += 1.0 - q
    return np.asarray(np.log(out, out=out))


def of_spread(deviation: Array, std: Array) -> Array:
    """(p, r) log likelihood of a spread from each deviation (p,) with its 1-sigma, in tolerances; those of a class add."""
    variance = RATIOS**2 + std[:, None] ** 2
    return np.asarray(-0.5 * (np.log(variance) + deviation[:, None] ** 2 / variance))


# -- What is kept of many machines, as columns of numbers: a row for each thing that one of them says something of

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


# -- What is kept of one diagnosed machine for the statistics of its fleet: a few kB that JSON can hold

DETERMINED = 3.0
"""1-sigma of what the readings alone say of a constant, in its tolerances, beyond which they say nothing of it."""
FINEST = 1e-3
"""Smallest 1-sigma of a constant that is kept, in tolerances: no fit of a model is better than that."""


def kept(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the fleet's statistics need of a machine.

    Returns a dict of texts, numbers, lists and dicts: ``machine``, ``mechanism`` (its type), ``verdict``; ``places``: by effect
    and place ``[probability, prior, log Bayes factor, unseen, credit]`` (``unseen``: prior share of sizes that the recording
    would not show; ``credit``: its share among rivals), and where it may be there a dict besides: ``sizes``, how probable each
    size of the slab is, ``size``, [mean, std] of the log of its rms coefficient in expected largest sizes, and ``amount``, the
    same mean in ``unit``; ``anywhere``: by effect the same five numbers, of any of its places; ``parameters``: by name what
    the readings alone say, [deviation, std] in tolerances, and its class of parts.
    """
    machine = diagnosis.nominal
    return {
        "schema": KEPT,
        "machine": machine.name,
        "mechanism": machine.mechanism_type,
        "verdict": diagnosis.verdict,
        "places": _by_effect(diagnosis.evidence),
        "anywhere": {one.effect: _place(one) for one in diagnosis.evidence_anywhere},
        "parameters": _parameters(diagnosis.after),
    }


def _by_effect(every: Sequence[PlaceEvidence]) -> dict[str, dict[str, list[Any]]]:
    out: dict[str, dict[str, list[Any]]] = {}
    for one in every:
        out.setdefault(one.effect, {})["+".join(one.place)] = _place(one)
    return out


def _place(one: PlaceEvidence) -> list[Any]:
    """Rounded to what matters: a hundredth of a nat, four digits of a probability."""
    factor = round(one.log_bayes_factor, 2)
    out: list[Any] = [
        _short(one.probability),
        _short(one.prior),
        factor,
        _short(one.unseen),
        _short(one.credit),
    ]
    more: dict[str, Any] = {}
    if one.sizes:
        more["sizes"] = [round(p, 3) for p in one.sizes]
    if one.size is not None:
        more["size"] = [round(one.size.log_mean, 3), round(one.size.log_std, 3)]
        more |= {"amount": round(one.size.log_amount, 3), "unit": one.size.unit} if one.size.unit else {}
    return [*out, more] if more else out


def _short(value: float) -> float:
    return float(f"{value:.4g}") if abs(value) >= 1e-6 else 0.0


def _parameters(fit: Estimate) -> dict[str, list[float | str]]:
    """By name: deviation and its 1-sigma, in tolerances, as the readings alone say it, and the class of parts.

    A fit is N(m, v) from a prior N(0, w) and the readings' N(x, e): 1 / e = 1 / v - 1 / w, x = m e / v (variances).
    """
    free = [k for k in fit.prior.free if k < len(fit.nominal.parameters)]
    tolerance = {k: fit.nominal.parameters[k].tolerance for k in free}
    at = [k for k in free if 0.0 < tolerance[k] < np.inf]
    if not at:
        return {}
    scale = np.array([tolerance[k] for k in at])
    v = (fit.std[at] / scale) ** 2
    w = (fit.prior.sigma[at] * fit.noise / scale) ** 2
    told = 1.0 / np.maximum(v, FINEST**2) - 1.0 / w  # w is infinite without a prior
    names = [fit.prior.names[k] for k in at]
    classes = part_classes(names, [fit.prior.parts[k] for k in at])
    out: dict[str, list[float | str]] = {}
    for k, name in enumerate(names):
        if told[k] < DETERMINED**-2:
            continue
        x = fit.in_tolerances[at[k]] / max(v[k], FINEST**2) / told[k]
        kind = " ".join(part for part in (classes[k].kind, classes[k].parts) if part)
        out[name] = [_short(float(x)), _short(float(told[k] ** -0.5)), kind]
    return out


# -- Sums over machines that add


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
        """Of one machine, from what ``truepose.identification.leaves.fleet.summary.kept`` keeps of it."""
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
