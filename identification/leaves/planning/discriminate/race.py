"""From explanations to contests: which version of each is true, how large it is, and which versions rival it.

How well rows tell explanations apart, and which rows do it best.

With the readings whitened, let i be true with coefficients a, and let j claim to be. What j cannot reproduce, with
any size of its own and with geometry adapting within its tolerances, is

    chi2(i | j) = a' [L_ii - L_ij (L_jj + 1/WIDE^2)^-1 L_ji] a,   L = G' V^-1 G,  V = I + J S^2 J',

and the log Bayes factor of i against j is expected to be half of it. A set of rows is worth what it says of the
worst pair. Adding a row never lowers it: chi2 is a Schur complement of the information.

Rows that an experiment may take, and what each would tell of the constants and of every explanation.

A row is a pose with a setting of the factors; its readings' derivatives come from the diagnosis' own signatures, on
a recording that was never made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from truepose.arrays import Array, Index, Mask
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import Solution, Status
from truepose.identification.fit.problem import prior_of
from truepose.identification.leaves.planning.discriminate.factors import (
    EXPECTED,
    Explanation,
    Factor,
    Form,
    settings,
)
from truepose.identification.leaves.planning.information import (
    UNKNOWN,
    PoseInformation,
    Supply,
    rounded,
    unmeasured,
)
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.history import line_of_full_loop
from truepose.identification.recording.recording import Recording, frozen
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect
from truepose.models.file.driver import APPROACH, OF_THE_WAY, SESSION, TIME, Driver
from truepose.models.machine.machine import Machine

# -- Rows that an experiment may take, and what each would tell of the constants and of every explanation

WIDE = 100.0
"""Prior 1-sigma of an effect of any size, in units of its scale: as in the diagnosis."""
_COMPRESSED = 8
_RANK = 1e-14


@dataclass(frozen=True)
class Rows:
    """q (c, nq) internal units; drivers: (c,) levels by name, ``session`` and ``time`` among them."""

    q: Array
    drivers: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.q)

    def take(self, rows: Sequence[int] | Index | Mask) -> Rows:
        """Rows by number (k,) or by mask (n,)."""
        chosen = np.asarray(rows)
        return Rows(self.q[chosen], {name: values[chosen] for name, values in self.drivers.items()})


class _Steady(Recording):
    """Rows with no past but their own: temperatures are held until bodies follow, so that a lagged driver is the driver
    itself; a joint arrived by a long move, so that what its way leaves behind depends on the side alone."""

    def driver(self, name: str, sessions: Sequence[int] | None = None) -> Array | None:
        driver = Driver.of(name)
        if driver.kind not in OF_THE_WAY or driver.place not in self.joints:
            return super().driver(driver.now.name, sessions)
        side = self.drivers.get(Driver(APPROACH, driver.place).name)
        if side is None:
            return None
        half_width, *ends = driver.numbers
        lead = side * half_width
        if driver.kind == "stop":
            return np.asarray(lead)
        q = self.moved[:, self.joints.index(driver.place)]
        return np.asarray(lead - line_of_full_loop(q, half_width, *ends))


@dataclass(frozen=True)
class Signals:
    """Whitened derivatives of rows' readings: geometry (c, m, k) in prior scales with ``precision`` (k,), and
    effects (c, m, w) in scales, those of effect i in ``columns[i]``; names (k,) of the constants."""

    names: tuple[str, ...]
    geometry: Array
    effects: Array
    precision: Array
    columns: tuple[slice, ...]

    def take(self, rows: Mask | Index) -> Signals:
        """Of rows by number (k,) or by mask (n,)."""
        return replace(self, geometry=self.geometry[rows], effects=self.effects[rows])

    @property
    def gram(self) -> Array:
        """(k + w, k + w) Gram matrix of [geometry effects] over all rows."""
        stacked = np.concatenate([self.geometry, self.effects], axis=2)
        stacked = stacked.reshape(-1, stacked.shape[2])
        return np.asarray(stacked.T @ stacked)


def signals(machine: Machine, recording: Recording, parts: Sequence[PlacedEffect]) -> Signals:
    """What rows would tell at the drawing values, noise as stated; rows of role validation and such that cannot be
    assembled tell nothing."""
    labels = {part.label for part in parts}
    machine = machine.with_effects(tuple(e for e in machine.effects if e.label not in labels))
    fit, read = _at_drawing(machine, recording)
    free = fit.prior.free
    geometry, shifts = [], []
    for rows, block, signature in Signatures(machine, read, parts).rows(fit):
        used = fit.used[rows, None, None]
        whole = np.concatenate([block.jacobian[:, :, free] * fit.prior.scale[free], signature], axis=2)
        whole = _compressed(np.where(used, whole, 0.0))
        geometry.append(whole[:, :, : len(free)])
        shifts.append(whole[:, :, len(free) :])
    ends = np.cumsum([0, *(len(part.coefficients) for part in parts)])
    weight = np.maximum(fit.prior_weight, 1.0 / UNKNOWN)
    return Signals(
        names=tuple(fit.prior.names[k] for k in free),
        geometry=_stacked(geometry),
        effects=_stacked(shifts),
        precision=weight**2,
        columns=tuple(slice(int(a), int(b)) for a, b in pairwise(ends)),
    )


def recording_of(machine: Machine, rows: Rows, reference: Array) -> Recording:
    """Rows as a recording without readings, after one row at the ``reference`` pose (nq,), which changes count from."""
    q = np.concatenate([reference[None], rows.q])
    n = len(q)
    drivers = {name: np.concatenate([values[:1], values]) for name, values in rows.drivers.items()}
    session = drivers.pop(SESSION, np.ones(n)).astype(np.int64)
    time = drivers.pop(TIME, None)
    return unmeasured(
        machine,
        q,
        "planned rows",
        _Steady,
        drivers={name: frozen(values) for name, values in drivers.items()},
        session=frozen(session),
        session_recorded=frozen(np.ones(n, dtype=bool)),
        time=None if time is None else frozen(time),
        from_row=frozen(np.zeros(n, dtype=np.int64)),
    )


def _at_drawing(machine: Machine, recording: Recording) -> tuple[Estimate, Recording]:
    """The machine as the file has it in place of a fit, and the rows as it would read them."""
    predictor = Predictor(machine, recording, machine.effects)
    prior, p = prior_of(machine, machine.effects), predictor.model.p_home
    x, good = predictor.assemble(p)
    names, values, _ = predictor.values(p, x)
    exact = {name: frozen(values[:, k].copy()) for k, name in enumerate(names)}
    nothing = np.zeros(len(prior.free))
    return Estimate(
        nominal=machine,
        recording=recording,
        effects=machine.effects,
        prior=prior,
        p=p,
        x=x,
        residual=np.zeros((len(x), len(predictor.channels))),
        used=good & ~recording.validation,
        weights=np.ones(len(x)),
        factor=np.zeros((0, len(nothing) + 1)),
        solution=Solution(nothing, np.zeros((0, 0)), 0.0, Status.CONVERGED, 0, 0.0, nothing),
        unassembled=tuple(int(k) for k in np.flatnonzero(~good)),
    ), replace(recording, observations=exact)


def _compressed(rows: Array) -> Array:
    """(c, r, k) with as few readings a row as hold the same information: a mirror's twelve points say six things."""
    if rows.shape[1] <= _COMPRESSED:
        return rows
    values, vectors = np.linalg.eigh(rows @ rows.transpose(0, 2, 1))
    rank = max(1, int(np.max(np.sum(values > _RANK * np.max(values, initial=0.0), axis=1))))
    out: Array = vectors[:, :, -rank:].transpose(0, 2, 1) @ rows
    return out


def _stacked(parts: Sequence[Array]) -> Array:
    """Blocks of rows end to end; one that needs fewer readings is filled up with zeros."""
    most = max(part.shape[1] for part in parts)
    return np.concatenate([np.pad(p, ((0, 0), (most - p.shape[1], 0), (0, 0))) for p in parts])


ROWS, LEAST_POSES = 2400, 120
"""Rows to choose from; poses among them at least."""
# -- The rows that an experiment may choose from

STEP = 1e-6
"""Joint values are rounded to about this share of their range."""


@dataclass(frozen=True)
class Pool:
    """Rows that may be taken; nominal (n,): those at which every factor has its nominal value."""

    rows: Rows
    reference: Array
    nominal: Mask

    @classmethod
    def of(
        cls, machine: Machine, varied: Sequence[Factor], candidates: Array | None, rng: np.random.Generator
    ) -> Pool:
        """From poses ``candidates`` (c, nq), or from drawn ones, crossed with the levels of all factors."""
        information = PoseInformation(machine)
        q = rng.permutation(Supply.of(information, candidates, rng).poses.q)
        q = q if candidates is not None else rounded(q, machine, STEP)
        every = settings(varied, rng)
        q = q[: max(LEAST_POSES, ROWS // len(every))]
        levels = np.tile(every, (len(q), 1)).T
        drivers = {factor.driver: own for factor, own in zip(varied, levels, strict=True)}
        rows = Rows(np.repeat(q, len(every), axis=0), drivers)
        still = [rows.drivers[factor.driver] == factor.nominal for factor in varied]
        return cls(rows, information.home, np.logical_and.reduce([np.ones(len(rows), dtype=bool), *still]))


# -- How well rows tell explanations apart, and which rows do it best

Single = NDArray[np.float32]
WORST = 4.0
"""Exponent of the mean that stands for the worst pair: smooth, and of no unit."""
_LEAST = 1e-12
_GAIN = 1e-3
_TRIALS = 3
_SHORT, _EVERY = 300, 5


@dataclass(frozen=True)
class Contest:
    """One rival against everything that may be true instead.

    nuisance (c, m, k): readings' derivatives by geometry and by the rival, precision (k,) their prior; signal
    (c, m, s): what each true explanation does to the readings, in sigmas; base (k + s, k + s): Gram matrix of
    [nuisance signal] over rows that exist already; pair (s,): number of the pair that a signal belongs to.
    """

    nuisance: Array
    signal: Array
    precision: Array
    base: Array
    pair: Index

    def missed(self, design: Sequence[int]) -> Array:
        """(s,) chi2 that the rival cannot reproduce on the rows of a design and on those that exist."""
        return self._solved(design)[2]

    def after_adding(self, design: Sequence[int], rows: Index) -> Array:
        """(r, s) the same with one more row, for each of ``rows`` (r,)."""
        white, error, missed = self._seen(design, rows)
        return np.asarray(missed + _weighed(white, error, 1.0))

    def after_removing(self, design: Sequence[int]) -> Array:
        """(n, s) the same with one row of the design less, for every one."""
        white, error, missed = self._seen(design, np.asarray(design))
        return np.asarray(np.maximum(missed - _weighed(white, error, -1.0), 0.0))

    def _seen(self, design: Sequence[int], rows: Index) -> tuple[Single, Array, Array]:
        """Of some rows: nuisance in units of what the design leaves open (n, m, k), signal that it would not foresee
        (n, m, s); and the design's chi2 (s,)."""
        root, answer, missed = self._solved(design)
        nuisance = self.nuisance[rows]
        c, m, k = nuisance.shape
        # single precision serves to rank rows; what a design is worth never comes from here
        single = nuisance.reshape(-1, k).astype(np.float32) @ root.astype(np.float32)
        white = np.asarray(single.reshape(c, m, k))
        return white, self.signal[rows] - nuisance @ answer, missed

    def _solved(self, design: Sequence[int]) -> tuple[Array, Array, Array]:
        """Root of the nuisance's covariance (k, k), what it answers to the signals (k, s), chi2 left (s,)."""
        k = len(self.precision)
        at = np.asarray(design, dtype=np.intp)
        rows = np.concatenate([self.nuisance[at], self.signal[at]], axis=2)
        rows = rows.reshape(-1, rows.shape[2])
        gram = self.base + rows.T @ rows
        inner = gram[:k, :k] + np.diag(self.precision)
        size = np.sqrt(np.diag(inner))
        factor = cho_factor(inner / np.outer(size, size) + 1e-14 * np.eye(k), lower=True)
        root = solve_triangular(factor[0], np.diag(1.0 / size), lower=True).T
        cross = gram[:k, k:]
        answer = cho_solve(factor, cross / size[:, None]) / size[:, None]
        left = np.diag(gram[k:, k:]) - np.sum(cross * answer, axis=0)
        return np.asarray(root), np.asarray(answer), np.maximum(left, 0.0)


@dataclass(frozen=True)
class Race:
    """All contests; ``pairs`` of them are counted, those that no row at all could tell apart are not."""

    contests: tuple[Contest, ...]
    pairs: int
    counted: Mask

    def values(self, design: Sequence[int]) -> Array:
        """(p,) expected log Bayes factor of each pair; of a rival's forms the one that does best counts."""
        return self._gathered([c.missed(design) for c in self.contests])

    def judged(self, values: Array) -> Array:
        """Smooth stand-in, of shape (...), of the worst of the p pairs that count, from ``values`` (..., p)."""
        some = np.maximum(values[..., self.counted], _LEAST)
        least = np.min(some, axis=-1, keepdims=True)
        return np.asarray(least[..., 0] * np.mean((some / least) ** -WORST, axis=-1) ** (-1.0 / WORST))

    def adding(self, design: Sequence[int], rows: Index) -> Array:
        """(r,) judgement of the design with one more row, for each of ``rows``; none is taken twice."""
        out = self.judged(self._gathered([c.after_adding(design, rows) for c in self.contests]))
        return np.where(np.isin(rows, design), -np.inf, out)

    def removing(self, design: Sequence[int]) -> Array:
        """(n,) judgement of the design with one row less."""
        return self.judged(self._gathered([c.after_removing(design) for c in self.contests]))

    def _gathered(self, chi2: Sequence[Array]) -> Array:
        """(..., p) half the chi2 of each pair, by the rival's best form."""
        shape = chi2[0].shape[:-1]
        out = np.full((*shape, self.pairs), np.inf)
        for contest, found in zip(self.contests, chi2, strict=True):
            for pair in np.unique(contest.pair):
                total = 0.5 * np.sum(found[..., contest.pair == pair], axis=-1)
                out[..., pair] = np.minimum(out[..., pair], total)
        return out


def chosen(race: Race, n: int) -> list[int]:
    """``n`` rows by greedy addition, then by exchange as long as that gains.

    All rows are looked at again every few steps, in between those that promised most.
    """
    every = np.arange(len(race.contests[0].signal))
    design: list[int] = []
    some = every
    while len(design) < min(n, len(every)):
        fresh = len(design) < _EVERY or len(design) % _EVERY == 0
        rows = every if fresh else some
        scores = race.adding(design, rows)
        design.append(int(rows[np.argmax(scores)]))
        some = rows[np.argsort(-scores)[:_SHORT]] if fresh else some
    if len(every) <= n:
        return design
    value = float(race.judged(race.values(design)))
    for step in range(n):
        trial, reached, some = _exchanged(race, design, every if step % _EVERY == 0 else some)
        if reached <= value * (1.0 + _GAIN):
            break
        design, value = trial, reached
    return design


def _exchanged(race: Race, design: list[int], rows: Index) -> tuple[list[int], float, Index]:
    """The row that is missed least exchanged for the best other one, its value, and the rows that came closest.

    Where that gains nothing the next ones are tried.
    """
    before = float(race.judged(race.values(design)))
    best, reached, some = design, before, rows
    for place in np.argsort(-race.removing(design))[:_TRIALS]:
        rest = [row for k, row in enumerate(design) if k != place]
        scores = np.where(rows == design[place], -np.inf, race.adding(rest, rows))
        some = rows[np.argsort(-scores)[:_SHORT]]
        trial = [*rest, int(some[0])]
        value = float(race.judged(race.values(trial)))
        if value > reached:
            return trial, value, some
    return best, reached, some


def _weighed(white: Single, error: Array, sign: float) -> Array:
    """(n, s) e' (1 + sign H)^-1 e, H = white white': what a row adds to chi2, or what it takes away."""
    inner = np.eye(white.shape[1]) + sign * (white @ white.transpose(0, 2, 1)).astype(float)
    return np.asarray(np.sum(error * np.linalg.solve(inner, error), axis=1))


# -- From explanations to contests: which version of each is true, how large it is, and which versions rival it

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
        k = self.geometry
        inside = np.concatenate([np.arange(k), k + self._beside])
        precision = np.concatenate([self.rows.precision, np.full(len(self._beside), WIDE**-2.0)])
        inner = gram[np.ix_(inside, inside)] + np.diag(precision)
        outer = k + np.concatenate([true, rival])
        cross = gram[np.ix_(inside, outer)]
        left = gram[np.ix_(outer, outer)] - cross.T @ np.linalg.solve(inner, cross)
        n = len(true)
        total = float(np.sum(amplitude * (left[:n, :n] @ amplitude)))
        own = left[n:, n:] + WIDE**-2.0 * np.eye(len(rival))
        answer = np.linalg.solve(own, left[n:, :n] @ amplitude)
        caught = float(np.sum(answer * (left[n:, :n] @ amplitude)))
        return (max(1.0 - caught / total, 0.0) if total > FOUND else 1.0), answer


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
            return versions[best], tried[best][1]
    return first, EXPECTED * np.eye(len(first))


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
