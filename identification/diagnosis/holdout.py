"""Rows held out, fixed before any fit: validation rows, or blocks in time; and regions outside training.

Extrapolation is asked for: the outermost poses, the heaviest loads and the warmest rows are blocks of their own.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from truepose.arrays import Array, Mask
from truepose.errors import ConvergenceError, InputError
from truepose.identification.diagnosis.result import BlockProof, PoseError
from truepose.identification.fit.estimate import Minimum, fit_without
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tool_pose import tool_points
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.file.driver import PAYLOAD, Driver
from truepose.models.file.sections import NO_WORSE
from truepose.threads import in_order, one_thread

FOLDS = 5
LEFT = 1e-2
"""What a fit without a block may leave to gain of half its sum of squares: predictions move by a tenth of a sigma at most."""
BOOTSTRAP, SEED = 1000, 3
MANY = 20_000
"""Rows from which on a ratio is as good as normal in its log, and a bootstrap takes long."""
LEVELS = 4
"""Levels that a driver must have for its largest values to be predicted from the others."""
OUTERMOST = "outermost poses"
ROLE = "role"
VALIDATION, QUARTER = "validation rows", "quarter"


@dataclass(frozen=True)
class Block:
    """Rows that are held out together, and what they are."""

    name: str
    rows: Mask


@dataclass(frozen=True)
class Held:
    """What a model leaves on the rows (b,) of one block: squared whitened residuals (b,), NaN where a row cannot be assembled,
    and mean squared distances of the tool's points after a rigid refit (b,), mm^2, empty where none are read."""

    squares: Array
    points: Array


@dataclass(frozen=True)
class Trial:
    """A model on every block of rows that it was not fitted to; a block is missing where too little was left to fit."""

    split: str
    blocks: Mapping[str, Held]
    fitted: Held

    def against(self, other: Trial) -> Comparison:
        """This model's errors beside those of ``other``, on the blocks that both have."""
        names = [name for name in self.blocks if name in other.blocks]
        squares = {name: _both(other.blocks[name].squares, self.blocks[name].squares) for name in names}
        proofs = tuple(self._proof(other, name, *both) for name, both in squares.items() if len(both[0]))
        counted = [VALIDATION] if VALIDATION in names else [name for name in names if len(squares[name][0])]
        if not counted:
            return Comparison("none", *_both(other.fitted.squares, self.fitted.squares), proofs, None)
        pairs = [(other.blocks[name].points, self.blocks[name].points) for name in counted]
        points = [np.concatenate(part) for part in zip(*pairs, strict=True)]
        pose = PoseError(*map(_rms, points)) if len(points[0]) else None
        before, after = (np.concatenate(part) for part in zip(*(squares[n] for n in counted), strict=True))
        return Comparison(self.split, before, after, proofs, pose)

    def _proof(self, other: Trial, name: str, before: Array, after: Array) -> BlockProof:
        points = other.blocks[name].points, self.blocks[name].points
        pose = _rms(points[1]) / max(_rms(points[0]), 1e-300) if len(points[0]) and len(points[1]) else None
        inside = name == VALIDATION or name.startswith(QUARTER)
        return BlockProof(name, len(before), _ratio(before, after), pose, extrapolates=not inside)


@dataclass(frozen=True)
class Comparison:
    """Squared whitened residuals of held-out rows, before and after, with the name of the split.

    ``blocks`` tells them apart; extrapolations of a recording with validation rows stand there only. pose: rms error of the
    tool's position before and after, mm, after a rigid refit; None where no sensor reads points.
    """

    split: str
    before: Array
    after: Array
    blocks: tuple[BlockProof, ...]
    pose: PoseError | None

    @property
    def ratio(self) -> float:
        """Rms of residuals after over before."""
        return _ratio(self.before, self.after)

    @property
    def score(self) -> float:
        """Error after over before: of the tool's position where it is read, else of the readings.

        Every block counts alike, for a block that no model predicts would drown the others.
        """
        counted = [b for b in self.blocks if b.name == VALIDATION] or self.blocks
        ratios = [b.ratio if b.pose is None else b.pose for b in counted]
        return float(np.exp(np.mean(np.log(np.maximum(ratios, 1e-12))))) if ratios else self.ratio

    @property
    def worse(self) -> bool:
        """Whether readings or the tool's position are worse than before, by more than ``NO_WORSE`` allows."""
        pose = self.pose is not None and self.pose.model > NO_WORSE * self.pose.plain
        return pose or self.ratio > NO_WORSE

    def worse_beyond(self, other: Comparison | None = None) -> bool:
        """Whether readings or the tool's position get worse at the ends of what was seen: beyond them they would, too.

        Where ``other`` gets worse there, it is worse than that.
        """
        known = {} if other is None else {block.name: block for block in other.blocks}
        return any(b.extrapolates and b.worse_than(known.get(b.name)) for b in self.blocks)


def held_out_blocks(recording: Recording, used: Mask) -> tuple[str, list[Block]]:
    """Name of the split, and its blocks: extrapolations first, then the validation rows or four blocks in time.

    ``used`` (n,) are the rows fitted.
    """
    blocks = _extrapolations(recording, used)
    if recording.validation.sum() >= 3:
        return ROLE, [*blocks, Block(VALIDATION, recording.validation.copy())]
    taken = np.any([np.zeros(len(used), dtype=bool), *(b.rows for b in blocks)], axis=0)
    for k, part in enumerate(np.array_split(recording.in_time(used & ~taken), FOLDS - 1), start=1):
        blocks.append(Block(f"{QUARTER} {k} in time", np.isin(np.arange(len(used)), part)))
    return "blocks", [b for b in blocks if b.rows.any() and not np.array_equal(b.rows, used)]


def _extrapolations(recording: Recording, used: Mask) -> list[Block]:
    """Outermost poses, heaviest loads, warmest rows, disjoint; repeats have the same score and stay together."""
    free = used.copy()
    blocks = []
    centred = recording.q - recording.q[used].mean(axis=0)
    reach = np.linalg.norm(centred / np.maximum(np.std(recording.q[used], axis=0), 1e-12), axis=1)
    scores = [(OUTERMOST, reach)]
    thermal = [name for name in recording.drivers if Driver.of(name).thermal]
    thermal.sort(key=lambda name: -float(np.ptp(recording.drivers[name])))  # the one that varies most
    for name, words in ((PAYLOAD, "heaviest loads"), *((name, "warmest rows") for name in thermal[:1])):
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


def trial(
    model: Estimate,
    recording: Recording,
    outliers: Mask,
    split: tuple[str, Sequence[Block]],
    silent: Collection[str] = (),
) -> Trial:
    """Fit a model without each block of a ``split``, and see what is left on it. ``outliers`` (n,) never count.

    ``silent``: labels of the sensor's effects that say nothing of the tool's position.
    """
    name, blocks = split
    predictor = Predictor(model.nominal, recording, model.effects, visits=FIT)

    def try_block(block: Block) -> Held | None:
        with one_thread():  # blocks are tried beside each other
            rows = block.rows & ~outliers
            try:
                fit: Estimate | Minimum = model
                if block.name != VALIDATION:
                    fit = fit_without(model, predictor, outliers | block.rows, block.rows, LEFT)
            except (ConvergenceError, InputError):  # too little is left
                return None
            return _held(fit, predictor, rows, silent) if rows.any() else None

    every = zip((block.name for block in blocks), in_order(try_block, blocks), strict=True)
    found = {block: held for block, held in every if held is not None}
    return Trial(name, found, _held(model, predictor, model.used, silent))


def _held(fit: Estimate | Minimum, predictor: Predictor, rows: Mask, silent: Collection[str]) -> Held:
    seen = rows & np.isfinite(fit.residual).all(axis=1)
    squares = np.sum(fit.residual[rows] ** 2, axis=1)
    points = tool_points(predictor, fit.p, fit.x, silent).squares(fit.used, seen)
    return Held(np.where(seen[rows], squares, np.nan), points)


def _both(before: Array, after: Array) -> tuple[Array, Array]:
    """Rows that both could predict."""
    seen = np.isfinite(before) & np.isfinite(after)
    return before[seen], after[seen]


def _rms(squares: Array) -> float:
    return float(np.sqrt(np.mean(squares)))


def _ratio(before: Array, after: Array) -> float:
    return float(np.sqrt(after.mean() / max(before.mean(), 1e-300)))


def ratio_interval(before: Array, after: Array) -> tuple[float, tuple[float, float]]:
    """Root of the ratio of mean squares of rows, ``before`` and ``after`` (n,), with its 95 % bootstrap interval.

    The order of rows does not matter. Of very many rows the bootstrap's limit is given, by the spread of the log of the ratio.
    """
    ratio = _ratio(before, after)
    if len(before) >= MANY:
        each = after / max(float(after.mean()), 1e-300) - before / max(float(before.mean()), 1e-300)
        reach = float(norm.isf(0.025) * 0.5 * np.std(each) / np.sqrt(len(each)))
        return ratio, (ratio * float(np.exp(-reach)), ratio * float(np.exp(reach)))
    order = np.lexsort((after, before))
    before, after = before[order], after[order]
    picks = np.random.default_rng(SEED).integers(0, len(before), (BOOTSTRAP, len(before)))
    draws = np.sqrt(after[picks].mean(axis=1) / before[picks].mean(axis=1))
    return ratio, (float(np.quantile(draws, 0.025)), float(np.quantile(draws, 0.975)))
