"""The ordinary fit and the one under tolerances, both without effects beyond those of the file.

Rows that no smooth physics explains: far beyond the spread of their neighbours, one by one.

Some of an interferometer are off by whole half wavelengths: fringes that were miscounted. Of a calibration, rows that it does
not fit are to be looked at before its model is suspected: typing errors, a lost beam. A fit that trusts every row is pulled
by them, so a fit that bends for outliers is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import binom, chi2

from truepose.arrays import Array, Index, Mask
from truepose.errors import ConvergenceError
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimate import FREE_WIDENING, estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predictor import FIT, Predictor, told
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine
from truepose.models.sensors.distance import Distance

LIMIT = 0.1
"""Beyond this share of the rows, far residuals are no outliers but a model that is wrong."""
FEWEST, NEIGHBOURS, TOGETHER = 4, 4, 0.3
"""Rows below which nothing can be said of where they lie, neighbours that are asked, and their share that must be far too."""
CHANCE = 1e-3
"""Probability below which nothing is chance: a far residual, far rows that lie together, a misfit, halves that differ."""
SUSPECT = 0.5
"""Share of the limit from which on it is asked how far a row would be off if it had not been fitted."""
APART = 2.0
"""How much farther than all others a row must be: physics that was left out has its largest residuals, too."""
NEAR = 3.0
"""A whole number fits when what it leaves is within so many predictive sigma."""
BY_CHANCE = 0.2
"""Where so large a share of all residuals would fit a whole number by chance, none is named."""


def outlying_rows(fit: Estimate, recording: Recording, candidates: Mask) -> Mask:
    """(n,) rows among ``candidates`` whose residual chance would not make once in a thousand recordings.

    The noise scale is the larger of the stated one and the rows' own median, so that a model that is wrong
    everywhere flags nothing. Rows that lie together, in poses, load or time, are physics and no outliers.
    """
    out = np.zeros(len(fit.residual), dtype=bool)
    seen = candidates & np.isfinite(fit.residual).all(axis=1)
    rows = np.flatnonzero(seen if fit.lost is None else seen & ~fit.lost.all(axis=1))
    if len(rows) < 10:
        return out
    residual = fit.residual[rows]
    m = told(residual, fit.lost_among(rows))
    size = np.sqrt(np.sum(residual**2, axis=1) / m)
    scale = max(float(np.median(size / np.sqrt(chi2.ppf(0.5, m) / m))), 1.0)
    # heavy tails are common: the Gaussian limit, and half as much again
    limit = 1.5 * scale * np.sqrt(chi2.isf(CHANCE / len(rows), m) / m)
    suspect = np.flatnonzero((size > SUSPECT * limit) & fit.used[rows])
    if len(suspect) <= LIMIT * len(rows):
        squares = _studentised(fit, recording, rows[suspect])
        size[suspect] = np.sqrt(squares / np.broadcast_to(m, len(rows))[suspect])
    far = size > limit
    if np.sum(far) <= LIMIT * len(rows) and not clustered(recording_coordinates(recording, rows), far):
        out[rows[far]] = True
    return out


def _studentised(fit: Estimate, recording: Recording, rows: Index) -> Array:
    """(k,) r' (1 - H)^-1 r of fitted rows, H the share that a row has in its own prediction.

    A fit of hundreds of coefficients follows a wild row a good part of the way
    (Cook and Weisberg 1982, Residuals and influence).
    """
    residual = fit.residual[rows]
    if not len(rows) or any(sensor.compares for sensor in fit.nominal.sensors):
        return np.asarray(np.sum(residual**2, axis=1))
    predictor, out = Predictor(fit.nominal, recording, fit.effects).of_rows(rows), list[Array]()
    root = fit.step_root
    for block in predictor.blocks(fit.p, fit.x[rows], fit.weights[rows]):
        own = residual[block.rows]
        turned = fit.by_steps(block) @ root * np.sqrt(fit.weights[rows][block.rows])[:, None, None]
        left = np.eye(own.shape[1]) - turned @ turned.transpose(0, 2, 1)
        out.append(np.einsum("nm,nm->n", own, np.linalg.solve(left, own[..., None])[..., 0]))
    return np.concatenate(out)


def bridges(recording: Recording) -> Mask:
    """(n,) rows read against a row of another session, where only a few tie the two sessions together.

    What changed between the sessions stands in these rows alone, and would look like an error of theirs.
    """
    out = np.zeros(len(recording), dtype=bool)
    if recording.from_row is None:
        return out
    whole = recording.whole
    pairs = np.column_stack([whole.session[recording.from_row], recording.session])
    for pair in np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0):
        ties = np.all(pairs == pair, axis=1)
        out |= ties & (np.sum(ties) < FEWEST)
    return out


def recording_coordinates(recording: Recording, rows: Index) -> Array:
    """(k, d) where rows lie: joints, order of acquisition and all that was logged, in standard deviations."""
    order, columns = np.argsort(recording.order).astype(float), list(recording.columns().values())
    if recording.ordered:
        columns.insert(len(recording.joints), order)
    picked = np.column_stack([c[rows] for c in columns])
    picked = picked[:, np.ptp(picked, axis=0) > 0.0]  # what stands still has a spread of rounding
    return np.asarray((picked - picked.mean(axis=0)) / picked.std(axis=0))


def clustered(at: Array, far: Mask) -> bool:
    """Whether rows that are ``far`` (k,) lie together: what chance spoils lies anywhere, physics in poses, loads or time.

    ``at`` (k, d) are coordinates of all rows. Joints together, and every other coordinate alone, are looked at: the
    neighbours of far rows are far more often than chance makes them.
    """
    count = int(far.sum())
    if count < FEWEST or not at.size:
        return False
    share = (count - 1) / (len(far) - 1)
    worst = 1.0
    views = [at, *(at[:, [k]] for k in range(at.shape[1]))]
    for view in views:
        _, near = cKDTree(view).query(view[far], k=min(NEIGHBOURS + 1, len(far)))
        own = np.flatnonzero(far)[:, None]
        hits, tries = int(np.sum(far[near] & (near != own))), int(np.sum(near != own))
        if hits > TOGETHER * tries:
            worst = min(worst, float(binom.sf(hits - 1, tries, share)))
    return worst * len(views) < CHANCE


def fringes_by_row(fit: Estimate, recording: Recording, rows: Sequence[int]) -> dict[int, int]:
    """``miscounted_fringes`` among the ``rows`` of data that were left out, by the number of the row."""
    far = np.isin(recording.source_row, rows) & ~fit.used & ~recording.validation
    return {int(recording.source_row[k]): n for k, n in miscounted_fringes(fit, recording, far).items()}


def miscounted_fringes(fit: Estimate, recording: Recording, far: Mask) -> dict[int, int]:
    """Rows among ``far`` (n,) whose reading is too long by k half wavelengths, with k (not 0): row index to k.

    All other readings of the row must be as predicted. Where several interferometers miscounted, k is that of
    the first. A reading is the change since its own row of origin: rows counted on from a miscounted one without
    a new start share its k, and are found as long as they are few.
    """
    waves = [
        (s.wavelength if isinstance(s, Distance) else None, len(s.channels)) for s in fit.nominal.sensors
    ]
    # half the wavelength of each channel, mm; infinite where it is no interferometer's
    channels = np.concatenate([np.full(count, wave / 2 if wave else np.inf) for wave, count in waves])
    rows = np.flatnonzero(far & np.isfinite(fit.residual).all(axis=1))
    if not len(rows) or not np.isfinite(channels).any():
        return {}
    step = channels / np.array([c.sigma for c in fit.nominal.channels])
    spread = _spread(fit, recording)[rows]
    counts = np.where(np.isfinite(step), np.round(-fit.residual[rows] / step), 0.0)
    rest = fit.residual[rows] + counts * np.where(np.isfinite(step), step, 0.0)
    told = (2 * NEAR * spread < BY_CHANCE * step) | (counts == 0)
    fits = (np.abs(rest) < NEAR * spread).all(axis=1) & told.all(axis=1) & counts.any(axis=1)
    first = np.argmax(counts[fits] != 0, axis=1)
    return dict(zip(rows[fits].tolist(), map(int, counts[fits][np.arange(len(first)), first]), strict=True))


def _spread(fit: Estimate, recording: Recording) -> Array:
    """(n, m) 1-sigma of whitened residuals of rows that were not fitted: noise and what the fit does not know."""
    predictor, out = Predictor(fit.nominal, recording, fit.effects), np.empty(fit.residual.shape)
    noise = max(fit.chi2_per_dof, 1.0)
    for block in predictor.blocks(fit.p, fit.x, fit.used * fit.weights):
        slopes = block.jacobian[:, :, fit.prior.free]
        out[block.rows] = np.sqrt(noise + np.einsum("nmi,ij,nmj->nm", slopes, fit.covariance, slopes))
    return out


@dataclass(frozen=True)
class FarRow:
    """A row of a file (its first line of data is row 1), and its largest residual in sigmas."""

    file: str
    row: int
    sigma: float


def far_rows(found: Calibration) -> tuple[FarRow, ...]:
    """Rows whose residuals chance would not make, farthest first; empty where none stands out from the others."""
    recording, fit = found.recording, _robust(found)
    if fit is None:
        return ()
    own = ~recording.validation & ~bridges(recording) & np.isfinite(fit.residual).all(axis=1)
    far, size = outlying_rows(fit, recording, own), np.max(np.abs(fit.residual), axis=1)
    far &= size > APART * np.max(size[own & ~far], initial=0.0)
    ranked = sorted(np.flatnonzero(far).tolist(), key=lambda k: -size[k])
    files, rows = recording.source_file, recording.source_row
    return tuple(FarRow(recording.files[files[k]], int(rows[k]), float(size[k])) for k in ranked)


def _robust(found: Calibration) -> Estimate | None:
    """A fit that far rows do not pull; None where there is none."""
    fit = found.fit
    if found.method["estimator"] == "huber":
        return fit
    held = fit.prior if found.only else None
    try:
        return estimate(fit.nominal, found.recording, fit.effects, prior=held, start=fit.p, loss="huber")
    except ConvergenceError:
        return None


@dataclass(frozen=True)
class Fits:
    """The ordinary fit, the one under tolerances, both without effects, and the rows (n,) that both leave out."""

    free: Estimate
    before: Estimate
    outliers: Mask

    @property
    def rms(self) -> float:
        """Of the whitened residual of the worse of both."""
        return float(np.sqrt(max(self.before.chi2_per_dof, self.free.chi2_per_dof)))


def null_fits(machine: Machine, recording: Recording) -> Fits:
    """From nothing, with rows left out that a fit which bends for them finds far off."""
    known = machine.effects
    predictor = Predictor(machine, recording, known, visits=FIT)
    start = aligned_start(predictor)
    rough = estimate(machine, recording, known, start=start, loss="huber", predictor=predictor)
    far = outlying_rows(rough, recording, ~recording.validation & ~bridges(recording))
    before = estimate(machine, recording, known, start=rough.p, exclude=far, predictor=predictor)
    return Fits(free_fit(machine, recording, before, far, before.p), before, far)


def free_fit(machine: Machine, recording: Recording, before: Estimate, far: Mask, start: Array) -> Estimate:
    """The ordinary fit beside it; where its valley has no bottom, with tolerances less wide."""
    for factor in (FREE_WIDENING, FREE_WIDENING / 3, FREE_WIDENING / 10):
        try:
            return estimate(machine, recording, before.effects, start=start, widen=factor, exclude=far)
        except ConvergenceError:
            start = before.p
    return before


def refitted(machine: Machine, recording: Recording, fits: Fits, far: Mask) -> Fits:
    """With other rows left out."""
    before = estimate(machine, recording, machine.effects, start=fits.before.p, exclude=far)
    return Fits(free_fit(machine, recording, before, far, fits.free.p), before, far)
