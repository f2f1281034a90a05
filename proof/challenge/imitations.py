"""The catalogue's candidates over a campaign, linear about the specimen: what explanations a diagnosis could give.

This alone takes the product's own model: what it can say is its business, how large a thing is is not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from challenge.adaptation import Adaptation
from challenge.simulator.base import Specimen
from truepose.identification.fit.estimate import estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.signatures import Point, Signatures
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
SHORT, TERMS = 6, 12
"""Coefficients of a term, and of several, up to which terms are weighed together: more would fit anything."""


@dataclass(frozen=True)
class Signature:
    """A catalogue candidate: index in the catalogue, columns (N, c) whitened, a coefficient's prior 1-sigma in its scale
    (one for all or (c,))."""

    index: int
    columns: Array
    spread: float | Array
    bounds: tuple[tuple[float, float], ...]
    """Physical bounds of each coefficient, in its scale."""


class Imitations:
    """Every explanation of the catalogue for a machine as drawn, measured exactly (``recording``), at the specimen's
    true constants; ``bench`` says what geometry follows. Raises TrueposeError where the product's model does not hold."""

    def __init__(self, machine: Machine, recording: Recording, specimen: Specimen, bench: Adaptation) -> None:
        self.bench, self.catalogue = bench, catalogue(machine, recording)
        predictor = Predictor(machine, recording)
        start = predictor.model.p_home.copy()
        for k, name in enumerate(predictor.model.names):
            start[k] = specimen.parameters.get(name, start[k])
        fit = estimate(machine, recording, start=start, predictor=predictor, tolerance=np.inf)
        # the truth itself, not what tolerances make of it
        self.fit = replace(fit, p=start, x=predictor.assemble(start)[0])
        self._machine, self._recording = machine, recording

    @cached_property
    def signatures(self) -> tuple[Signature, ...]:
        """Every candidate that is a named effect; terms of one effect at one place that add up also together."""
        drawn = Signatures(self._machine, self._recording, self.catalogue.candidates)
        free = self.fit.prior.free
        at_fit = Point.of(self.fit, free[free < len(self._machine.parameters)])
        blocks = drawn.stacked(at_fit, None)
        rows = np.concatenate([block.reshape(-1, block.shape[2]) for block in blocks])
        out, at = [], len(self.fit.prior_weight)
        for index, placed in enumerate(self.catalogue.candidates):
            size = len(placed.coefficients)
            bounds = tuple((c.lower / c.scale, c.upper / c.scale) for c in placed.coefficients)
            if self.catalogue.named(index):
                out.append(Signature(index, rows[:, at : at + size], placed.spread, bounds))
            at += size
        return (*out, *self._together(out))

    @cached_property
    def left(self) -> Array:
        """(N + f, c) what geometry leaves of all signatures side by side."""
        if not self.signatures:
            return np.zeros((0, 0))
        return self.bench.bound(np.hstack([s.columns for s in self.signatures]))

    def name(self, signature: Signature) -> tuple[str, tuple[str, ...]]:
        """Slug and place of a candidate."""
        placed = self.catalogue.candidates[signature.index]
        return placed.effect.slug, placed.place

    def _together(self, alone: list[Signature]) -> list[Signature]:
        """Short terms of one effect at one place, where they add up, as one signature."""
        terms: dict[tuple[str, tuple[str, ...]], list[Signature]] = {}
        for signature in alone:
            adds = self.catalogue.candidates[signature.index].effect.settings_add
            if adds and signature.columns.shape[1] <= SHORT:
                terms.setdefault(self.name(signature), []).append(signature)
        few = [
            own for own in terms.values() if len(own) > 1 and sum(s.columns.shape[1] for s in own) <= TERMS
        ]
        return [
            Signature(
                own[0].index,
                np.hstack([s.columns for s in own]),
                np.concatenate([np.broadcast_to(s.spread, s.columns.shape[1]) for s in own]),
                tuple(bound for s in own for bound in s.bounds),
            )
            for own in few
        ]


__all__ = ["Imitations", "Signature"]
