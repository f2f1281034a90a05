"""What geometry, bound by its tolerances, can make of a change of readings: how the examiner measures sizes.

With D a whitened change of the fitted readings and J the geometry's derivative in tolerances,
    min over t of |D - J t|^2 + |t|^2  =  D' V^-1 D,    V = I + J J'
is what is left to be seen of it. The root is the signal-to-noise ratio by which sizes are stated.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from truepose.challenge.simulator.base import Specimen
from truepose.identification.diagnosis.candidates import Catalogue, catalogue
from truepose.identification.diagnosis.signatures import Signatures
from truepose.identification.fit.estimate import FREE_WIDENING, Estimate, estimate
from truepose.identification.fit.widening import FRAME
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine import Machine

Array = NDArray[np.float64]


def with_observations(recording: Recording, observed: Array) -> Recording:
    """The same rows with other readings (n, k), mm and rad, in the order of the recording's columns."""
    columns = {name: observed[:, k].copy() for k, name in enumerate(recording.observations)}
    return replace(recording, observations=columns)


@dataclass(frozen=True)
class Signature:
    """A catalogue candidate: index in the catalogue, columns (N, c) whitened, a coefficient's prior 1-sigma in its scale
    (one for all or (c,))."""

    index: int
    columns: Array
    spread: float | Array
    bounds: tuple[tuple[float, float], ...]
    """Physical bounds of each coefficient, in its scale."""


class Adaptation:
    """A machine at the specimen's true constants over a campaign; ``clean`` (n, k) are its exact readings without
    imperfection. Everything is linear from there on."""

    def __init__(
        self,
        machine: Machine,
        recording: Recording,
        clean: Array,
        specimen: Specimen,
        *,
        library: bool = True,
    ) -> None:
        exact = with_observations(recording, clean)
        self.machine, self.recording = machine, exact
        self._predictor = Predictor(machine, exact)
        start = self._predictor.model.p_home.copy()
        for k, name in enumerate(self._predictor.model.names):
            start[k] = specimen.parameters.get(name, start[k])
        fit = estimate(machine, exact, start=start, predictor=self._predictor, tolerance=np.inf)
        # the truth itself, not what tolerances make of it
        self.fit: Estimate = replace(fit, p=start, x=self._predictor.assemble(start)[0])
        self.catalogue: Catalogue = catalogue(machine, exact)
        self._clean = self._residual(clean)

    @property
    def weight(self) -> Array:
        """(f,) what a step of each free parameter costs; 0 without a tolerance."""
        return self.fit.prior_weight

    @cached_property
    def _rows(self) -> Array:
        signatures = Signatures(self.machine, self.recording, self.catalogue.candidates)
        return np.concatenate(list(signatures.blocks(self.fit)))

    @property
    def jacobian(self) -> Array:
        """(N, f) whitened readings by the free parameters' steps."""
        return self._rows[:, : len(self.weight)]

    @cached_property
    def signatures(self) -> tuple[Signature, ...]:
        """Every candidate of the catalogue that is a named effect."""
        out, at = [], len(self.weight)
        for index, placed in enumerate(self.catalogue.candidates):
            size = len(placed.coefficients)
            bounds = tuple((c.lower / c.scale, c.upper / c.scale) for c in placed.coefficients)
            if self.catalogue.named(index):
                out.append(Signature(index, self._rows[:, at : at + size], placed.spread, bounds))
            at += size
        return tuple(out)

    def change(self, observed: Array) -> Array:
        """(N,) whitened change of the fitted readings (n, k) since the clean ones."""
        return self._clean - self._residual(observed)

    def left(self, changes: Array, beside: Sequence[Array] = ()) -> Array:
        """(N + f, c) what of the changes (N, c) neither geometry nor the directions ``beside`` (N,), at any size, follow."""
        along, basis = self._basis(beside)
        stacked = np.vstack([changes, np.zeros((len(along) - len(changes), changes.shape[1]))])
        out: Array = stacked - basis @ (basis.T @ stacked)
        return out

    def snr(self, change: Array, beside: Sequence[Array] = ()) -> float:
        """Signal-to-noise ratio of a change (N,) when geometry adapts within tolerances, and ``beside`` (N,) freely."""
        return float(np.linalg.norm(self.left(change[:, None], beside)))

    def misfit_when_free(self, change: Array) -> float:
        """chi2 per degree of freedom to expect of the ordinary free fit to a change (N,), to first order."""
        free = self.fit.prior.free
        frame = np.array([self.fit.prior.parts[k] == FRAME for k in free], dtype=bool)
        loose = np.where(frame, self.weight, self.weight / FREE_WIDENING)
        stacked = np.vstack([self.jacobian, np.diag(loose)])
        target = np.append(change, np.zeros(len(loose)))
        step = np.linalg.lstsq(stacked, target, rcond=1e-12)[0]
        missed = float(np.sum((target - stacked @ step) ** 2))
        return 1.0 + missed / max(len(change) - len(loose), 1)

    def _basis(self, beside: Sequence[Array]) -> tuple[Array, Array]:
        """The columns that adapt, and an orthonormal basis of their span."""
        stacked = np.vstack([self.jacobian, np.diag(self.weight)])
        if beside:
            other = np.column_stack(beside)
            stacked = np.hstack([stacked, np.vstack([other, np.zeros((len(self.weight), other.shape[1]))])])
        norms = np.linalg.norm(stacked, axis=0)
        left, values, _ = np.linalg.svd(stacked / np.where(norms > 0, norms, 1.0), full_matrices=False)
        return stacked, left[:, values > 1e-11 * values[0]]

    def _residual(self, observed: Array) -> Array:
        other = copy.copy(self._predictor)
        other.recording = with_observations(self.recording, observed)
        fit = self.fit
        blocks = [b.residual for b in other.blocks(fit.p, fit.x, fit.used)]
        return np.concatenate(blocks)[fit.used].ravel()


__all__ = ["Adaptation", "Signature", "with_observations"]
