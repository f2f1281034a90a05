"""Columns [J G F r] of some rows as the derivatives by few ports and numbers of the row: their Gram matrix costs far less so.

Most candidates move one port (all orders of a gear turn one joint): their columns are not written out, see
``truepose.identification.prediction.by_ports``. Where readings compare rows there is no such form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.prediction.by_ports import ByPorts, Part
from truepose.identification.signatures.arcs import Layout


@dataclass(frozen=True)
class Columns:
    """Where columns stand: ``free`` of geometry, then those of candidates, then errors of form, then the residual.

    place: number of each port among the derivatives; columns and layout: of the candidates.
    """

    free: int
    columns: Sequence[slice]
    layout: Layout
    place: Mapping[str, int]

    def part(
        self, geometry: Array, ports: Array, shifts: Array, bent: Sequence[tuple[Index, Array]], modulations: Array,
        residual: Array,
    ) -> Part:  # fmt: skip
        """geometry (n, m, free), ports (n, m, p) derivatives, shifts (n, s), residual (n, m): weighed alike.

        bent: signals (columns of G, coefficients) that ``modulations`` (n, u) bend.
        """
        dense, at = [geometry], [np.arange(self.free)]
        port, column, values = list[Index](), list[Index](), list[Array]()
        for own, (names, where) in zip(self.columns, self.layout, strict=True):
            places = np.arange(own.start, own.stop) + self.free
            if len(names) == 1:
                port.append(np.full(len(places), self.place[names[0]]))
                column.append(places)
                values.append(shifts[:, where])
            else:
                dense.append(self._signature(ports, shifts, own, names, where))
                at.append(places)
        first = self.free + (self.columns[-1].stop if self.columns else 0)
        width = modulations.shape[1]
        for k, (chosen, amplitudes) in enumerate(bent):
            signal = self._signal(ports, shifts, dict(zip(chosen.tolist(), amplitudes, strict=True)))
            dense.append(signal[:, :, None] * modulations[:, None, :])
            at.append(np.arange(first + k * width, first + (k + 1) * width))
        dense.append(residual[..., None])
        at.append(np.array([first + len(bent) * width]))
        by = (
            ByPorts(ports, np.concatenate(port), np.concatenate(column), np.concatenate(values, axis=1))
            if port
            else None
        )
        return Part(np.concatenate(dense, axis=2), np.concatenate(at), by)

    def _signature(
        self, ports: Array, shifts: Array, own: slice, names: Sequence[str], where: slice
    ) -> Array:
        """(n, m, c) columns of one candidate."""
        local = shifts[:, where].reshape(len(shifts), own.stop - own.start, len(names))
        return np.asarray(ports[:, :, [self.place[n] for n in names]] @ local.transpose(0, 2, 1))

    def _signal(self, ports: Array, shifts: Array, amplitudes: Mapping[int, float]) -> Array:
        """(n, m) what columns of G with these coefficients do together."""
        out = np.zeros(ports.shape[:2])
        for own, (names, where) in zip(self.columns, self.layout, strict=True):
            if own.start in amplitudes:
                size = np.array([amplitudes[c] for c in range(own.start, own.stop)])
                local = shifts[:, where].reshape(len(shifts), own.stop - own.start, len(names))
                moved = np.einsum("ncp,c->np", local, size)
                out += np.einsum("nmp,np->nm", ports[:, :, [self.place[n] for n in names]], moved)
        return out
