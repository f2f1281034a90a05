"""Whether the named physics also holds where it was not fitted, and what it owes to chance.

Held-out rows (role ``validation``, else blocks fixed before any fit), a placebo with permuted drivers, an
equally flexible black box, and the recovery of the effect injected into simulated data. And of each name, whether the halves
of a recording say the same, for what is physics is there in both, and how wide tolerances would have to be for it to fall.

What as many free functions of the joints predict: physics that was named must do better than so much freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs
from scipy.stats import chi2

from truepose.arrays import Array, Index, Mask
from truepose.identification.diagnosis.alarms import LARGEST_PROJECTION
from truepose.identification.diagnosis.holdout import ROLE, Comparison, held_out_blocks, ratio_interval
from truepose.identification.diagnosis.null_fits import CHANCE
from truepose.identification.diagnosis.posterior_summary import Named
from truepose.identification.diagnosis.result import NAMED, NOTABLE, Proof, Replication
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.selection_problem import selection_problem, weighed_alone
from truepose.identification.fit.estimated import Estimate
from truepose.identification.posterior.design import Design
from truepose.identification.posterior.marginal import ROUNDING
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.state import nearest_top, slot_odds
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.signatures import Signatures
from truepose.threads import in_order, one_thread

FREE_WAVE = 10.0
"""1-sigma of an amplitude of the black box, in sigmas of a reading: it may be anything."""


def black_box(before: Estimate, after: Estimate, recording: Recording, outliers: Mask) -> float | None:
    """Held-out ratio of as many free waves of the readings, in each residual channel, as the terms have coefficients."""
    count = sum(len(e.coefficients) for e in after.effects)
    free, m = before.prior.free, before.residual.shape[1]
    columns = len(free) + count
    if before.residual.size * columns > LARGEST_PROJECTION:
        return _of_some(before, after, recording, outliers, LARGEST_PROJECTION // (m * columns))
    predictor = Predictor(before.nominal, recording, before.effects)
    parts = predictor.blocks(before.p, before.x, before.used)
    jacobian = np.concatenate([b.jacobian[:, :, free] * before.prior.scale[free] for b in parts])
    rng = np.random.default_rng(13)
    t = (recording.q - recording.q.mean(axis=0)) / np.maximum(recording.q.std(axis=0), 1e-12)
    waves = np.cos(t @ rng.normal(0, 1.0, (t.shape[1], count)) + rng.uniform(0, 2 * np.pi, count))
    free_waves = Waves(waves, rng.integers(0, m, count), before.lost)
    split, blocks = held_out_blocks(recording, before.used)
    left, usable = [], np.isfinite(before.residual).all(axis=1) & ~outliers
    for beside in (None, free_waves):
        squares = [
            linear_test(jacobian, before, before.used & ~block.rows & usable, block.rows & usable, beside)
            for block in (blocks[-1:] if split == ROLE else blocks)
        ]
        left.append(np.concatenate(squares).mean())
    return float(np.sqrt(left[1] / left[0]))


def _of_some(
    before: Estimate, after: Estimate, recording: Recording, outliers: Mask, most: int
) -> float | None:
    """The same of evenly spread rows, as many as memory holds; None where readings compare rows."""
    if most < 1 or any(sensor.compares for sensor in before.nominal.sensors):
        return None
    every = recording.in_time(np.ones(len(recording), dtype=bool))
    rows = np.sort(every[:: -(-len(every) // most)])
    own = {name: getattr(before, name)[rows] for name in ("x", "residual", "used", "weights")}
    part = replace(before, **own, lost=before.lost_among(rows), unassembled=())
    return black_box(part, after, recording.subset(rows), outliers[rows])


@dataclass(frozen=True)
class Waves:
    """Functions of the row (n, k), each in one ``channel`` (k,); nothing where a reading was ``lost`` (n, m)."""

    values: Array
    channel: Index
    lost: Mask | None

    def gram(self, jacobian: Array, residual: Array, rows: Mask) -> Array:
        """(n + k + 1, n + k + 1) of [J W r] over some rows; waves of two channels have no reading in common."""
        n, size = jacobian.shape[2], jacobian.shape[2] + len(self.channel) + 1
        out = np.zeros((size, size))
        for channel in range(jacobian.shape[1]):
            own = np.flatnonzero(self.channel == channel)
            at = np.concatenate([np.arange(n), n + own, [size - 1]])
            waves = self._of(channel, own)[rows]
            part = np.hstack([jacobian[rows, channel], waves, residual[rows, channel][:, None]])
            out[np.ix_(at, at)] += part.T @ part
        return out

    def seen(self, amplitudes: Array, shape: tuple[int, ...]) -> Array:
        """(n, m) what they do to the readings with amplitudes (k,)."""
        out = np.zeros(shape)
        for channel in range(shape[1]):
            own = np.flatnonzero(self.channel == channel)
            out[:, channel] = self._of(channel, own) @ amplitudes[own]
        return out

    def _of(self, channel: int, own: Index) -> Array:
        there = 1.0 if self.lost is None else ~self.lost[:, [channel]]
        return np.asarray(self.values[:, own] * there)


def linear_test(
    jacobian: Array, before: Estimate, train: Mask, test: Mask, beside: Waves | None = None
) -> Array:
    """Squared residuals of held-out rows after one linear fit under tolerances from the training rows.

    ``beside``: free functions of the row, each with a tolerance of ``FREE_WAVE``.
    """
    free = before.prior.free
    waves = beside or Waves(np.zeros((len(jacobian), 0)), np.zeros(0, dtype=np.intp), None)
    n, k = len(free), len(free) + len(waves.channel)
    weight = np.concatenate([before.prior_weight, np.full(k - n, 1.0 / FREE_WAVE)])
    moved = (before.p - before.prior.mean)[free] / before.prior.scale[free]
    departure = np.concatenate([np.where(before.prior_weight > 0, moved, 0.0), np.zeros(k - n)])
    gram = waves.gram(jacobian, before.residual, train)
    right = gram[:-1, -1] + weight**2 * departure
    known = gram[:-1, :-1] + np.diag(weight**2)
    unit = 1.0 / np.sqrt(np.maximum(np.diag(known), 1e-300))
    step = -unit * _solution(known * unit[:, None] * unit, unit * right)
    changed = jacobian[test] @ step[:n] + waves.seen(step[n:], before.residual.shape)[test]
    return np.asarray(np.sum((before.residual[test] + changed) ** 2, axis=1))


def _solution(matrix: Array, right: Array) -> Array:
    """Of a symmetric problem of unit diagonal; the shortest one where rounding leaves directions open."""
    factor, failed = dpotrf(matrix, lower=1)
    if failed or np.min(np.diag(factor), initial=1.0) ** 2 < ROUNDING:
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=ROUNDING)[0])
    return np.asarray(dpotrs(factor, right, lower=1)[0])


WIDENINGS = tuple(np.round(np.geomspace(1.5, 100.0, 10), 1).tolist())
"""How many times wider than stated tolerances are tried for a name to fall."""
LIFT = 1e-9
"""Added to a unit diagonal: columns may depend on each other."""


def prove(
    before: Estimate, after: Estimate, held: Comparison, found: Found, main: int, outliers: Mask
) -> Proof:
    """All four proofs of the fit ``after``, ``held`` out against ``before``; ``main``: its best supported candidate;
    ``outliers`` (n,): rows left out."""
    recording = found.signatures.recording
    ratio, interval = ratio_interval(held.before, held.after)
    placebo, free = _placebo(before, found, main), black_box(before, after, recording, outliers)
    recovered = injected_recovered(after, found, main)
    return Proof(held.split, held.blocks, ratio, interval, placebo, free, recovered)


def _placebo(before: Estimate, found: Found, main: int) -> float:
    """Log Bayes factor of the main term when every row is given another row's drivers (nothing should remain)."""
    signatures, cat = found.signatures, found.catalogue
    recording = signatures.recording
    order = np.arange(len(before.used))
    # in the order of acquisition, so that shuffled rows get the same placebo
    rows = recording.in_time(before.used)
    order[rows] = np.random.default_rng(11).permutation(rows)
    stated = [cat.candidates[i] for i in cat.stated]
    single = Signatures(signatures.machine, recording, [cat.candidates[main], *stated])
    one = Catalogue(single.candidates, (0.0,) * len(single.candidates), (), tuple(range(1, 1 + len(stated))))
    lin, rms = single.linearise(before, order=order), float(np.sqrt(before.chi2_per_dof))
    return float(weighed_alone(selection_problem(lin, one, rms), 1)[0])


def injected_recovered(after: Estimate, found: Found, main: int) -> bool:
    """Simulate the machine with the main term at its fitted size; is it found again, and first of all?"""
    problem, cat, own = found.problem, found.catalogue, found.problem.spike_slab
    label = cat.candidates[main].label
    fitted = next(e for e in after.fitted_effects() if e.label == label)
    size = np.array(fitted.amplitudes) / [c.scale for c in fitted.coefficients]
    amplitude = found.linearisation.turn(main).T @ size
    noises = own.unknowns.scales(found.mode.point).tolist()
    design = _simulated(own.design, found.linearisation.columns[main], amplitude, noises)
    point = found.mode.point.widened(0)
    log_odds = SpikeSlab(design, own.unknowns, own.terms, own.sizes).log_odds(point, ())
    odds, causes = np.logaddexp.reduce(log_odds, axis=0), range(len(problem.causes))
    by_cause = np.array([np.logaddexp.reduce(odds[own.terms.cause == k]) for k in causes])
    alike = [k for k, c in enumerate(problem.causes) if c == cat.cause(main)]
    best, again = np.max(by_cause), np.max(by_cause[alike])
    # more likely there than not, too: where nothing can be seen, all are as good as the best
    return bool(again > max(0.0, best - NOTABLE))


def _simulated(design: Design, columns: slice, amplitude: Array, noises: Sequence[float]) -> Design:
    """The design with readings that hold nothing but a term of known amplitude, and noise."""
    rng, grams = np.random.default_rng(5), []
    at = design.n + np.arange(columns.start, columns.stop)
    for gram, count, noise in zip(design.grams, design.counts, noises, strict=True):
        own = gram[:-1, :-1]
        # the projection of white noise on the columns has their Gram matrix as covariance
        scale = np.sqrt(np.maximum(np.diag(own), 1e-300))
        lifted = own / scale[:, None] / scale + LIFT * np.eye(len(own))
        projected = noise * scale * (np.linalg.cholesky(lifted) @ rng.standard_normal(len(own)))
        new = gram.copy()
        new[:-1, -1] = new[-1, :-1] = own[:, at] @ amplitude + projected
        square = amplitude @ own[np.ix_(at, at)] @ amplitude + 2.0 * amplitude @ projected[at]
        new[-1, -1] = square + noise**2 * count
        grams.append(new)
    return Design(tuple(grams), design.counts, design.always)


@dataclass(frozen=True)
class _InHalf:
    """Of one name: its probability in a half, its coefficients there (k,) with their covariance; whether it would be seen, and
    the log prior odds of it beside the others."""

    probability: float
    shown: bool
    log_prior: float
    mean: Array
    covariance: Array


def replications(found: Found, names: Sequence[Named], rms: float) -> tuple[Replication | None, ...]:
    """For each name; None where a half has fewer readings than the model has unknowns."""
    if not names:
        return ()
    first, second = in_order(partial(_weigh_half, found, names, rms), range(2))
    if first is None or second is None:
        return (None,) * len(names)
    return tuple(_replicated(*pair) for pair in zip(first, second, strict=True))


def _weigh_half(found: Found, names: Sequence[Named], rms: float, number: int) -> list[_InHalf] | None:
    """Return what one half of the rows says of each name; None where it has fewer readings than the model has unknowns."""
    with one_thread():  # both halves are weighed beside each other
        if found.halves is not None:
            lin = found.halves[number]
        else:  # in the order of acquisition
            used = np.zeros(len(found.fit.used), dtype=bool)
            used[np.array_split(found.signatures.recording.in_time(found.fit.used), 2)[number]] = True
            lin = found.signatures.linearise(replace(found.fit, used=used))
        if lin.n_observations <= lin.free + len(found.problem.spike_slab.columns(found.mode.members)[0]):
            return None
        problem = selection_problem(lin, found.catalogue, rms)
        del lin  # a large matrix: the problem has its own
        holds = problem.spike_slab.holds(found.mode.members)
        return _half(problem.spike_slab, found, names) if holds else None


def _half(spike_slab: SpikeSlab, found: Found, names: Sequence[Named]) -> list[_InHalf]:
    """What half of the rows says of each name beside the mode's other members, at its likeliest point."""
    members = found.mode.members  # the same catalogue: the same numbers
    point = spike_slab.unknowns.nearest(found.mode.point)
    point = nearest_top(spike_slab, point, members, thorough=not spike_slab.is_long(members))
    columns, sizes = spike_slab.columns(members)
    mean, covariance = spike_slab.root(point).posterior(columns, sizes)
    place, out = {int(c): k for k, c in enumerate(columns)}, list[_InHalf]()
    for name in names:
        own = [m for m in members if found.problem.candidates[m[0]] in name.candidates]
        rest = tuple(m for m in members if m not in own)
        shares = spike_slab.conditional(point, rest).terms(slot_odds(found.problem.richness, len(rest)))
        causes = {int(spike_slab.terms.cause[term]) for term, _ in own}
        said = float(min(sum(shares[spike_slab.terms.cause == k].sum() for k in causes), 1.0))
        at = [place[c] for c in found.linearisation.indices(name.candidates)]
        shown = any(spike_slab.noticeable[size, term] for term, size in own)
        odds = sum(slot_odds(found.problem.richness, len(rest) + k) for k in range(len(own)))
        log_prior = spike_slab.terms.log_prior_of(members) - spike_slab.terms.log_prior_of(rest) + odds
        out.append(_InHalf(said, shown, float(log_prior), mean[at], covariance[np.ix_(at, at)]))
    return out


def _replicated(first: _InHalf, second: _InHalf) -> Replication:
    difference, spread = first.mean - second.mean, first.covariance + second.covariance
    statistic = float(difference @ np.linalg.lstsq(spread, difference, rcond=1e-10)[0])
    agree = bool(chi2.sf(statistic, len(difference)) > CHANCE)
    shown = _could_show(first, second), _could_show(second, first)
    return Replication((first.probability, second.probability), agree, shown)


def _could_show(half: _InHalf, other: _InHalf) -> bool:
    """Return False where a half would not name what the other one names, although it were there: its driver hardly varies.

    The log Bayes factor to expect of the other half's amplitude is then less than the prior odds against the name.
    """
    precision = np.linalg.pinv(half.covariance, hermitian=True)
    expected = 0.5 * float(other.mean @ precision @ other.mean) + half.log_prior
    return half.shown and not (expected < 0.0 and other.probability >= NAMED)


def flip_inflation(found: Found, one: Named) -> float | None:
    """How many times wider every tolerance would have to be for the name not to be needed; None when none would do."""
    problem, mode = found.problem, found.mode
    spike_slab = problem.spike_slab
    own = {t for t, _ in mode.members if problem.candidates[t] in one.candidates}
    wider = tuple((w,) * len(problem.classes) for w in WIDENINGS)
    unknowns = replace(spike_slab.unknowns, widening=wider, log_widening=(0.0,) * len(wider))
    wanted = np.isin(np.arange(len(spike_slab.terms)), [t for t, _ in mode.members])
    part, index = spike_slab.restricted(wanted)
    part = SpikeSlab(part.design, unknowns, part.terms, part.sizes)
    place = {int(t): k for k, t in enumerate(index)}
    every = [(place[t], s) for t, s in mode.members]
    rest = [(place[t], s) for t, s in mode.members if t not in own]
    odds = part.log_prior(every) - part.log_prior(rest)
    odds += sum(slot_odds(problem.richness, len(rest) + k) for k in range(len(every) - len(rest)))

    def needed(k: int) -> bool:
        point = mode.point._replace(widening=k)
        return part.log_evidence(point, every) - part.log_evidence(point, rest) + odds > 0.0

    enough = not needed(len(WIDENINGS) - 1)
    return next(w for k, w in enumerate(WIDENINGS) if not needed(k)) if enough else None
