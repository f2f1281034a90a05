"""Turn explanations into contests: which version of each is true, how large it is, and which versions rival it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.leaves.planning.discriminate.factors import (
    EXPECTED,
    Explanation,
    Form,
)
from truepose.identification.leaves.planning.discriminate.race import Contest, Race
from truepose.identification.leaves.planning.discriminate.rows import WIDE, Signals
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.empirical import Empirical

RIVAL_FORMS = 3
"""Versions of a rival that are followed: those that come closest to what may be true."""
FOUND = 6.0
"""Least chi2 of a signal that a diagnosis would find: of a smaller one nobody can say what imitates it."""
UNSEEN = 1e-3
"""Information, in units of what tolerances say, below which all rows together do not see a direction of geometry."""
INSEPARABLE = 0.01
"""Expected log Bayes factor below which every row that may be taken, together, tells nothing."""


@dataclass(frozen=True)
class Hypothesis:
    """An explanation with the version that may be true, its coefficients in scales (w, r), and rival versions.

    Columns of ``amplitude`` are independent cases of unknown sign; one column where the coefficients are known.
    """

    explanation: Explanation
    true: Index
    amplitude: Array
    rivals: tuple[Index, ...]


class Field:
    """Signals of the rows that may be taken (and base, those that exist), with the columns of every effect.

    base (k + w, k + w): Gram matrix of [geometry effects]; others: effects that are there as well, of any size.
    """

    def __init__(
        self, rows: Signals, base: Array, parts: Sequence[PlacedEffect], others: Sequence[PlacedEffect]
    ) -> None:
        self.rows, self.base = _seen(rows, base)
        self.parts, self.others = tuple(parts), tuple(others)
        self._labels = [part.label for part in parts]
        self._beside = self.columns(self.others)

    @property
    def every(self) -> list[int]:
        """Numbers of all rows."""
        return list(range(len(self.rows.effects)))

    @property
    def geometry(self) -> int:
        """How many constants there are."""
        return len(self.rows.precision)

    def columns(self, form: Form) -> Index:
        """(c,) columns of the effects' signatures that a version has."""
        at = [self.rows.columns[self._labels.index(part.label)] for part in form]
        return np.concatenate([np.arange(a.start, a.stop) for a in at] or [np.zeros(0)]).astype(np.intp)

    def contest(self, rival: Index, cases: Sequence[tuple[int, Hypothesis]]) -> Contest:
        """A rival's version, its columns (c,), against hypotheses, each with the number of its pair."""
        inside = np.union1d(rival, self._beside)
        some, k = self.rows, self.geometry
        mix = np.hstack([self._mixed(h.true, h.amplitude) for _, h in cases])
        kept = np.concatenate([np.arange(k), k + inside])
        turn = np.zeros((len(self.base), len(kept) + mix.shape[1]))
        turn[kept, np.arange(len(kept))] = 1.0
        turn[k:, len(kept) :] = mix
        wide = np.full(len(inside), WIDE**-2.0)
        numbers = np.concatenate([np.full(h.amplitude.shape[1], pair) for pair, h in cases])
        return Contest(
            nuisance=np.concatenate([some.geometry, some.effects[:, :, inside]], axis=2),
            signal=some.effects @ mix,
            precision=np.concatenate([self.rows.precision, wide]),
            base=turn.T @ self.base @ turn,
            pair=numbers.astype(np.intp),
        )

    def _mixed(self, columns: Index, amplitude: Array) -> Array:
        out = np.zeros((self.rows.effects.shape[2], amplitude.shape[1]))
        out[columns] = amplitude
        return out

    def imitated(self, gram: Array, true: Index, amplitude: Array, rival: Index) -> tuple[float, Array]:
        """Share of the true signal that a rival leaves on rows of ``gram`` (k + w, k + w), geometry adapting.

        Also the rival's coefficients (r, s); ``true`` (t,) and ``rival`` (r,) are columns, ``amplitude`` (t, s).
        """
        left, n = self.information(gram, np.concatenate([true, rival])), len(true)
        total = float(np.sum(amplitude * (left[:n, :n] @ amplitude)))
        own = left[n:, n:] + WIDE**-2.0 * np.eye(len(rival))
        answer = np.linalg.solve(own, left[n:, :n] @ amplitude)
        caught = float(np.sum(answer * (left[n:, :n] @ amplitude)))
        return (max(1.0 - caught / total, 0.0) if total > FOUND else 1.0), answer

    def information(self, gram: Array, columns: Index) -> Array:
        """Return what rows of ``gram`` (k + w, k + w) tell of columns (c,), geometry integrated out, shape (c, c)."""
        k = self.geometry
        inside = np.concatenate([np.arange(k), k + self._beside])
        precision = np.concatenate([self.rows.precision, np.full(len(self._beside), WIDE**-2.0)])
        inner = gram[np.ix_(inside, inside)] + np.diag(precision)
        cross = gram[np.ix_(inside, k + columns)]
        own = gram[np.ix_(k + columns, k + columns)]
        return np.asarray(own - cross.T @ np.linalg.solve(inner, cross))


def _seen(rows: Signals, base: Array) -> tuple[Signals, Array]:
    """Geometry in those directions only of which all rows together tell anything beside its tolerances."""
    k = len(rows.precision)
    root = 1.0 / np.sqrt(rows.precision)
    stacked = rows.geometry.reshape(-1, k) * root
    values, vectors = np.linalg.eigh(stacked.T @ stacked + root[:, None] * base[:k, :k] * root)
    turn = root[:, None] * vectors[:, values > UNSEEN]
    wide = np.zeros((len(base), turn.shape[1] + len(base) - k))
    wide[:k, : turn.shape[1]], wide[k:, turn.shape[1] :] = turn, np.eye(len(base) - k)
    seen = replace(rows, geometry=rows.geometry @ turn, precision=np.ones(turn.shape[1]))
    return seen, wide.T @ base @ wide


def hypotheses(
    field: Field, explanations: Sequence[Explanation], known: Array, everywhere: Array
) -> tuple[Hypothesis, ...]:
    """Every explanation with its size and its likeliest rival versions.

    One of unknown size has the size that imitates best, on the rows of the Gram matrix ``known``, one whose size is
    known, if it imitates more than half of it (that is why both are still thought of); else what the catalogue
    expects. Rival versions are ranked on the rows of ``everywhere``; both matrices are (k + w, k + w).
    """
    named = next((e for e in explanations if e.amplitude is not None), None)
    sized = [_sized(field, e, named, known) for e in explanations]
    out = []
    for k, (explanation, (true, amplitude)) in enumerate(zip(explanations, sized, strict=True)):
        others = [pair for m, pair in enumerate(sized) if m != k]
        versions = [field.columns(form) for form in explanation.forms]
        left = [min(field.imitated(everywhere, *other, v)[0] for other in others) for v in versions]
        order = np.argsort(left, kind="stable")[:RIVAL_FORMS]
        out.append(Hypothesis(explanation, true, amplitude, tuple(versions[k] for k in order)))
    return tuple(out)


def _sized(
    field: Field, explanation: Explanation, named: Explanation | None, known: Array
) -> tuple[Index, Array]:
    """Columns of the true version and its coefficients."""
    first = field.columns(explanation.forms[0])
    if explanation.amplitude is not None:
        return first, explanation.amplitude[:, None]
    if named is not None and named.amplitude is not None:
        true = field.columns(named.forms[0])
        versions = [field.columns(form) for form in explanation.forms]
        tried = [field.imitated(known, true, named.amplitude[:, None], v) for v in versions]
        best = int(np.argmin([left for left, _ in tried]))
        if tried[best][0] < 0.5:
            version, mean = versions[best], tried[best][1]
            spread = _spread(field.information(known, version), mean)
            return version, np.hstack([mean, spread]) if explanation.slug == Empirical.slug else mean
    return first, EXPECTED * np.eye(len(first))


def _spread(told: Array, mean: Array) -> Array:
    """Return a root (r, r) of the covariance that rows which tell ``told`` (r, r) leave to a form with a ``mean`` (r, s).

    A form without a name is any smooth function, not the one that imitates best. Before any row its coefficients are as
    large as the mean's. As further cases, the root's columns make a chi2 the expected one: coefficients are integrated out.
    """
    size = max(EXPECTED, float(np.sqrt(np.mean(mean**2))))
    return np.asarray(np.linalg.inv(np.linalg.cholesky(told + size**-2.0 * np.eye(len(told)))).T)


def race(field: Field, found: Sequence[Hypothesis]) -> Race:
    """Contests on all rows; pairs are numbered as in ``ordered``."""
    numbers = {pair: k for k, pair in enumerate(ordered(len(found)))}
    contests = []
    for j, rival in enumerate(found):
        cases = [(numbers[i, j], h) for i, h in enumerate(found) if i != j]
        contests += [field.contest(version, cases) for version in rival.rivals]
    twins = np.array([found[i].explanation.twin_of(found[j].explanation) for i, j in numbers])
    open_race = Race(tuple(contests), len(numbers), ~twins)
    told = open_race.values(field.every)
    return replace(open_race, counted=(told > INSEPARABLE) & ~twins)


def shares(field: Field, found: Sequence[Hypothesis], on: Race) -> Array:
    """(p,) of each pair, the share of the true signal on all rows that its rival cannot reproduce; 0 without signal."""
    k = field.geometry
    gram = field.rows.gram[k:, k:] + field.base[k:, k:]
    signal = [
        0.5 * float(np.sum(h.amplitude * (gram[np.ix_(h.true, h.true)] @ h.amplitude)))
        for h in (found[i] for i, _ in ordered(len(found)))
    ]
    return np.asarray(on.values(field.every) / np.maximum(signal, 1e-300))


def ordered(n: int) -> list[tuple[int, int]]:
    """Pairs (true, rival) of n explanations."""
    return [(i, j) for j in range(n) for i in range(n) if i != j]
