"""What every candidate would do to the readings, to first order, at the present estimate.

All of it is kept as one Gram matrix of [J G F r]; F are the errors of form.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from copy import copy

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tolerance_classes import part_classes
from truepose.identification.fit.turn import seen_directions
from truepose.identification.posterior.spike_slab import UNSEEN
from truepose.identification.prediction.predictor import BLOCK
from truepose.identification.prediction.sensor_rows import Block
from truepose.identification.signatures.linearisation import Forms, Linearisation
from truepose.identification.signatures.row_columns import Point, RowColumns, Sums, parted, series_ports
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.placed import EffectAtPlace

CHUNK = 32 * BLOCK
"""Rows that are summed up before the next ones."""


class Signatures(RowColumns):
    """Columns of all candidates at one machine, and what their sums over rows are at a fit."""

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

    def _summed(self, fit: Estimate, forms: Forms, rows: Index, order: Index | None = None) -> Sums:
        """Return ``sums`` of fitted rows (k,), a chunk after the other: memory stays flat."""
        step = CHUNK if self.by_row else max(len(rows), 1)
        grams: tuple[Array, ...] = ()
        for start in range(0, max(len(rows), 1), step):
            more, further = self.sums(self._point(fit), forms, rows[start : start + step], order)
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
        forms = self._forms(fit)
        return self._linearised(fit, forms, *self._summed(fit, forms, np.flatnonzero(fit.used), order))

    def halved(self, fit: Estimate) -> tuple[Linearisation, tuple[Linearisation, Linearisation]]:
        """Of all fitted rows, and of each half of them in the order of acquisition, in one pass; errors of form are those of
        all."""
        forms = self._forms(fit)
        split = np.array_split(self.recording.in_time(fit.used), 2)
        parts = [self._summed(fit, forms, np.sort(rows)) for rows in split]
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

    def _linearised(
        self, fit: Estimate, forms: Forms, grams: tuple[Array, ...], counts: list[int]
    ) -> Linearisation:
        geometry, prior = self._point(fit).free, fit.prior
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

    def _causes(self, fit: Estimate) -> list[dict[int, Array]]:
        """What the fit's effects blame: of each, its candidates with their coefficients in units of scale."""
        labels = {c.label: k for k, c in enumerate(self.candidates)}
        out = defaultdict[EffectAtPlace, dict[int, Array]](dict)
        for effect in fit.fitted_effects():
            amplitudes = np.array(effect.amplitudes) / [c.scale for c in effect.coefficients]
            turn = self.turns[labels[effect.label]]
            out[effect.at_place][labels[effect.label]] = amplitudes if turn is None else turn.T @ amplitudes
        return list(out.values())

    def indices(self, chosen: Sequence[int]) -> list[int]:
        """Columns of G of the chosen candidates."""
        return [k for i in chosen for k in range(self.columns[i].start, self.columns[i].stop)]

    def _point(self, fit: Estimate) -> Point:
        """Where columns are drawn: at a fit, of its free parameters without effect coefficients."""
        free = fit.prior.free
        return Point.of(fit, free[free < len(self.machine.parameters)])

    def blocks(self, fit: Estimate) -> Iterator[Array]:
        """Blocks (k, free + width + 1) of rows of [J G r] of the fitted readings."""
        for block in self.stacked(self._point(fit), Forms.none(), None):
            yield block.reshape(-1, block.shape[2])

    def rows(self, fit: Estimate) -> Iterator[tuple[slice, Block, Array]]:
        """Row ranges with their block and signatures (n, m, width)."""
        yield from self.blocks_of(self._point(fit), None)
