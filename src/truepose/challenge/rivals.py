"""Which catalogued explanations these data cannot tell from the truth, judged from the noise-free change of readings."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.challenge.adaptation import Adaptation, Signature
from truepose.challenge.simulator.base import Answer

Array = NDArray[np.float64]
INDISTINCT = 6.0
"""Missed chi2 (3 nats of log likelihood) below which an explanation is as good as the truth."""
FAINT = 1e-12
SHORT, TERMS = 6, 12
"""Coefficients of a term, and of several, up to which terms are weighed together: more would fit anything."""
BEYOND = 2.0
"""1-sigmas by which a coefficient may lie outside its physical bounds."""


@dataclass(frozen=True)
class Rival:
    """A candidate of the catalogue with the chi2 that it cannot reproduce; ``allowed``: within physical bounds."""

    signature: Signature
    missed: float
    allowed: bool


def rivals(bench: Adaptation, change: Array, beside: Sequence[Array] = ()) -> tuple[Rival, ...]:
    """Every candidate as an explanation of a change (N,), the closest first; geometry and ``beside`` (N,) adapt as well.

    Terms of one effect at one place that add up (a stiffness and how it bends) also make a candidate together.
    """
    signatures = (*bench.signatures, *_together(bench))
    if not signatures:
        return ()
    columns = np.hstack([change[:, None], *(s.columns for s in signatures)])
    left = bench.left(columns, beside)
    target, at, out = left[:, 0], 1, []
    for signature in signatures:
        size = signature.columns.shape[1]
        out.append(_against(target, left[:, at : at + size], signature))
        at += size
    return tuple(sorted(out, key=lambda r: r.missed))


def _together(bench: Adaptation) -> list[Signature]:
    """Short terms of one effect at one place, where they add up, as one signature."""
    terms: dict[Answer, list[Signature]] = {}
    for signature in bench.signatures:
        placed = bench.catalogue.candidates[signature.index]
        if placed.effect.settings_add and signature.columns.shape[1] <= SHORT:
            terms.setdefault((placed.effect.slug, placed.place), []).append(signature)
    few = [own for own in terms.values() if len(own) > 1 and sum(s.columns.shape[1] for s in own) <= TERMS]
    return [
        Signature(
            own[0].index,
            np.hstack([s.columns for s in own]),
            np.concatenate([np.broadcast_to(s.spread, s.columns.shape[1]) for s in own]),
            tuple(bound for s in own for bound in s.bounds),
        )
        for own in few
    ]


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
    bench: Adaptation, ranked: Sequence[Rival], truth: Answer | None, others: Collection[Answer] = ()
) -> list[Answer]:
    """Effects at places that reproduce the change as well as the truth does, and twins of any of them and of the truth.

    Not among them: ``others``, which are true themselves, and the truth at more places than it has.
    """
    out: dict[Answer, None] = {}
    for rival in ranked:
        placed = bench.catalogue.candidates[rival.signature.index]
        name = (placed.effect.slug, placed.place)
        same = rival.missed < INDISTINCT and rival.allowed
        if same and not _wider(name, truth):
            out[name] = None
        if same or name == truth:
            for twin in placed.effect.twins(placed.settings_map):
                out[twin, placed.place] = None
    return [name for name in out if name != truth and name not in others]


def misfit(bench: Adaptation, ranked: Sequence[Rival], truth: Answer | None) -> float | None:
    """chi2 of the change that the catalogue's own form of the truth cannot reproduce; None where it has none there."""
    for rival in ranked:
        placed = bench.catalogue.candidates[rival.signature.index]
        if (placed.effect.slug, placed.place) == truth:
            return rival.missed
    return None


def _wider(name: Answer, truth: Answer | None) -> bool:
    return truth is not None and name[0] == truth[0] and set(name[1]) > set(truth[1])


__all__ = ["Rival", "equivalents", "misfit", "rivals"]
