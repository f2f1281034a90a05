"""Columns [J G F r] of the rows of a recording: geometry, every candidate, errors of form, residual.

An effect shifts ports; the machine's derivative by its ports is computed once for all candidates, so a signature costs one
small product a row.

Where columns of rows are drawn: what a fit says of effects, parameters and rows, and nothing else of it.

Series over the arcs that were seen: there, waves of many orders do no more than a few combinations of them.

A joint that turned by a third of a turn cannot tell 60 orders (120 coefficients) apart. With S (n, c) what each coefficient
does to the joint in each row, and W the rows' information about a shift of it, S'WS = V L V'. The coefficients are
N(0, q^2) each, so those of orthonormal directions are, too: what V turns them to, without directions of no information, is
the same problem with fewer columns. Coefficients follow as V times those of the directions; along the others they stay at
nothing, as their prior has them.

Columns [J G F r] of some rows as the derivatives by few ports and numbers of the row: their Gram matrix costs far less so.

Most candidates move one port (all orders of a gear turn one joint): their columns are not written out, see
``truepose.identification.prediction.by_ports``. Where readings compare rows there is no such form.

Constants of masses and springs in a linearised problem: seen only through effects of loads, they must not stand for one.

The derivative by a payload's kg is compliance times the change of the load. At a fit that has the compliance it looks
like the compliance itself, so that a set without it could buy the whole signal with a payload a tolerance or two heavier.
But a set without it has no such derivative. So the columns are those of the effects that every set has; the others
are weighed with masses as fitted, and what masses leave open shows in the 1-sigma of the fit that follows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.by_ports import ByPorts, GramSum, Part
from truepose.identification.prediction.predictor import BLOCK, Predictor
from truepose.identification.prediction.sensor_rows import Block
from truepose.identification.prior import LONG
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Forms
from truepose.identification.signatures.shift_function import ShiftFunction
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.empirical import Empirical
from truepose.models.machine.machine import Machine
from truepose.threads import in_order


@dataclass(frozen=True)
class Point:
    """p (np,) parameters then coefficients of the ``effects``; ``free`` (g,) parameters that columns are drawn of, in steps of
    ``scale`` (g,); of n rows the passive coordinates x (n, nx), which are ``used`` (n,), and their ``weights`` (n,)."""

    effects: tuple[PlacedEffect, ...]
    p: Array
    free: Index
    scale: Array
    x: Array
    used: Mask
    weights: Array

    @classmethod
    def of(cls, fit: Estimate, free: Index) -> Point:
        """At a fit."""
        return cls(fit.effects, fit.p, free, fit.prior.scale[free], fit.x, fit.used, fit.weights)

    def of_rows(self, rows: Index) -> Point:
        """The same of some rows (k,)."""
        return replace(self, x=self.x[rows], used=self.used[rows], weights=self.weights[rows])

    def among(self, names: Sequence[str]) -> Array:
        """(k,) p for names that go on with ports behind its own: these are at nothing."""
        return np.concatenate([self.p, np.zeros(len(names) - len(self.p))])


Layout = Sequence[tuple[list[str], slice]]
"""Of each candidate: the ports that it moves, and where its shifts (ports times coefficients) stand."""
Turns = Mapping[str, Array]
"""Directions (c, r) that are seen of candidates with c coefficients, by label."""


def series_ports(candidates: Sequence[PlacedEffect], layout: Layout) -> dict[int, str]:
    """The port of each candidate of many coefficients, all of one port and without bounds; forms without a name are not among
    them, for a remainder is made of their coefficients."""
    return {
        k: names[0]
        for k, (placed, (names, _)) in enumerate(zip(candidates, layout, strict=True))
        if len(names) == 1
        and len(placed.coefficients) > LONG
        and placed.effect.slug != Empirical.slug
        and not np.any(np.isfinite([[c.lower, c.upper] for c in placed.coefficients]))
    }


def turned(
    shifts: Array, layout: Layout, turns: Sequence[Array | None]
) -> tuple[Array, list[tuple[list[str], slice]]]:
    """Shifts (n, s) by the directions of each candidate (None: by its coefficients), and where they stand."""
    out, places, at = list[Array](), list[tuple[list[str], slice]](), 0
    for (names, where), turn in zip(layout, turns, strict=True):
        own = shifts[:, where] if turn is None else shifts[:, where] @ turn
        places.append((names, slice(at, at := at + own.shape[1])))
        out.append(own)
    return (np.concatenate(out, axis=1) if out else shifts), places


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
                local = shifts[:, where].reshape(len(shifts), own.stop - own.start, len(names))
                dense.append(ports[:, :, [self.place[n] for n in names]] @ local.transpose(0, 2, 1))
                at.append(places)
        first = self.free + (self.columns[-1].stop if self.columns else 0)
        width = modulations.shape[1]
        for k, (chosen, amplitudes) in enumerate(bent):
            signal = self._signal(ports, shifts, dict(zip(chosen.tolist(), amplitudes, strict=True)))
            dense.append(signal[:, :, None] * modulations[:, None, :])
            at.append(np.arange(first + k * width, first + (k + 1) * width))
        dense.append(residual[..., None])
        at.append(np.array([first + len(bent) * width]))
        by = None
        if port:
            by = ByPorts(ports, np.concatenate(port), np.concatenate(column), np.concatenate(values, axis=1))
        return Part(np.concatenate(dense, axis=2), np.concatenate(at), by)

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


def blocks_of_every_set(predictor: Predictor, here: Point) -> Iterator[Block]:
    """Blocks at a point; by constants of masses, the derivatives are those of what the file states."""
    counts, p = here.used * here.weights, here.among(predictor.model.names)
    names = [parameter.name for parameter in predictor.machine.pulling if parameter.free]
    at = [predictor.model.names.index(name) for name in names]
    stated = {effect.label for effect in predictor.machine.effects}
    own = {name for effect in here.effects if effect.label not in stated for name in effect.parameter_names}
    found = [name in own for name in predictor.model.names]
    if not at or not any(found):
        yield from predictor.blocks(p, here.x, counts)
        return
    without = np.where(found, 0.0, p)
    pairs = zip(predictor.blocks(p, here.x, counts), predictor.blocks(without, here.x, counts), strict=True)
    for block, plain in pairs:
        columns = block.dense.copy()
        place = np.array(at) if block.at is None else np.searchsorted(block.at, at)  # no mass follows ports
        columns[:, :, place] = plain.dense[:, :, place]
        yield replace(block, dense=columns)


Sums = tuple[tuple[Array, ...], list[int]]
"""Gram matrices and numbers of readings, by kind of channel."""


class RowColumns:
    """Row-wise shifts of all candidates at one machine, and their effect on the readings."""

    def __init__(
        self,
        machine: Machine,
        recording: Recording,
        candidates: Sequence[PlacedEffect],
        turns: Turns | None = None,
    ) -> None:
        self.machine, self.recording, self.candidates = machine, recording, tuple(candidates)
        self.shifts = ShiftFunction(machine, recording, self.candidates)
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

    @property
    def by_row(self) -> bool:
        """Whether every reading stands for itself."""
        return not any(sensor.compares or sensor.differs_from_row for sensor in self.machine.sensors)

    def predictor(self, effects: Sequence[PlacedEffect]) -> Predictor:
        """The machine with these effects and every port; expressions are built once."""
        key = tuple(effect.label for effect in effects)
        if key not in self._predictors:
            self._predictors[key] = Predictor(self.machine, self.recording, effects, ports=True)
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
