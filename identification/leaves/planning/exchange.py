"""Choose poses among candidates: add the pose that gains most, eliminate the one that is missed least.

DETMAX (Mitchell 1974), which IOOPS (Daney, Papegay and Blaise, IJRR 24, 2005; telescope paper, section 6.3) does
for robots. What an added or eliminated pose changes is an update of low rank of the information, so that
log det follows from a small determinant and no matrix of full size is decomposed for a candidate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.leaves.planning.criterion import log_det, spectrum
from truepose.identification.leaves.planning.information import PoseInformation

DEPTH = 3
"""Poses added (or eliminated) in a row before as many are eliminated (added)."""
LEAST_GAIN = 1e-6
"""An excursion that gains less, relative to the criterion, is not worth its time."""


@dataclass(frozen=True)
class Pool:
    """Candidates: signatures (c, m, k); differs (m,) and weight (k,) as in ``PoseInformation``."""

    signature: Array
    differs: Mask
    weight: Array

    @classmethod
    def of(cls, signature: Array, information: PoseInformation) -> Pool:
        """From signatures (c, m, k), with as few rows a candidate as hold the same information.

        Where a reading is a difference all rows stay.
        """
        if information.differs.any():
            return cls(signature, information.differs, information.weight)
        _, s, v = np.linalg.svd(signature, full_matrices=False)
        rank = max(1, int(np.max(np.sum(s > 1e-12 * np.max(s), axis=1))))
        return cls(s[:, :rank, None] * v[:, :rank], np.zeros(rank, dtype=bool), information.weight)

    def row(self, candidate: Index | int, before: int | None) -> Array:
        """Jacobian (..., m, k) of poses, ``candidate`` (...,), that follow ``before`` (None: they come first)."""
        here = self.signature[candidate]
        if not self.differs.any():
            return np.asarray(here)
        earlier = here if before is None else self.signature[before]
        return np.asarray(here - np.where(self.differs[:, None], earlier, 0.0))

    def rows(self, design: Sequence[int]) -> Array:
        """(n, m, k) Jacobian of a design."""
        before = [None, *design[:-1]]
        return np.array([self.row(c, b) for c, b in zip(design, before, strict=True)])

    def value(self, design: Sequence[int]) -> float:
        """Criterion of a design."""
        return log_det(self.rows(design), self.weight)


def exchange(pool: Pool, start: Sequence[int]) -> list[int]:
    """A design with as many poses as ``start`` (indices of candidates, repeats allowed), never worse than it.

    Excursions of up to ``DEPTH`` poses, adding first or eliminating first; each that gains is kept, until none
    does.
    """
    best = list(start)
    value = pool.value(best)
    depth, adding = 1, True
    while depth <= DEPTH and depth < len(best):
        trial = list(best)
        for step in (adding, not adding):
            for _ in range(depth):
                trial = _added(pool, trial) if step else _eliminated(pool, trial)
        found = pool.value(trial)
        if found > value + LEAST_GAIN * max(1.0, abs(value)):
            best, value, depth, adding = trial, found, 1, True
        elif adding:
            adding = False
        else:
            depth, adding = depth + 1, True
    return best


def _added(pool: Pool, design: list[int]) -> list[int]:
    """The design with the candidate that gains most at its end."""
    rows = pool.rows(design)
    update = pool.row(np.arange(len(pool.signature)), design[-1])
    scores = _scores(pool, rows, update, np.ones(update.shape[1]))
    if len(design) < len(scores):
        scores[design] = -np.inf
    return [*design, int(np.argmax(scores))]


def _eliminated(pool: Pool, design: list[int]) -> list[int]:
    """The design without the pose that is missed least."""
    rows = pool.rows(design)
    m = pool.signature.shape[1]
    if not pool.differs.any():
        scores = _scores(pool, rows, rows, -np.ones(m))
    else:  # the next pose then counts from the one before
        ends = [None, *design, None]
        updates = np.zeros((len(design), 3 * m, pool.signature.shape[2]))
        for k, here in enumerate(design):
            before, after = ends[k], ends[k + 2]
            updates[k, :m] = pool.row(here, before)
            if after is not None:
                updates[k, m : 2 * m], updates[k, 2 * m :] = pool.row(after, here), pool.row(after, before)
        scores = _scores(pool, rows, updates, np.repeat([-1.0, -1.0, 1.0], m))
    worst = int(np.argmax(scores))
    return design[:worst] + design[worst + 1 :]


def _scores(pool: Pool, rows: Array, updates: Array, signs: Array) -> Array:
    """Return (c,) what updates U' diag(signs) U, U (c, u, k), of the rows' information add to the criterion.

    log det(M + U'SU) - log det M = log det(1 + S U M^-1 U').
    """
    values, vectors = spectrum(rows, pool.weight)
    white = updates @ (vectors / np.sqrt(values))
    small = np.eye(len(signs)) + signs[:, None] * (white @ white.transpose(0, 2, 1))
    sign, value = np.linalg.slogdet(small)
    return np.where(sign > 0, value, -np.inf)
