"""Derivatives by many coefficients that move few ports: those of the ports, and one number a coefficient and row.

A series of a gear has hundreds of coefficients, all of which turn one joint. What the readings do when coefficient c moves
port p is (derivative by the port) times (the port's shift by c), a column (m,) times a number. Written out, it takes m times
the memory and, in a Gram matrix of columns, m times the work:

    sum over rows of J_c' J_d = sum over rows of s_c s_d (J_p' J_q),    c moves p by s_c, d moves q by s_d
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Index, Mask


@dataclass(frozen=True)
class ByPorts:
    """``column`` (c,) of the derivative by p is ``slopes`` (n, m, k) of the ``port`` (c,) times ``values`` (n, c)."""

    slopes: Array
    port: Index
    column: Index
    values: Array

    def with_slopes(self, slopes: Array) -> ByPorts:
        """The same coefficients, for what else follows the ports (n, m, k)."""
        return replace(self, slopes=slopes)

    def of_rows(self, rows: Index) -> ByPorts:
        """Of some rows."""
        return replace(self, slopes=self.slopes[rows], values=self.values[rows])

    def of_columns(self, kept: Mask) -> ByPorts:
        """Some of the coefficients."""
        return replace(self, port=self.port[kept], column=self.column[kept], values=self.values[:, kept])

    def scaled(self, weight: Array, scale: Array, column: Index) -> ByPorts:
        """Slopes times ``weight`` (n, 1, 1), coefficients in steps of ``scale`` (c,), at other places."""
        return ByPorts(self.slopes * weight, self.port, column, self.values * scale)

    def by_port(self) -> list[tuple[int, Index, Array]]:
        """Each port with its columns (c,) and their values (n, c)."""
        every = [(int(k), self.port == k) for k in np.unique(self.port)]
        return [(k, self.column[own], self.values[:, own]) for k, own in every]

    def put_into(self, out: Array) -> None:
        """Write the columns into ``out`` (n, m, w)."""
        for k, column, values in self.by_port():
            out[:, :, column] = self.slopes[:, :, [k]] * values[:, None]


@dataclass(frozen=True)
class Part:
    """Columns of some rows: ``dense`` (n, m, d) at the places ``at`` (d,), and those by ports."""

    dense: Array
    at: Index
    ports: ByPorts | None

    def written(self, width: int) -> Array:
        """(n, m, width) all columns side by side."""
        out = np.zeros((*self.dense.shape[:2], width))
        out[:, :, self.at] = self.dense
        if self.ports is not None:
            self.ports.put_into(out)
        return out

    def readings(self, channels: Sequence[int]) -> int:
        """How many rows have anything in each of some channels: a reading that was lost has nothing."""
        there = np.any(self.dense[:, list(channels)] != 0.0, axis=2)
        if self.ports is not None:
            there |= np.any(self.ports.slopes[:, list(channels)] != 0.0, axis=2)
        return int(np.sum(there))
