"""Residuals of some rows and their derivatives, by columns or by the ports that coefficients follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.prediction.by_ports import ByPorts, Part
from truepose.threads import Cached

TOGETHER = 16_384
"""Rows of which wide matrices are held at a time, where one block after another would be slow. Cost alone."""


@dataclass(frozen=True)
class Block:
    """Some rows: residuals (n, m) whitened by sigma, and the derivative (n, k, np) of each row's prediction by p.

    ``dense`` (n, k, d): its columns at the places ``at`` (d,), all where that is None; the others follow ``ports``.
    Where a reading compares rows, ``compare`` turns changes (n, k, w) of the rows' predictions into changes
    (n, m, w) of the residuals; elsewhere the two are the same. ``lost`` (n, m): channels that read nothing there, whose
    residuals are zero and stay so.
    """

    rows: slice
    residual: Array
    dense: Array
    compare: Callable[[Array], Array] | None = None
    lost: Mask | None = None
    at: Index | None = None
    ports: ByPorts | None = None

    @Cached
    def here(self) -> Array:
        """(n, k, np) all columns."""
        return written_out(self.dense, self.at, self.ports)

    @Cached
    def jacobian(self) -> Array:
        """(n, m, np) derivative of the residual by p."""
        return self.changes(self.here)

    def changes(self, change: Array) -> Array:
        """(n, m, w) what changes (n, k, w) of the rows' predictions do to the residuals."""
        changed = change if self.compare is None else self.compare(change)
        return changed if self.lost is None else np.where(self.lost[..., None], 0.0, changed)

    def columns(self, wanted: Sequence[int]) -> Array:
        """(n, m, w) some columns of the jacobian, which are not those that follow ports."""
        if self.at is None:
            return self.jacobian[:, :, list(wanted)]
        return self.changes(self.dense[:, :, np.searchsorted(self.at, list(wanted))])

    def part(self, rows: Index, place: Index, scale: Array, weight: Array) -> Part | None:
        """[J r] of some of its rows, p at the columns ``place`` (np,) (-1: left out) in steps of ``scale`` (np,), r last; rows
        weighed by ``weight`` (k,). None where nothing follows ports."""
        if self.ports is None or self.at is None:
            return None
        root = weight[:, None, None]
        kept, by = place[self.at] >= 0, self.ports.of_columns(place[self.ports.column] >= 0)
        by = by if len(rows) == len(self.residual) else by.of_rows(rows)
        own = self.dense[rows][:, :, kept] * scale[self.at[kept]]
        dense = np.concatenate([own, self.residual[rows][..., None]], axis=2) * root
        at = np.append(place[self.at[kept]], int(place.max()) + 1)
        return Part(dense, at, by.scaled(root, scale[by.column], place[by.column]))


def written_out(dense: Array, at: Index | None, ports: ByPorts | None) -> Array:
    """(n, k, w) all columns side by side."""
    if ports is None or at is None:
        return dense
    out = np.empty((*dense.shape[:2], len(at) + len(ports.column)))
    out[:, :, at] = dense
    ports.put_into(out)
    return out


def joined(rows: slice, parts: Sequence[Block]) -> Block:
    """The blocks of several sensors side by side."""
    residual = np.concatenate([part.residual for part in parts], axis=1)
    alike = all(part.compare is None and part.ports is not None for part in parts)
    dense = np.concatenate([part.dense if alike else part.here for part in parts], axis=1)
    lost = None
    if any(part.lost is not None for part in parts):
        lost = np.hstack(
            [np.zeros(p.residual.shape, dtype=bool) if p.lost is None else p.lost for p in parts]
        )
    if alike:
        slopes = np.concatenate([part.ports.slopes for part in parts if part.ports is not None], axis=1)
        first = parts[0]
        ports = None if first.ports is None else first.ports.with_slopes(slopes)
        return Block(rows, residual, dense, lost=lost, at=first.at, ports=ports)
    if all(part.compare is None for part in parts):
        return Block(rows, residual, dense, lost=lost)
    ends = np.cumsum([part.here.shape[1] for part in parts])[:-1]

    def compare(change: Array) -> Array:
        pieces = zip(parts, np.split(change, ends, axis=1), strict=True)
        return np.concatenate([part.changes(piece) for part, piece in pieces], axis=1)

    return Block(rows, residual, dense, compare, lost)
