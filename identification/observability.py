"""Which parameters the readings determine, and which combinations they cannot see, in words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from truepose.identification.estimate import Estimate

Array = NDArray[np.float64]
UNSEEN_SHARE = 1e-3
"""A parameter that an unseen direction moves by more than this is not determined by readings alone."""
LEAST_GAIN = 0.5
"""Readings determine a parameter when they at least halve the variance that its tolerance leaves."""
SMALLEST_PART = 0.02
SMALLEST_LEAD = 0.1
LEVER = 300.0
"""mm at which angles are compared with lengths."""
_SHOWN = 10
_NUMBERED = re.compile(r"^(?P<stem>\D+)(?P<number>\d+)\.(?P<rest>.+)$")


def identifiable(fit: Estimate) -> Mapping[str, bool]:
    """For each free entry: no unseen direction moves it, and the readings halve its variance at least."""
    free = fit.prior.free
    directions = _physical(fit)
    moved = np.max(np.abs(directions), axis=0, initial=0.0) if len(directions) else np.zeros(len(free))
    variance, prior = fit.std[free] ** 2, fit.prior.sigma[free] ** 2
    seen = (moved < UNSEEN_SHARE) & (variance <= LEAST_GAIN * prior)
    return {fit.prior.names[k]: bool(flag) for k, flag in zip(free, seen, strict=True)}


def unseen_directions(fit: Estimate) -> list[dict[str, object]]:
    """One entry per direction that the readings cannot see: its parts (mm, rad) and a sentence."""
    names = [fit.prior.names[k] for k in fit.prior.free]
    sigma = fit.prior.sigma[fit.prior.free]
    out: list[dict[str, object]] = []
    lever = _lever(fit)
    for row in _sparse(_physical(fit), names):
        parts = [
            int(k)
            for k in np.argsort(-np.round(np.abs(row), 6), kind="stable")
            if abs(row[k]) >= SMALLEST_PART
        ]
        open_ended = all(np.isinf(sigma[k]) for k in parts)
        out.append(
            {
                "parts": {names[k]: float(row[k] / lever[k]) for k in parts},
                "meaning": _sentence([names[k] for k in parts], open_ended),
            }
        )
    return out


def _sentence(names: Sequence[str], open_ended: bool) -> str:
    who = "nothing decided, they stay at the drawing" if open_ended else "tolerances decided"
    groups = _grouped(sorted(names, key=lambda name: not name.startswith(("base.", "tool."))))
    if len(names) == 1:
        who = "nothing decided, it stays at the drawing" if open_ended else "its tolerance decided"
        return f"{names[0]} alone is not seen; {who}"
    rest = groups[1:] or groups
    shown = ", ".join(rest[:_SHOWN]) + (f" and {len(rest) - _SHOWN} more" if len(rest) > _SHOWN else "")
    if len(groups) == 1:
        return f"moving {shown} together is not seen; {who}"
    return f"moving {groups[0]} together with {shown} is not seen; {who}"


def _grouped(names: Sequence[str]) -> list[str]:
    """Names with those that differ by a number only drawn together: ``leg1..leg6 a.x``."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name in names:
        match = _NUMBERED.match(name)
        key = (match["stem"], match["rest"]) if match else ("", name)
        groups.setdefault(key, []).append(match["number"] if match else "")
    out = []
    for (stem, rest), numbers in groups.items():
        if not stem:
            out.append(rest)
        elif len(numbers) == 1:
            out.append(f"{stem}{numbers[0]}.{rest}")
        else:
            out.append(f"{_span(stem, sorted(int(n) for n in numbers))} {rest}")
    return out


def _span(stem: str, numbers: Sequence[int]) -> str:
    if numbers[-1] - numbers[0] == len(numbers) - 1:
        return f"{stem}{numbers[0]}..{stem}{numbers[-1]}"
    return ", ".join(f"{stem}{n}" for n in numbers)


def _lever(fit: Estimate) -> Array:
    """mm that one unit of each free entry moves a point, roughly: 1 for lengths, a lever for angles."""
    kinds = {parameter.name: parameter.unit for parameter in fit.machine.parameters}
    scale = fit.prior.scale[fit.prior.free]
    names = [fit.prior.names[k] for k in fit.prior.free]
    return np.array(
        [
            1.0 if kinds.get(n) == "mm" else LEVER if n in kinds else LEVER * 1e-3 / s
            for n, s in zip(names, scale, strict=True)
        ]
    )


def _physical(fit: Estimate) -> Array:
    """Unseen directions (k, n_free) in mm at a lever, orthonormal."""
    if not len(fit.null_space):
        return fit.null_space
    moved = fit.null_space * fit.prior.scale[fit.prior.free] * _lever(fit)
    return np.linalg.qr(moved.T)[0].T


def _sparse(basis: Array, names: Sequence[str]) -> Array:
    """The same directions, each led by one parameter (row reduction): frames first; largest part 1."""
    rows, free = basis.copy(), list(range(len(basis)))
    frames = [k for k, name in enumerate(names) if name.startswith(("base.", "tool."))]
    for pivot in frames:
        lead = max(free, key=lambda i: abs(rows[i, pivot]), default=None)
        if lead is not None and abs(rows[lead, pivot]) > SMALLEST_LEAD * np.max(np.abs(rows[lead])):
            _reduce(rows, lead, pivot)
            free.remove(lead)
    while free:
        lead, pivot = max(((i, int(np.argmax(np.abs(rows[i])))) for i in free), key=lambda at: abs(rows[at]))
        _reduce(rows, lead, pivot)
        free.remove(lead)
    return rows / np.max(np.abs(rows), axis=1, keepdims=True) if len(rows) else rows


def _reduce(rows: Array, lead: int, pivot: int) -> None:
    """Make the pivot of one row 1 and take it out of all others."""
    rows[lead] /= rows[lead, pivot]
    for other in range(len(rows)):
        if other != lead:
            rows[other] -= rows[other, pivot] * rows[lead]


__all__ = ["identifiable", "unseen_directions"]
