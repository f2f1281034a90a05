"""Whether the named physics also holds where it was not fitted, and what it owes to chance.

Held-out rows (role ``validation``, else blocks fixed before any fit), a placebo with permuted drivers, an
equally flexible black box, and the recovery of the effect injected into simulated data.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.alone import weighed_alone
from truepose.identification.diagnosis.holdout import ROLE, Comparison, held_out_blocks, ratio_interval
from truepose.identification.diagnosis.result import Proof
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.selection_problem import selection_problem
from truepose.identification.fit.estimate import Estimate
from truepose.identification.posterior.design import Design
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.linearisation import Signatures

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
INDISTINCT = 3.0
"""Log odds between explanations that are as good as each other."""
LIFT = 1e-9
"""Added to a unit diagonal: columns may depend on each other."""


def prove(
    before: Estimate, after: Estimate, held: Comparison, found: Found, main: int, outliers: Mask
) -> Proof:
    """All four proofs of the fit ``after``, ``held`` out against ``before``; ``main``: its best supported candidate;
    ``outliers`` (n,): rows left out."""
    recording = found.signatures.recording
    ratio, interval = ratio_interval(held.before, held.after)
    return Proof(
        held_out=held.split,
        blocks=held.blocks,
        ratio=ratio,
        ratio_interval=interval,
        placebo_gain=_placebo(before, found, main),
        black_box_ratio=black_box(before, after, recording, outliers),
        injected_recovered=injected_recovered(after, found, main),
    )


def _placebo(before: Estimate, found: Found, main: int) -> float:
    """Log Bayes factor of the main term when every row is given another row's drivers (nothing should remain)."""
    signatures, cat = found.signatures, found.catalogue
    recording = signatures.recording
    order = np.arange(len(before.used))
    # in the order of acquisition, so that shuffled rows get the same placebo
    in_time = recording.order
    rows = in_time[before.used[in_time]]
    order[rows] = np.random.default_rng(11).permutation(rows)
    stated = [cat.candidates[i] for i in cat.stated]
    single = Signatures(signatures.machine, recording, [cat.candidates[main], *stated])
    one = Catalogue(single.candidates, (0.0,) * len(single.candidates), (), tuple(range(1, 1 + len(stated))))
    problem = selection_problem(
        single.linearise(before, order=order), one, float(np.sqrt(before.chi2_per_dof))
    )
    return float(weighed_alone(problem, 1)[0])


def injected_recovered(after: Estimate, found: Found, main: int) -> bool:
    """Simulate the machine with the main term at its fitted size; is it found again, first of all?"""
    problem, cat = found.problem, found.catalogue
    label = cat.candidates[main].label
    fitted = next(e for e in after.fitted_effects() if e.label == label)
    amplitude = np.array(fitted.amplitudes) / [c.scale for c in fitted.coefficients]
    columns = found.linearisation.columns[main]
    noises = problem.spike_slab.unknowns.scales(found.mode.point).tolist()
    design = _simulated(problem.spike_slab.design, columns, amplitude, noises)
    spike_slab = SpikeSlab(
        design, problem.spike_slab.unknowns, problem.spike_slab.terms, problem.spike_slab.sizes
    )
    odds = np.logaddexp.reduce(
        spike_slab.log_odds(found.mode.point._replace(widening=0, remainder=0), ()), axis=0
    )
    cause = problem.spike_slab.terms.cause
    by_cause = np.array([np.logaddexp.reduce(odds[cause == k]) for k in range(len(problem.causes))])
    alike = [k for k, c in enumerate(problem.causes) if c == cat.cause(main)]
    return bool(np.max(by_cause) - np.max(by_cause[alike]) < INDISTINCT)


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


def black_box(before: Estimate, after: Estimate, recording: Recording, outliers: Mask) -> float | None:
    """Held-out ratio of as many free waves of the readings, in each residual channel, as the terms have coefficients."""
    from truepose.identification.prediction.predictor import Predictor

    count = sum(len(e.coefficients) for e in after.effects)
    predictor = Predictor(before.machine, recording, before.effects)
    free, m = before.prior.free, before.residual.shape[1]
    usable = np.isfinite(before.residual).all(axis=1)
    if before.residual.size * (len(free) + count) > 60_000_000:
        return None
    jacobian = np.concatenate(
        [
            b.jacobian[:, :, free] * before.prior.scale[free]
            for b in predictor.blocks(before.p, before.x, before.used)
        ]
    )
    rng = np.random.default_rng(13)
    t = (recording.q - recording.q.mean(axis=0)) / np.maximum(recording.q.std(axis=0), 1e-12)
    waves = np.cos(t @ rng.normal(0, 1.0, (t.shape[1], count)) + rng.uniform(0, 2 * np.pi, count))
    channel = rng.integers(0, m, count)
    extra = np.zeros((len(t), m, count))
    extra[:, channel, np.arange(count)] = waves
    if before.lost is not None:
        extra[before.lost] = 0.0
    split, blocks = held_out_blocks(recording, before.used)
    if split == ROLE:
        blocks = blocks[-1:]
    squares_before: list[Array] = []
    squares_box: list[Array] = []
    for block in blocks:
        train = before.used & ~block.rows & usable & ~outliers
        test = block.rows & usable & ~outliers
        for design, out in (
            (jacobian, squares_before),
            (np.concatenate([jacobian, extra], axis=2), squares_box),
        ):
            out.append(linear_test(design, before, train, test))
    ratio = np.concatenate(squares_box).mean() / np.concatenate(squares_before).mean()
    return float(np.sqrt(ratio))


def linear_test(design: Array, before: Estimate, train: Mask, test: Mask) -> Array:
    """Squared residuals of held-out rows after one linear fit under tolerances from the training rows."""
    free = before.prior.free
    n, k = len(free), design.shape[2]
    weight = np.concatenate([before.prior_weight, np.full(k - n, 0.1)])
    departure = np.where(
        before.prior_weight > 0, (before.p - before.prior.mean)[free] / before.prior.scale[free], 0.0
    )
    rows = np.vstack([design[train].reshape(-1, k), np.diag(weight)])
    right = np.concatenate(
        [before.residual[train].ravel(), weight * np.concatenate([departure, np.zeros(k - n)])]
    )
    step = -np.linalg.lstsq(rows, right, rcond=1e-12)[0]
    out: Array = np.sum((before.residual[test] + design[test] @ step) ** 2, axis=1)
    return out
