"""What every candidate would do to the readings, to first order, at the present estimate.

An effect shifts ports; the machine's derivative by its ports is computed once for all candidates, so a
signature costs one small product a row. All of it is kept as one Gram matrix of [J G F r]; F are the errors of form.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from truepose.identification.fit.estimate import Estimate
from truepose.identification.fit.tolerance_classes import part_classes
from truepose.identification.fit.turn import seen_directions
from truepose.identification.posterior.spike_slab import UNSEEN
from truepose.identification.prediction.by_ports import Part
from truepose.identification.prediction.gram_sum import GramSum
from truepose.identification.prediction.predictor import BLOCK, Predictor
from truepose.identification.prediction.sensor_rows import Block
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.arcs import Layout, Turns, series_ports, turned
from truepose.identification.signatures.forms import Forms
from truepose.identification.signatures.linearisation import Linearisation
from truepose.identification.signatures.products import Columns
from truepose.identification.signatures.shift_function import ShiftFunction
from truepose.identification.signatures.weighed import blocks_of_every_set
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine import Machine
from truepose.models.placed import EffectAtPlace
from truepose.threads import in_order

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Signatures:
    """Row-wise shifts of all candidates at one machine, and their effect on the readings."""

    def __init__(self, machine: Machine, recording: Recording, candidates: Sequence[PlacedEffect]) -> None:
        self.machine, self.recording, self.candidates = machine, recording, tuple(candidates)
        self._shifts = ShiftFunction(machine, recording, self.candidates)
        self._predictors: dict[tuple[str, ...], Predictor] = {}
        self._turn({})

    def _turn(self, turns: Turns) -> None:
        self._by_label = turns
        self.turns = tuple(turns.get(c.label) for c in self.candidates)
        pairs = zip(self.candidates, self.turns, strict=True)
        ends = np.cumsum([0, *(len(c.coefficients) if t is None else t.shape[1] for c, t in pairs)])
        self.columns = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
        self.width = int(ends[-1])

    def of(self, candidates: Sequence[PlacedEffect]) -> Signatures:
        """Signatures of other candidates on the same machine and recording; what was built for its fits is shared."""
        other = Signatures(self.machine, self.recording, candidates)
        other._predictors = self._predictors
        other._turn(self._by_label)
        return other

    def seen_from(self, fit: Estimate) -> Signatures:
        """The same with long series in the directions that the readings fitted there see; what has them keeps them."""
        wide = series_ports(self.candidates, self._shifts.layout)
        new = {k: port for k, port in wide.items() if self.candidates[k].label not in self._by_label}
        if not new or any(sensor.compares for sensor in self.machine.sensors):
            return self
        rows, ports = np.flatnonzero(fit.used), list(dict.fromkeys(new.values()))
        _, information, _ = self.scores(fit, ports, noise=np.ones(fit.residual.shape[1]))
        seen: dict[int, Array] = {}
        for part in _parted(len(rows)):
            shifts = self._every_shift(fit, rows[part])
            for k, port in new.items():
                own = shifts[:, self._shifts.layout[k][1]]
                seen[k] = seen.get(k, 0.0) + own.T @ (information[part, ports.index(port)][:, None] * own)
        directions = {self.candidates[k].label: seen_directions(own, UNSEEN) for k, own in seen.items()}
        other = copy(self)
        other._turn({**self._by_label, **directions})
        return other

    def linearise(self, fit: Estimate, *, order: NDArray[np.intp] | None = None) -> Linearisation:
        """Gram matrices at a fit, whose effects must be among the candidates.

        ``order`` (n,) gives effects the drivers of other rows (a placebo).
        """
        forms = self._forms(fit)
        return self._linearised(fit, forms, *self._summed(fit, forms, np.flatnonzero(fit.used), order))

    def halved(self, fit: Estimate) -> tuple[Linearisation, tuple[Linearisation, Linearisation]]:
        """Of all fitted rows, and of each half of them in the order of acquisition, in one pass; errors of form are those of
        all."""
        forms = self._forms(fit)
        parts = [
            self._summed(fit, forms, np.sort(p)) for p in np.array_split(self.recording.in_time(fit.used), 2)
        ]
        (first, second), counts = (p[0] for p in parts), [p[1] for p in parts]
        whole = tuple(a + b for a, b in zip(first, second, strict=True))
        every = [(whole, [a + b for a, b in zip(*counts, strict=True)]), *parts]
        found, *halves = (self._linearised(fit, forms, *each) for each in every)
        return found, (halves[0], halves[1])

    def _forms(self, fit: Estimate) -> Forms:
        """Errors of form of what a fit holds, over its rows."""
        signals = [
            (np.array(self.indices(list(own)), dtype=np.intp), np.concatenate(list(own.values())))
            for own in self._causes(fit)
        ]
        return Forms.of(self.recording, fit.used, signals)

    def _summed(
        self, fit: Estimate, forms: Forms, rows: Index, order: Index | None = None
    ) -> tuple[tuple[Array, ...], list[int]]:
        """Gram matrices and numbers of readings over some of the fitted rows (k,), by kind of channel."""
        kinds = [channel.kind for channel in self._predictor(fit.effects).channels]
        which = [[k for k, kind in enumerate(kinds) if kind == name] for name in dict.fromkeys(kinds)]
        size = len(self._geometry(fit)) + self.width + forms.width + 1
        sums, counts = [GramSum(size, own) for own in which], [0] * len(which)
        for part in self._parts(fit, forms, rows, order):
            for k, own in enumerate(which):
                sums[k].add(part)
                counts[k] += part.readings(own)
        return tuple(one.matrix() for one in sums), counts

    def _linearised(
        self, fit: Estimate, forms: Forms, grams: tuple[Array, ...], counts: list[int]
    ) -> Linearisation:
        geometry, prior = self._geometry(fit), fit.prior
        n, read = len(geometry), (counts[0] - fit.levels, *counts[1:])
        departure = np.zeros(len(grams[0]) - 1)
        departure[:n] = (fit.p - prior.mean)[geometry] / prior.scale[geometry]
        for at, amplitudes in forms.signals:
            departure[n + at] = amplitudes
        parts = part_classes([prior.names[k] for k in geometry], [prior.parts[k] for k in geometry])
        return Linearisation(
            grams, read, n, self.columns, forms.width, departure, fit.prior_weight[:n] / fit.noise, parts,
            self.candidates, tuple(tuple(own) for own in self._causes(fit)), forms.sources, self.turns,
        )  # fmt: skip

    def scores(
        self, fit: Estimate, ports: Sequence[str], noise: Array | None = None
    ) -> tuple[Array, Array, NDArray[np.intp]]:
        """Of each fitted row (k,) and port: J'r and J'J (k, p) of its shift; by ``noise`` (m,) of each channel in stated
        sigmas, by default what the fit leaves."""
        predictor = self._predictor(fit.effects)
        at = [predictor.model.names.index(name) for name in ports]
        p = np.concatenate([fit.p, np.zeros(len(predictor.model.names) - len(fit.p))])
        if noise is None:
            noise = np.sqrt(np.maximum(np.nanmean(fit.residual[fit.used] ** 2, axis=0), 1e-300))
        score, weight = list[Array](), list[Array]()
        for block in predictor.blocks(p, fit.x, fit.used * fit.weights):
            keep = np.flatnonzero(fit.used[block.rows])
            slopes = block.columns(at)[keep] / noise[:, None]
            score.append(-np.einsum("nmp,nm->np", slopes, block.residual[keep] / noise))
            weight.append(np.sum(slopes**2, axis=1))
        return np.concatenate(score), np.concatenate(weight), np.flatnonzero(fit.used)

    def _causes(self, fit: Estimate) -> list[dict[int, Array]]:
        """What the fit's effects blame: of each, its candidates with their coefficients in units of scale."""
        labels, out = (
            {c.label: k for k, c in enumerate(self.candidates)},
            defaultdict[EffectAtPlace, dict[int, Array]](dict),
        )
        for effect in fit.fitted_effects():
            amplitudes = np.array(effect.amplitudes) / [c.scale for c in effect.coefficients]
            turn = self.turns[labels[effect.label]]
            out[effect.at_place][labels[effect.label]] = amplitudes if turn is None else turn.T @ amplitudes
        return list(out.values())

    def indices(self, chosen: Sequence[int]) -> list[int]:
        """Columns of G of the chosen candidates."""
        return [k for i in chosen for k in range(self.columns[i].start, self.columns[i].stop)]

    def _geometry(self, fit: Estimate) -> NDArray[np.intp]:
        """Indices of the free parameters, without effect coefficients."""
        free = fit.prior.free
        return free[free < len(self.machine.parameters)]

    def blocks(self, fit: Estimate) -> Iterator[Array]:
        """Blocks (k, free + width + 1) of rows of [J G r] of the fitted readings."""
        for block in self._stacked(fit, Forms.none(), None):
            yield block.reshape(-1, block.shape[2])

    def _parts(self, fit: Estimate, forms: Forms, rows: Index, order: Index | None) -> Iterator[Part]:
        """Columns of fitted rows (k,), some at a time; of all of them where readings compare rows."""
        if any(sensor.compares for sensor in self.machine.sensors):
            for stacked in self._stacked(fit, forms, order):
                yield Part(stacked, np.arange(stacked.shape[2]), None)
            return
        predictor = self._predictor(fit.effects)
        ports = list(dict.fromkeys(n for names, _ in self._shifts.layout for n in names))
        at = [predictor.model.names.index(name) for name in ports]
        free, place = self._geometry(fit), {name: k for k, name in enumerate(ports)}
        p = np.concatenate([fit.p, np.zeros(len(predictor.model.names) - len(fit.p))])
        predictor.warm()  # before threads ask

        def part(some: slice) -> Part:
            own = rows[some]
            shifts, layout = self._shifted(fit, order, own)
            where = Columns(len(free), self.columns, layout, place)
            here = replace(fit, x=fit.x[own], used=fit.used[own], weights=fit.weights[own])
            (block,) = blocks_of_every_set(predictor.of_rows(own), here, p)
            root = np.sqrt(here.weights)[:, None, None]
            derivative = block.columns([*free.tolist(), *at]) * root
            return where.part(
                derivative[:, :, : len(free)] * fit.prior.scale[free], derivative[:, :, len(free) :],
                shifts, forms.signals, forms.of_rows(own), block.residual * root[:, :, 0],
            )  # fmt: skip

        yield from in_order(part, _parted(len(rows)))

    def _stacked(self, fit: Estimate, forms: Forms, order: NDArray[np.intp] | None) -> Iterator[Array]:
        """Blocks (rows, channels, free + width + forms + 1) of the fitted readings."""
        free = self._geometry(fit)
        scale = fit.prior.scale[free]
        for rows, block, signature in self.rows(fit, order=order):
            keep = np.flatnonzero(fit.used[rows])
            root = np.sqrt(fit.weights[rows])[keep, None, None]
            jacobian, own = block.jacobian[keep][:, :, free] * scale, signature[keep]
            bent = forms.columns(own, np.arange(len(fit.used))[rows][keep])
            yield np.concatenate([jacobian, own, bent, block.residual[keep][..., None]], axis=2) * root

    def rows(
        self, fit: Estimate, *, order: NDArray[np.intp] | None = None
    ) -> Iterator[tuple[slice, Block, Array]]:
        """Row ranges with their block and signatures (n, m, width)."""
        predictor, (shifts, layout) = self._predictor(fit.effects), self._shifted(fit, order)
        p = np.concatenate([fit.p, np.zeros(len(predictor.model.names) - len(fit.p))])
        place = {name: k for k, name in enumerate(predictor.model.names)}
        for block in blocks_of_every_set(predictor, fit, p):
            changes = self._apply(block.here, shifts[block.rows], layout, place)
            yield block.rows, block, block.changes(changes)

    def _shifted(
        self, fit: Estimate, order: NDArray[np.intp] | None, rows: NDArray[np.intp] | None = None
    ) -> tuple[Array, Layout]:
        """The shifts (n, s) of all candidates at a fit in all rows or some, and where they stand."""
        rows = np.arange(len(fit.used)) if rows is None else rows
        shifts = self._every_shift(fit, rows if order is None else order[rows])
        return turned(shifts, self._shifts.layout, self.turns)

    def _every_shift(self, fit: Estimate, rows: NDArray[np.intp]) -> Array:
        """(k, s) of all candidates at a fit in some rows, by their coefficients."""
        predictor, x = self._predictor(fit.effects).of_rows(rows), fit.x[rows]
        p = np.concatenate([fit.p, np.zeros(len(predictor.model.names) - len(fit.p))])
        return self._shifts(predictor.model.names, p, predictor.loads(p, x), predictor.states(p, x), rows)

    def _predictor(self, effects: Sequence[PlacedEffect]) -> Predictor:
        """The machine with these effects and every port; expressions are built once."""
        key = tuple(effect.label for effect in effects)
        if key not in self._predictors:
            self._predictors[key] = Predictor(self.machine, self.recording, effects, ports=True)
        return self._predictors[key]

    def _apply(self, jacobian: Array, shifts: Array, layout: Layout, place: dict[str, int]) -> Array:
        out = np.zeros((*jacobian.shape[:2], self.width))
        for columns, (ports, at) in zip(self.columns, layout, strict=True):
            where = [place[port] for port in ports]
            local = shifts[:, at].reshape(len(shifts), columns.stop - columns.start, len(ports))
            out[:, :, columns] = jacobian[:, :, where] @ local.transpose(0, 2, 1)
        return out


def _parted(rows: int) -> list[slice]:
    """So many rows, a block at a time."""
    return [slice(start, min(start + BLOCK, rows)) for start in range(0, rows, BLOCK)]


__all__ = ["Signatures"]
