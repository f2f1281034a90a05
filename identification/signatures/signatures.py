"""What every candidate would do to the readings, to first order, at the present estimate.

All of it is kept as one Gram matrix of [J G r]: geometry, every candidate, residual.

An effect shifts ports; the machine's derivative by its ports is computed once for all candidates, so a signature costs one
small product a row.

Where columns of rows are drawn: what a fit says of effects, parameters and rows, and nothing else of it.

Series over the arcs that were seen: there, waves of many orders do no more than a few combinations of them.

A joint that turned by a third of a turn cannot tell 60 orders (120 coefficients) apart. With S (n, c) what each coefficient
does to the joint in each row, and W the rows' information about a shift of it, S'WS = V L V'. The coefficients are
N(0, q^2) each, so those of orthonormal directions are, too: what V turns them to, without directions of no information, is
the same problem with fewer columns. Coefficients follow as V times those of the directions; along the others they stay at
nothing, as their prior has them.

Columns [J G r] of some rows as the derivatives by few ports and numbers of the row: their Gram matrix costs far less so.

Most candidates move one port (all orders of a gear turn one joint): their columns are not written out, see
``truepose.identification.prediction.by_ports``. Where readings compare rows there is no such form.

Constants of masses and springs in a linearised problem: seen only through effects of loads, they must not stand for one.

The derivative by a payload's kg is compliance times the change of the load. At a fit that has the compliance it looks
like the compliance itself, so that a set without it could buy the whole signal with a payload a tolerance or two heavier.
But a set without it has no such derivative. So the columns are those of the effects that every set has; the others
are weighed with masses as fitted, and what masses leave open shows in the 1-sigma of the fit that follows.

What every candidate shifts, row by row, as one compiled function.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tolerance_classes import part_classes
from truepose.identification.fit.turn import seen_directions
from truepose.identification.posterior.spike_slab import UNSEEN
from truepose.identification.prediction.by_ports import ByPorts, GramSum, Part
from truepose.identification.prediction.predictor import BLOCK, Predictor
from truepose.identification.prediction.sensor_rows import Block
from truepose.identification.prior import LONG
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Linearisation
from truepose.models.effects.base import PlacedEffect, Site
from truepose.models.effects.empirical import Empirical
from truepose.models.machine.kinematics import driver_default
from truepose.models.machine.machine import Machine
from truepose.models.machine.states import state_names
from truepose.threads import in_order


class ShiftFunction:
    """All candidates' shifts by their coefficients (in units of scale), as one function of a row."""

    def __init__(self, machine: Machine, recording: Recording, candidates: Sequence[PlacedEffect]) -> None:
        self._machine, self._recording = machine, recording
        self._names = [*(p.name for p in machine.parameters), *machine.ports]
        self.drivers = tuple(dict.fromkeys(name for c in candidates for name in c.drivers))
        q = {name: ca.SX.sym(name) for name in machine.mechanism.readings}
        z = {name: ca.SX.sym(name) for name in self.drivers}
        values = {name: ca.SX.sym(name) for name in self._names}
        self._loads = [f"{case}{name}" for case in machine.load_cases for name in self._names]
        loads = {name: ca.SX.sym(f"load.{name}") for name in self._loads}
        self._states = state_names(machine)
        states = {name: ca.SX.sym(name) for name in self._states}
        outputs, layout, offset = [], [], 0
        for candidate in candidates:
            c = {item.name: ca.SX.sym(item.name) for item in candidate.coefficients}
            site = Site(machine, candidate.place, candidate.settings_map, c, q, z, values, loads, states)
            shifts = candidate.effect.shifts(site)
            stacked, symbols = ca.vertcat(*shifts.values()), ca.vertcat(*c.values())
            local = ca.substitute(ca.jacobian(stacked, symbols), symbols, ca.SX.zeros(len(c)))
            local = local @ ca.diag(ca.DM([item.scale for item in candidate.coefficients]))
            outputs.append(ca.vec(ca.densify(local)))
            size = local.numel()
            layout.append(([site.checked(port, candidate) for port in shifts], slice(offset, offset + size)))
            offset += size
        self.layout: list[tuple[list[str], slice]] = layout
        groups = (q, z, values, loads, states)
        inputs = [ca.vertcat(*group.values()) if group else ca.SX(0, 1) for group in groups]
        together = ca.vertcat(*outputs) if outputs else ca.SX(0, 1)
        self._function = BatchFunction("shifts", inputs, [together])

    def __call__(
        self, names: Sequence[str], p: Array, loads: Mapping[str, Array], states: Mapping[str, Array],
        rows: Index,
    ) -> Array:  # fmt: skip
        """(k, total) shift derivatives for some rows; loads and states (k,) are theirs."""
        at = {name: k for k, name in enumerate(names)}
        which = [at[name] for name in self._names]
        rec = self._recording
        z = np.empty((len(rows), len(self.drivers)))
        for k, name in enumerate(self.drivers):
            recorded = rec.driver(name)
            z[:, k] = driver_default(self._machine, name) if recorded is None else recorded[rows]
        force, state = (
            np.column_stack([np.zeros((len(rows), 0)), *(group[name] for name in wanted)])
            for group, wanted in ((loads, self._loads), (states, self._states))
        )
        return self._function(rec.positions[rows], z, p[which], force, state)[0][..., 0]


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
    """The port of each candidate of many coefficients, all of one port and without bounds, that have a name: the posterior
    turns forms without one itself."""
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


def local_shifts(shifts: Array, own: slice, names: Sequence[str], where: slice) -> Array:
    """(n, c, p) of shifts (n, s): of one candidate's columns ``own`` at its ports ``names``."""
    return shifts[:, where].reshape(len(shifts), own.stop - own.start, len(names))


@dataclass(frozen=True)
class Columns:
    """Where columns stand: ``free`` of geometry, then those of candidates, then the residual.

    place: number of each port among the derivatives; columns and layout: of the candidates.
    """

    free: int
    columns: Sequence[slice]
    layout: Layout
    place: Mapping[str, int]

    def part(self, geometry: Array, ports: Array, shifts: Array, residual: Array) -> Part:
        """geometry (n, m, free), ports (n, m, p) derivatives, shifts (n, s), residual (n, m): weighed alike."""
        dense, at = [geometry], [np.arange(self.free)]
        port, column, values = list[Index](), list[Index](), list[Array]()
        for own, (names, where) in zip(self.columns, self.layout, strict=True):
            places = np.arange(own.start, own.stop) + self.free
            if len(names) == 1:
                port.append(np.full(len(places), self.place[names[0]]))
                column.append(places)
                values.append(shifts[:, where])
            else:
                local = local_shifts(shifts, own, names, where)
                dense.append(ports[:, :, [self.place[n] for n in names]] @ local.transpose(0, 2, 1))
                at.append(places)
        dense.append(residual[..., None])
        at.append(np.array([self.free + (self.columns[-1].stop if self.columns else 0)]))
        by = None
        if port:
            by = ByPorts(ports, np.concatenate(port), np.concatenate(column), np.concatenate(values, axis=1))
        return Part(np.concatenate(dense, axis=2), np.concatenate(at), by)


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


def parted(rows: int) -> list[slice]:
    """So many rows, a block at a time."""
    return [slice(start, min(start + BLOCK, rows)) for start in range(0, rows, BLOCK)]


CHUNK = 32 * BLOCK
"""Rows that are summed up before the next ones."""


class Signatures:
    """Columns of all candidates at one machine: shifts row by row, what they do to the readings, and their sums at a fit."""

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

    def sums(self, at: Point, rows: Index, order: Index | None = None) -> Sums:
        """Over some of the fitted rows (k,); ``order`` (n,) gives effects the drivers of other rows."""
        kinds = [channel.kind for channel in self.machine.channels]
        which = [[k for k, kind in enumerate(kinds) if kind == name] for name in dict.fromkeys(kinds)]
        width = len(at.free) + self.width + 1
        sums, counts = [GramSum(width, own) for own in which], [0] * len(which)
        for part in self._parts(at, rows, order):
            for k, own in enumerate(which):
                sums[k].add(part)
                counts[k] += part.readings(own)
        return tuple(one.matrix() for one in sums), counts

    def _parts(self, at: Point, rows: Index, order: Index | None) -> Iterator[Part]:
        """Columns of fitted rows (k,), some at a time; of all of them where readings compare rows."""
        if any(sensor.compares for sensor in self.machine.sensors):
            for stacked in self.stacked(at, order):
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
                shifts, block.residual * root[:, :, 0],
            )  # fmt: skip

        yield from in_order(part, parted(len(rows)))

    def stacked(self, at: Point, order: Index | None) -> Iterator[Array]:
        """Blocks (rows, channels, free + width + 1) of the fitted readings."""
        for rows, block, signature in self.blocks_of(at, order):
            keep = np.flatnonzero(at.used[rows])
            root = np.sqrt(at.weights[rows])[keep, None, None]
            jacobian, own = block.jacobian[keep][:, :, at.free] * at.scale, signature[keep]
            yield np.concatenate([jacobian, own, block.residual[keep][..., None]], axis=2) * root

    def blocks_of(self, at: Point, order: Index | None) -> Iterator[tuple[slice, Block, Array]]:
        """Row ranges with their block and signatures (n, m, width)."""
        predictor, (shifts, layout) = self.predictor(at.effects), self._shifted(at, order)
        place = {name: k for k, name in enumerate(predictor.model.names)}
        for block in blocks_of_every_set(predictor, at):
            out, own = np.zeros((*block.here.shape[:2], self.width)), shifts[block.rows]
            for columns, (ports, where) in zip(self.columns, layout, strict=True):
                moved = block.here[:, :, [place[port] for port in ports]]
                out[:, :, columns] = moved @ local_shifts(own, columns, ports, where).transpose(0, 2, 1)
            yield block.rows, block, block.changes(out)

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

    def of(self, candidates: Sequence[PlacedEffect]) -> Signatures:
        """Signatures of other candidates on the same machine and recording; what was built for its fits is shared."""
        other = Signatures(self.machine, self.recording, candidates, self.by_label)
        other._predictors = self._predictors
        return other

    def seen_from(self, fit: Estimate) -> Signatures:
        """The same with long series in the directions that the readings fitted there see; what has them keeps them."""
        wide = series_ports(self.candidates, self.shifts.layout)
        new = {k: port for k, port in wide.items() if self.candidates[k].label not in self.by_label}
        if not new or any(sensor.compares for sensor in self.machine.sensors):
            return self
        rows, ports, at = np.flatnonzero(fit.used), list(dict.fromkeys(new.values())), self._point(fit)
        _, information, _ = self.scores(fit, ports, noise=np.ones(fit.residual.shape[1]))
        seen: dict[int, Array] = {}
        for part in parted(len(rows)):
            shifts = self.every_shift(at, rows[part])
            for k, port in new.items():
                own = shifts[:, self.shifts.layout[k][1]]
                seen[k] = seen.get(k, 0.0) + own.T @ (information[part, ports.index(port)][:, None] * own)
        directions = {self.candidates[k].label: seen_directions(own, UNSEEN) for k, own in seen.items()}
        other = copy(self)
        other.turn({**self.by_label, **directions})
        return other

    def _summed(self, fit: Estimate, rows: Index, order: Index | None = None) -> Sums:
        """Return ``sums`` of fitted rows (k,), a chunk after the other: memory stays flat."""
        step = CHUNK if self.by_row else max(len(rows), 1)
        grams: tuple[Array, ...] = ()
        for start in range(0, max(len(rows), 1), step):
            more, further = self.sums(self._point(fit), rows[start : start + step], order)
            if not grams:
                grams, counts = more, further
                continue
            for gram, other in zip(grams, more, strict=True):
                np.add(gram, other, out=gram)
            counts = [a + b for a, b in zip(counts, further, strict=True)]
        return grams, counts

    def linearise(self, fit: Estimate, *, order: Index | None = None) -> Linearisation:
        """Gram matrices at a fit, whose effects must be among the candidates.

        ``order`` (n,) gives effects the drivers of other rows (a placebo).
        """
        return self._linearised(fit, *self._summed(fit, np.flatnonzero(fit.used), order))

    def halved(self, fit: Estimate) -> tuple[Linearisation, tuple[Linearisation, Linearisation]]:
        """Of all fitted rows, and of each half of them in the order of acquisition, in one pass."""
        split = np.array_split(self.recording.in_time(fit.used), 2)
        parts = [self._summed(fit, np.sort(rows)) for rows in split]
        (first, second), counts = (p[0] for p in parts), [p[1] for p in parts]
        whole = tuple(a + b for a, b in zip(first, second, strict=True))
        every = [(whole, [a + b for a, b in zip(*counts, strict=True)]), *parts]
        found, *halves = (self._linearised(fit, *each) for each in every)
        return found, (halves[0], halves[1])

    def _linearised(self, fit: Estimate, grams: tuple[Array, ...], counts: list[int]) -> Linearisation:
        geometry, prior = self._point(fit).free, fit.prior
        n, read = len(geometry), (counts[0] - fit.levels, *counts[1:])
        departure = np.zeros(len(grams[0]) - 1)
        departure[:n] = (fit.p - prior.mean)[geometry] / prior.scale[geometry]
        for candidate, amplitudes in self._fitted(fit):
            departure[n:][self.columns[candidate]] = amplitudes
        parts = part_classes([prior.names[k] for k in geometry], [prior.parts[k] for k in geometry])
        return Linearisation(
            grams, read, n, self.columns, departure, fit.prior_weight[:n] / fit.noise, parts, self.candidates, self.turns,
        )  # fmt: skip

    def scores(
        self, fit: Estimate, ports: Sequence[str], noise: Array | None = None
    ) -> tuple[Array, Array, Index]:
        """Of each fitted row (k,) and port: J'r and J'J (k, p) of its shift; by ``noise`` (m,) of each channel in stated
        sigmas, by default what the fit leaves."""
        predictor = self.predictor(fit.effects)
        at = [predictor.model.names.index(name) for name in ports]
        p = self._point(fit).among(predictor.model.names)
        if noise is None:
            noise = np.sqrt(np.maximum(np.nanmean(fit.residual[fit.used] ** 2, axis=0), 1e-300))
        score, weight = list[Array](), list[Array]()
        for block in predictor.blocks(p, fit.x, fit.used * fit.weights):
            keep = np.flatnonzero(fit.used[block.rows])
            slopes = block.columns(at)[keep] / noise[:, None]
            score.append(-np.einsum("nmp,nm->np", slopes, block.residual[keep] / noise))
            weight.append(np.sum(slopes**2, axis=1))
        return np.concatenate(score), np.concatenate(weight), np.flatnonzero(fit.used)

    def _fitted(self, fit: Estimate) -> Iterator[tuple[int, Array]]:
        """Candidates that the fit holds, with what stands in their columns."""
        labels = {c.label: k for k, c in enumerate(self.candidates)}
        for effect in fit.fitted_effects():
            amplitudes = np.array(effect.amplitudes) / [c.scale for c in effect.coefficients]
            turn = self.turns[labels[effect.label]]
            yield labels[effect.label], amplitudes if turn is None else turn.T @ amplitudes

    def indices(self, chosen: Sequence[int]) -> list[int]:
        """Columns of G of the chosen candidates."""
        return [k for i in chosen for k in range(self.columns[i].start, self.columns[i].stop)]

    def _point(self, fit: Estimate) -> Point:
        """Where columns are drawn: at a fit, of its free parameters without effect coefficients."""
        free = fit.prior.free
        return Point.of(fit, free[free < len(self.machine.parameters)])

    def rows(self, fit: Estimate) -> Iterator[tuple[slice, Block, Array]]:
        """Row ranges with their block and signatures (n, m, width)."""
        yield from self.blocks_of(self._point(fit), None)
