"""Whether the named physics also holds where it was not fitted, and what it owes to chance.

Held-out rows (role ``validation``, else blocks fixed before any fit), a placebo with permuted drivers, an
equally flexible black box, and the recovery of the effect injected into simulated data.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.classes import INDISTINCT
from truepose.identification.diagnosis.effect_selection import Selection, rank
from truepose.identification.diagnosis.holdout import ROLE, held_out, held_out_blocks, ratio_interval
from truepose.identification.diagnosis.result import Proof
from truepose.identification.diagnosis.signatures import Linearisation, Signatures
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.history import order_in_time
from truepose.identification.recording.recording import Recording
from truepose.identification.selection.scales import Grid
from truepose.identification.selection.tolerance_classes import PartClass

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def prove(before: Estimate, found: Selection, outliers: Mask) -> Proof:
    """All four proofs of the accepted terms; ``outliers`` (n,) are rows left out."""
    signatures, cat, grid, after = found.signatures, found.catalogue, found.grid, found.fit
    recording = signatures.recording
    held = held_out(before, after, recording, outliers)
    ratio, interval = ratio_interval(held.before, held.after)
    main = next(i for i in found.accepted if i not in cat.stated)
    return Proof(
        held_out=held.split,
        blocks=held.blocks,
        ratio=ratio,
        ratio_interval=interval,
        placebo_gain=_placebo(before, signatures, cat, grid, main),
        black_box_ratio=_black_box(before, after, recording, outliers),
        injected_recovered=_injected(before, after, signatures, cat, grid.classes, main),
    )


def _placebo(before: Estimate, signatures: Signatures, cat: Catalogue, grid: Grid, term: int) -> float:
    """Log Bayes factor of the main term when every row is given another row's drivers (nothing should remain)."""
    recording = signatures.recording
    order = np.arange(len(before.used))
    # in the order of acquisition, so that shuffled rows get the same placebo
    in_time = order_in_time(recording.time, recording.source_file, recording.source_row)
    rows = in_time[before.used[in_time]]
    order[rows] = np.random.default_rng(11).permutation(rows)
    single = Signatures(signatures.machine, recording, [cat.candidates[term]])
    lin = single.linearise(before, order=order)
    one = Catalogue((cat.candidates[term],), (0.0,), ())
    return float(rank(lin, one, grid, {}, [0]).gain[0])


def _injected(
    before: Estimate,
    after: Estimate,
    signatures: Signatures,
    cat: Catalogue,
    classes: tuple[PartClass, ...],
    term: int,
) -> bool:
    """Simulate the machine with the main term at its fitted size; is it found again, first of all?"""
    label = cat.candidates[term].label
    fitted = next(e for e in after.fitted_effects() if e.label == label)
    amplitude = np.array(fitted.amplitudes) / [c.scale for c in fitted.coefficients]
    lin = signatures.linearise(before)
    at = lin.free + np.arange(lin.columns[term].start, lin.columns[term].stop)
    noise = max(1.0, float(np.sqrt(after.chi2_per_dof)))
    rng = np.random.default_rng(5)
    gram = lin.gram.copy()
    last = len(gram) - 1
    # the projection of white noise on the columns has their Gram matrix as covariance
    values, vectors = np.linalg.eigh(gram[:last, :last])
    projected = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(last)) * noise
    gram[:last, last] = gram[last, :last] = projected - gram[:last, at] @ amplitude  # prediction less reading
    gram[last, last] = (
        amplitude @ gram[np.ix_(at, at)] @ amplitude
        - 2 * amplitude @ projected[at]
        + noise**2 * lin.n_observations
    )
    simulated = Linearisation(
        gram, lin.free, lin.columns, lin.n_observations, np.zeros(last), lin.weight, lin.parts, lin.candidates
    )
    wanted = list(range(len(cat.candidates)))
    known = Grid((noise,), ((1.0,) * len(classes),), classes)  # what was simulated is known
    ranking = rank(simulated, cat, known, {}, wanted)
    alike = [
        i
        for i, c in enumerate(cat.candidates)
        if (c.effect.slug, c.place) == (fitted.effect.slug, fitted.place)
    ]
    return bool(np.max(ranking.odds) - np.max(ranking.odds[alike]) < INDISTINCT)


def _black_box(before: Estimate, after: Estimate, recording: Recording, outliers: Mask) -> float | None:
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
            out.append(_linear_test(design, before, train, test))
    ratio = np.concatenate(squares_box).mean() / np.concatenate(squares_before).mean()
    return float(np.sqrt(ratio))


def _linear_test(design: Array, before: Estimate, train: Mask, test: Mask) -> Array:
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
