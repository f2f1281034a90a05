"""Columns [J G F r] of the rows of a recording: geometry, every candidate, errors of form, residual.

An effect shifts ports; the machine's derivative by its ports is computed once for all candidates, so a signature costs one
small product a row.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from itertools import pairwise

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.prediction.by_ports import Part
from truepose.identification.prediction.gram_sum import GramSum
from truepose.identification.prediction.predictor import BLOCK, Predictor
from truepose.identification.prediction.sensor_rows import Block
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.arcs import Layout, Turns, turned
from truepose.identification.signatures.forms import Forms
from truepose.identification.signatures.point import Point
from truepose.identification.signatures.products import Columns
from truepose.identification.signatures.shift_function import ShiftFunction
from truepose.identification.signatures.weighed import blocks_of_every_set
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine
from truepose.threads import in_order

Sums = tuple[tuple[Array, ...], list[int]]
"""Gram matrices and numbers of readings, by kind of channel."""


class RowColumns:
    """Row-wise shifts of all candidates at one machine, and their effect on the readings.

    size: rows of the recording of which these may be a part; it alone decides what is compiled.
    """

    def __init__(
        self,
        machine: Machine,
        recording: Recording,
        candidates: Sequence[PlacedEffect],
        turns: Turns | None = None,
        size: int | None = None,
    ) -> None:
        self.machine, self.recording, self.candidates = machine, recording, tuple(candidates)
        self.size = len(recording) if size is None else size
        self.shifts = ShiftFunction(machine, recording, self.candidates, self.size)
        self._predictors: dict[tuple[str, ...], Predictor] = {}
        self.turn({} if turns is None else turns)

    def turn(self, turns: Turns) -> None:
        """Have long series in these directions, by label."""
        self.by_label = turns
        self.turns = tuple(turns.get(c.label) for c in self.candidates)
        pairs = zip(self.candidates, self.turns, strict=True)
        ends = np.cumsum([0, *(len(c.coefficients) if t is None else t.shape[1] for c, t in pairs)])
        self.columns = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
        self.width = int(ends[-1])

    def over(self, recording: Recording) -> RowColumns:
        """The same of other rows, with the functions that were built so far."""
        other = copy(self)
        other.recording, other.shifts = recording, self.shifts.over(recording)
        other._predictors = {key: built.over(recording) for key, built in self._predictors.items()}
        return other

    @property
    def by_row(self) -> bool:
        """Whether every reading stands for itself."""
        return not any(sensor.compares or sensor.differs_from_row for sensor in self.machine.sensors)

    def predictor(self, effects: Sequence[PlacedEffect]) -> Predictor:
        """The machine with these effects and every port; expressions are built once."""
        key = tuple(effect.label for effect in effects)
        if key not in self._predictors:
            self._predictors[key] = Predictor(
                self.machine, self.recording, effects, ports=True, size=self.size
            )
        return self._predictors[key]

    def sums(self, at: Point, forms: Forms, rows: Index, order: Index | None = None) -> Sums:
        """Over some of the fitted rows (k,); ``order`` (n,) gives effects the drivers of other rows."""
        kinds = [channel.kind for channel in self.machine.channels]
        which = [[k for k, kind in enumerate(kinds) if kind == name] for name in dict.fromkeys(kinds)]
        width = len(at.free) + self.width + forms.width + 1
        sums, counts = [GramSum(width, own) for own in which], [0] * len(which)
        for part in self._parts(at, forms, rows, order):
            for k, own in enumerate(which):
                sums[k].add(part)
                counts[k] += part.readings(own)
        return tuple(one.matrix() for one in sums), counts

    def _parts(self, at: Point, forms: Forms, rows: Index, order: Index | None) -> Iterator[Part]:
        """Columns of fitted rows (k,), some at a time; of all of them where readings compare rows."""
        if any(sensor.compares for sensor in self.machine.sensors):
            for stacked in self.stacked(at, forms, order):
                yield Part(stacked, np.arange(stacked.shape[2]), None)
            return
        predictor = self.predictor(at.effects)
        ports = list(dict.fromkeys(n for names, _ in self.shifts.layout for n in names))
        which = [predictor.model.names.index(name) for name in ports]
        place = {name: k for k, name in enumerate(ports)}
        predictor.warm()  # before threads ask

        def part(some: slice) -> Part:
            own = rows[some]
            shifts, layout = self._shifted(at, order, own)
            where, here = Columns(len(at.free), self.columns, layout, place), at.of_rows(own)
            (block,) = blocks_of_every_set(predictor.of_rows(own), here)
            root = np.sqrt(here.weights)[:, None, None]
            derivative = block.columns([*at.free.tolist(), *which]) * root
            return where.part(
                derivative[:, :, : len(at.free)] * at.scale, derivative[:, :, len(at.free) :],
                shifts, forms.signals, forms.of_rows(own), block.residual * root[:, :, 0],
            )  # fmt: skip

        yield from in_order(part, parted(len(rows)))

    def stacked(self, at: Point, forms: Forms, order: Index | None) -> Iterator[Array]:
        """Blocks (rows, channels, free + width + forms + 1) of the fitted readings."""
        for rows, block, signature in self.blocks_of(at, order):
            keep = np.flatnonzero(at.used[rows])
            root = np.sqrt(at.weights[rows])[keep, None, None]
            jacobian, own = block.jacobian[keep][:, :, at.free] * at.scale, signature[keep]
            bent = forms.columns(own, np.arange(len(at.used))[rows][keep])
            yield np.concatenate([jacobian, own, bent, block.residual[keep][..., None]], axis=2) * root

    def blocks_of(self, at: Point, order: Index | None) -> Iterator[tuple[slice, Block, Array]]:
        """Row ranges with their block and signatures (n, m, width)."""
        predictor, (shifts, layout) = self.predictor(at.effects), self._shifted(at, order)
        place = {name: k for k, name in enumerate(predictor.model.names)}
        for block in blocks_of_every_set(predictor, at):
            changes = self._apply(block.here, shifts[block.rows], layout, place)
            yield block.rows, block, block.changes(changes)

    def _shifted(self, at: Point, order: Index | None, rows: Index | None = None) -> tuple[Array, Layout]:
        """The shifts (n, s) of all candidates in all rows or some, and where they stand."""
        rows = np.arange(len(at.used)) if rows is None else rows
        shifts = self.every_shift(at, rows if order is None else order[rows])
        return turned(shifts, self.shifts.layout, self.turns)

    def every_shift(self, at: Point, rows: Index) -> Array:
        """(k, s) of all candidates in some rows, by their coefficients."""
        predictor, x = self.predictor(at.effects).of_rows(rows), at.x[rows]
        p = at.among(predictor.model.names)
        return self.shifts(predictor.model.names, p, predictor.loads(p, x), predictor.states(p, x), rows)

    def _apply(self, jacobian: Array, shifts: Array, layout: Layout, place: dict[str, int]) -> Array:
        out = np.zeros((*jacobian.shape[:2], self.width))
        for columns, (ports, at) in zip(self.columns, layout, strict=True):
            where = [place[port] for port in ports]
            local = shifts[:, at].reshape(len(shifts), columns.stop - columns.start, len(ports))
            out[:, :, columns] = jacobian[:, :, where] @ local.transpose(0, 2, 1)
        return out


def parted(rows: int) -> list[slice]:
    """So many rows, a block at a time."""
    return [slice(start, min(start + BLOCK, rows)) for start in range(0, rows, BLOCK)]
