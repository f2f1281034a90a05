"""Which catalogued explanations these data cannot tell from the truth, judged from the noise-free change of readings."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from challenge.imitations import Imitations, Signature
from challenge.simulator.base import Answer

Array = NDArray[np.float64]
INDISTINCT = 6.0
"""Missed chi2 (3 nats of log likelihood) below which an explanation is as good as the truth."""
FAINT = 1e-12
BEYOND = 2.0
"""1-sigmas by which a coefficient may lie outside its physical bounds."""


@dataclass(frozen=True)
class Rival:
    """A candidate of the catalogue with the chi2 that it cannot reproduce; ``allowed``: within physical bounds."""

    signature: Signature
    missed: float
    allowed: bool


def anything(_: Answer) -> bool:
    """Weighs every candidate."""
    return True


def rivals(
    known: Imitations,
    change: Array,
    beside: Sequence[Array] = (),
    only: Callable[[Answer], bool] = anything,
) -> tuple[Rival, ...]:
    """Candidates (``only`` says which) as explanations of a change (N,), the closest first.

    Geometry and ``beside`` (N,) adapt as well.
    """
    chosen, places, at = [], [], 0
    for signature in known.signatures:
        size = signature.columns.shape[1]
        if only(known.name(signature)):
            chosen.append(signature)
            places.append(np.arange(at, at + size))
        at += size
    if not chosen:
        return ()
    bench = known.bench
    target = bench.left(change[:, None], beside)[:, 0]
    left = bench.beyond(known.left[:, np.concatenate(places)], beside)
    ends = np.cumsum([len(p) for p in places])[:-1]
    parts = zip(chosen, np.split(left, ends, axis=1), strict=True)
    return tuple(sorted((_against(target, own, s) for s, own in parts), key=lambda r: r.missed))


def _against(target: Array, columns: Array, signature: Signature) -> Rival:
    """Best fit of the target by the columns under the coefficients' prior."""
    weight = 1.0 / signature.spread
    size = np.sqrt(np.sum(columns**2, axis=0) + weight**2)  # columns of unit length, whatever their unit
    information = (columns.T @ columns) / np.outer(size, size) + np.diag((weight / size) ** 2)
    values, vectors = np.linalg.eigh(information)
    root = vectors[:, values > FAINT] / np.sqrt(values[values > FAINT])
    explained = root.T @ (columns.T @ target / size)
    found, std = root @ explained / size, np.sqrt(np.sum(root**2, axis=1)) / size
    allowed = all(
        low - BEYOND * s <= value <= high + BEYOND * s
        for value, s, (low, high) in zip(found, std, signature.bounds, strict=True)
    )
    missed = float(target @ target - explained @ explained)
    return Rival(signature, max(missed, 0.0), allowed)


def equivalents(
    known: Imitations, ranked: Sequence[Rival], truth: Answer | None, others: Collection[Answer] = ()
) -> list[Answer]:
    """Effects at places that reproduce the change as well as the truth does, and twins of any of them and of the truth.

    Not among them: ``others``, which are true themselves, and the truth at more places than it has.
    """
    out: dict[Answer, None] = {}
    for rival in ranked:
        placed = known.catalogue.candidates[rival.signature.index]
        name = (placed.effect.slug, placed.place)
        same = rival.missed < INDISTINCT and rival.allowed
        if same and not _wider(name, truth):
            out[name] = None
        if same or name == truth:
            for twin in placed.twins:
                out[twin, placed.place] = None
    return [name for name in out if name != truth and name not in others]


def misfit(known: Imitations, ranked: Sequence[Rival], truth: Answer | None) -> float | None:
    """chi2 of the change that the catalogue's own form of the truth cannot reproduce; None where it has none there."""
    return next((r.missed for r in ranked if known.name(r.signature) == truth), None)


def _wider(name: Answer, truth: Answer | None) -> bool:
    return truth is not None and name[0] == truth[0] and set(name[1]) > set(truth[1])


__all__ = ["INDISTINCT", "Rival", "equivalents", "misfit", "rivals"]
