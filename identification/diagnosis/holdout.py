"""Rows held out, fixed before any fit: validation rows, or blocks in time; and regions outside training.

Extrapolation is asked for: the outermost poses, the heaviest loads and the warmest rows are blocks of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError, InputError
from truepose.identification.diagnosis.result import BlockProof
from truepose.identification.fit.estimate import Estimate, estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.history import order_in_time
from truepose.identification.recording.recording import Recording
from truepose.models.driver import Driver

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FOLDS = 5
BOOTSTRAP = 1000
LEVELS = 4
"""Levels that a driver must have for its largest values to be predicted from the others."""
OUTERMOST = "outermost poses"
ROLE = "role"
VALIDATION = "validation rows"


@dataclass(frozen=True)
class Block:
    """Rows that are held out together, and what they are."""

    name: str
    rows: Mask


@dataclass(frozen=True)
class HeldOut:
    """Squared whitened residuals of held-out rows, before and after, with the name of the split.

    ``blocks`` tells them apart; extrapolations of a recording with validation rows stand there only.
    """

    split: str
    before: Array
    after: Array
    blocks: tuple[BlockProof, ...]


def held_out_blocks(recording: Recording, used: Mask) -> tuple[str, list[Block]]:
    """Name of the split, and its blocks: extrapolations first, then the validation rows or four blocks in time.

    ``used`` (n,) are the rows fitted.
    """
    blocks = _extrapolations(recording, used)
    if recording.validation.sum() >= 3:
        return ROLE, [*blocks, Block(VALIDATION, recording.validation.copy())]
    taken = np.any([b.rows for b in blocks], axis=0)
    order = order_in_time(recording.time, recording.source_file, recording.source_row)
    inner = [k for k in order if used[k] and not taken[k]]
    for k, part in enumerate(np.array_split(np.array(inner, dtype=int), FOLDS - 1), start=1):
        mask = np.zeros(len(used), dtype=bool)
        mask[part] = True
        blocks.append(Block(f"quarter {k} in time", mask))
    return "blocks", [b for b in blocks if b.rows.any() and not np.array_equal(b.rows, used)]


def _extrapolations(recording: Recording, used: Mask) -> list[Block]:
    """Outermost poses, heaviest loads, warmest rows, disjoint; repeats have the same score and stay together."""
    free = used.copy()
    blocks = []
    centred = recording.q - recording.q[used].mean(axis=0)
    reach = np.linalg.norm(centred / np.maximum(np.std(recording.q[used], axis=0), 1e-12), axis=1)
    scores = [(OUTERMOST, reach)]
    for name, words in (("payload", "heaviest loads"), *_thermometers(recording)):
        values = recording.driver(name)
        if values is not None and len(np.unique(values[used])) >= LEVELS:
            scores.append((words, values))
    for words, score in scores:
        limit = np.quantile(score[used], 1 - 1 / FOLDS)
        rows = free & (score >= limit)
        if 3 <= rows.sum() <= 0.4 * used.sum():
            blocks.append(Block(words, rows))
            free &= ~rows
    return blocks


def _thermometers(recording: Recording) -> list[tuple[str, str]]:
    """The recorded temperature that varies most."""
    names = [name for name in recording.drivers if Driver.of(name).thermal]
    spans = [float(np.ptp(recording.drivers[name])) for name in names]
    if not spans or max(spans) == 0.0:
        return []
    return [(names[int(np.argmax(spans))], "warmest rows")]


def held_out(before: Estimate, after: Estimate, recording: Recording, outliers: Mask) -> HeldOut:
    """Fit without each block, before and after, and see what is left on it. ``outliers`` (n,) never count."""
    split, blocks = held_out_blocks(recording, before.used)
    squares: dict[str, tuple[Array, Array]] = {}
    predictors = [Predictor(fit.machine, recording, fit.effects) for fit in (before, after)]
    for block in blocks:
        fits: tuple[Estimate, ...] = (before, after)
        if block.name != VALIDATION:
            fits = _without(fits, predictors, outliers | block.rows)
        if not fits:
            continue
        rows = block.rows & ~outliers
        parts = [np.sum(fit.residual[rows] ** 2, axis=1) for fit in fits]
        seen = np.isfinite(parts[0]) & np.isfinite(parts[1])
        if seen.any():
            squares[block.name] = parts[0][seen], parts[1][seen]
    proofs = tuple(BlockProof(name, len(b), _ratio(b, a)) for name, (b, a) in squares.items())
    counted = [squares[VALIDATION]] if VALIDATION in squares else list(squares.values())
    if not counted:
        used = before.used
        fitted = (np.sum(before.residual[used] ** 2, axis=1), np.sum(after.residual[used] ** 2, axis=1))
        split, counted = "none", [fitted]
    return HeldOut(
        split, np.concatenate([b for b, _ in counted]), np.concatenate([a for _, a in counted]), proofs
    )


def _without(fits: tuple[Estimate, ...], predictors: list[Predictor], exclude: Mask) -> tuple[Estimate, ...]:
    """The fits without some rows; none where too little is left."""
    try:
        return tuple(
            estimate(
                fit.machine,
                predictor.recording,
                fit.effects,
                start=fit.p,
                exclude=exclude,
                prior=fit.prior,
                predictor=predictor,
            )
            for fit, predictor in zip(fits, predictors, strict=True)
        )
    except (ConvergenceError, InputError):
        return ()


def _ratio(before: Array, after: Array) -> float:
    return float(np.sqrt(after.mean() / max(before.mean(), 1e-300)))


def ratio_interval(before: Array, after: Array, *, seed: int = 3) -> tuple[float, tuple[float, float]]:
    """Root of the ratio of mean squares of rows, ``before`` and ``after`` (n,), with its 95 % bootstrap interval.

    The order of rows does not matter.
    """
    ratio = _ratio(before, after)
    if len(before) >= 20_000:
        return ratio, (ratio, ratio)
    order = np.lexsort((after, before))
    before, after = before[order], after[order]
    picks = np.random.default_rng(seed).integers(0, len(before), (BOOTSTRAP, len(before)))
    draws = np.sqrt(after[picks].mean(axis=1) / before[picks].mean(axis=1))
    return ratio, (float(np.quantile(draws, 0.025)), float(np.quantile(draws, 0.975)))
