"""In words, what the readings leave undetermined: blind directions of a fit and what takes part in them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.fit.estimated import Estimate
from truepose.identification.report.diagnosis_words import several
from truepose.models.machine.machine import FRAME_OF, FRAMES
from truepose.models.machine.mechanism import AXES
from truepose.wording import shortened

TAKES_PART = 1e-2
UNTOUCHED = 0.9
ZERO = 1e-6
MOST = 14


def grouped(names: Iterable[str]) -> list[str]:
    """Names that differ in their numbers only, on one line: ``leg*.a.z (6)``."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(re.sub(r"\d+", "*", name), []).append(name)
    return [f"{pattern} ({len(all_)})" if len(all_) > 1 else all_[0] for pattern, all_ in groups.items()]


def rank_words(fit: Estimate) -> list[str]:
    """Rank, and which parts move together without changing any reading."""
    free, blind = len(fit.prior.free), fit.null_space
    if not len(blind):
        return [f"The readings alone determine all {free} free parameters; how well, the next line says."]
    said = (
        f"The readings alone determine {fit.rank} of {several(free, 'direction')} that the free parameters"
        f" could move in; along the other {len(blind)} no reading changes, and only tolerances hold them."
    )
    return [said, *_blind_words(fit, blind)]


def _blind_words(fit: Estimate, blind: Array) -> list[str]:
    names = [fit.prior.names[k] for k in fit.prior.free]
    owner = np.array([FRAME_OF.get(name, "") for name in names])
    own = still(blind, owner != "")
    out = []
    for frame in FRAMES:
        other = (owner != "") & (owner != frame)
        moves = _beyond(still(blind, other), own)
        if not len(moves):
            continue
        axes = _axes(moves, names, frame)
        partners = _participants(moves, names, owner != frame)
        undone = f"; what undoes it is {shortened(grouped(partners), MOST)}" if partners else ""
        out.append(
            f"The {frame} frame can move against the mechanism in {several(len(moves), 'way')}"
            f" (of {axes}) without changing a reading{undone}. Neither is a measurement of"
            " its own."
        )
    both = (
        len(blind)
        - len(own)
        - sum(len(_beyond(still(blind, (owner != "") & (owner != f)), own)) for f in FRAMES)
    )
    if both > 0:
        out.append(
            f"In {several(both, 'more way')} the base frame and the tool frame move against each other."
        )
    if len(own):
        inside = shortened(grouped(_participants(own, names, owner == "")), MOST)
        out.append(
            f"In {several(len(own), 'way')} parameters of the mechanism or the sensor move together, or"
            f" alone, unseen: {inside}."
        )
    return out


def still(blind: Array, fixed: Mask) -> Array:
    """(k, n) orthonormal rows spanning the directions of ``blind`` (b, n) along which ``fixed`` (n,) parameters stand still."""
    if not fixed.any() or not len(blind):
        return blind
    u, s, _ = np.linalg.svd(blind[:, fixed])
    rank = int(np.sum(s > ZERO))
    out: Array = u[:, rank:].T @ blind
    return out


def _beyond(rows: Array, inner: Array) -> Array:
    """Part of the span of ``rows`` that is orthogonal to ``inner``, a part of it."""
    if not len(inner) or not len(rows):
        return rows
    rest = rows - rows @ inner.T @ inner
    _, s, vt = np.linalg.svd(rest, full_matrices=False)
    out: Array = vt[s > ZERO]
    return out


def _participants(rows: Array, names: Sequence[str], among: Mask) -> list[str]:
    part = np.linalg.norm(rows, axis=0)
    limit = TAKES_PART * float(np.max(part[among], initial=0.0))
    return [
        name for name, share, ok in zip(names, part, among, strict=True) if ok and share > max(limit, ZERO)
    ]


def _axes(rows: Array, names: Sequence[str], frame: str) -> str:
    part = dict(zip(names, np.linalg.norm(rows, axis=0), strict=True))
    return " ".join(axis for axis in AXES if part.get(f"{frame}.{axis}", 0.0) > ZERO)


def weak_words(fit: Estimate) -> list[str]:
    """Parameters about which the readings say little more than the drawing did."""
    sigma, std = fit.prior.sigma, fit.std
    free = [int(k) for k in fit.prior.free if np.isfinite(sigma[k]) and k < len(fit.nominal.parameters)]
    weak = [fit.prior.names[k] for k in free if std[k] > UNTOUCHED * sigma[k]]
    if not weak:
        return ["Every parameter is known better than its drawing said."]
    return [
        f"For {len(weak)} of {several(len(free), 'parameter')} with a tolerance the readings say next to"
        " nothing beyond the drawing (their 1-sigma is over nine tenths of the tolerance):"
        f" {shortened(grouped(weak), MOST)}."
    ]
