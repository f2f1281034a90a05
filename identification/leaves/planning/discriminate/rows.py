"""Work out what the rows of an experiment would tell of the constants and of every explanation.

A row is a pose with a setting of the factors; its readings' derivatives come from the diagnosis' own signatures, on
a recording that was never made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import Solution, Status
from truepose.identification.fit.problem import prior_of
from truepose.identification.leaves.planning.information import (
    UNKNOWN,
    unmeasured,
)
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.history import line_of_full_loop
from truepose.identification.recording.recording import Recording, frozen
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect
from truepose.models.file.driver import APPROACH, OF_THE_WAY, SESSION, TIME, Driver
from truepose.models.machine.machine import Machine

WIDE = 100.0
"""Prior 1-sigma of an effect of any size, in units of its scale: as in the diagnosis."""
_COMPRESSED = 8
_RANK = 1e-14


@dataclass(frozen=True)
class Rows:
    """q (c, nq) internal units; drivers: (c,) levels by name, ``session`` and ``time`` among them."""

    q: Array
    drivers: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.q)

    def take(self, rows: Sequence[int] | Index | Mask) -> Rows:
        """Rows by number (k,) or by mask (n,)."""
        chosen = np.asarray(rows)
        return Rows(self.q[chosen], {name: values[chosen] for name, values in self.drivers.items()})


class _Steady(Recording):
    """Rows with no past but their own: temperatures are held until bodies follow, so that a lagged driver is the driver
    itself; a joint arrived by a long move, so that what its way leaves behind depends on the side alone."""

    def driver(self, name: str, sessions: Sequence[int] | None = None) -> Array | None:
        driver = Driver.of(name)
        if driver.kind not in OF_THE_WAY or driver.place not in self.joints:
            return super().driver(driver.now.name, sessions)
        side = self.drivers.get(Driver(APPROACH, driver.place).name)
        if side is None:
            return None
        half_width, *ends = driver.numbers
        lead = side * half_width
        if driver.kind == "stop":
            return np.asarray(lead)
        q = self.moved[:, self.joints.index(driver.place)]
        return np.asarray(lead - line_of_full_loop(q, half_width, *ends))


@dataclass(frozen=True)
class Signals:
    """Whitened derivatives of rows' readings: geometry (c, m, k) in prior scales with ``precision`` (k,), and
    effects (c, m, w) in scales, those of effect i in ``columns[i]``; names (k,) of the constants."""

    names: tuple[str, ...]
    geometry: Array
    effects: Array
    precision: Array
    columns: tuple[slice, ...]

    def take(self, rows: Mask | Index) -> Signals:
        """Of rows by number (k,) or by mask (n,)."""
        return replace(self, geometry=self.geometry[rows], effects=self.effects[rows])

    @property
    def gram(self) -> Array:
        """(k + w, k + w) Gram matrix of [geometry effects] over all rows."""
        stacked = np.concatenate([self.geometry, self.effects], axis=2)
        stacked = stacked.reshape(-1, stacked.shape[2])
        return np.asarray(stacked.T @ stacked)


def signals(machine: Machine, recording: Recording, parts: Sequence[PlacedEffect]) -> Signals:
    """What rows would tell at the drawing values, noise as stated; rows of role validation and such that cannot be
    assembled tell nothing.

    Effects of the file at the place and with the driver of a part are further explanations of the same: they are left out, but
    for terms (harmonics) that stand beside those of a part.
    """
    machine = machine.with_effects(tuple(e for e in machine.effects if not _rivals(e, parts)))
    fit, read = _at_drawing(machine, recording)
    free = fit.prior.free
    geometry, shifts = [], []
    for rows, block, signature in Signatures(machine, read, parts).rows(fit):
        used = fit.used[rows, None, None]
        whole = np.concatenate([block.jacobian[:, :, free] * fit.prior.scale[free], signature], axis=2)
        whole = _compressed(np.where(used, whole, 0.0))
        geometry.append(whole[:, :, : len(free)])
        shifts.append(whole[:, :, len(free) :])
    ends = np.cumsum([0, *(len(part.coefficients) for part in parts)])
    weight = np.maximum(fit.prior_weight, 1.0 / UNKNOWN)
    return Signals(
        names=tuple(fit.prior.names[k] for k in free),
        geometry=_stacked(geometry),
        effects=_stacked(shifts),
        precision=weight**2,
        columns=tuple(slice(int(a), int(b)) for a, b in pairwise(ends)),
    )


def _rivals(effect: PlacedEffect, parts: Sequence[PlacedEffect]) -> bool:
    """Whether an effect of the file explains what one of the parts explains, and does not act together with it."""
    alike = [part for part in parts if (part.place, part.kind) == (effect.place, effect.kind)]
    further = effect.effect.adds(effect.settings_map) and effect.at_place in {p.at_place for p in alike}
    return effect.label in {part.label for part in parts} or (bool(alike) and not further)


def recording_of(machine: Machine, rows: Rows, reference: Array) -> Recording:
    """Rows as a recording without readings, after one row at the ``reference`` pose (nq,), which changes count from."""
    q = np.concatenate([reference[None], rows.q])
    n = len(q)
    drivers = {name: np.concatenate([values[:1], values]) for name, values in rows.drivers.items()}
    session = drivers.pop(SESSION, np.ones(n)).astype(np.int64)
    time = drivers.pop(TIME, None)
    return unmeasured(
        machine,
        q,
        "planned rows",
        _Steady,
        drivers={name: frozen(values) for name, values in drivers.items()},
        session=frozen(session),
        session_recorded=frozen(np.ones(n, dtype=bool)),
        time=None if time is None else frozen(time),
        from_row=frozen(np.zeros(n, dtype=np.int64)),
    )


def _at_drawing(machine: Machine, recording: Recording) -> tuple[Estimate, Recording]:
    """The machine as the file has it in place of a fit, and the rows as it would read them."""
    predictor = Predictor(machine, recording, machine.effects)
    prior, p = prior_of(machine, machine.effects), predictor.model.p_home
    x, good = predictor.assemble(p)
    names, values, _ = predictor.values(p, x)
    exact = {name: frozen(values[:, k].copy()) for k, name in enumerate(names)}
    nothing = np.zeros(len(prior.free))
    return Estimate(
        nominal=machine,
        recording=recording,
        effects=machine.effects,
        prior=prior,
        p=p,
        x=x,
        residual=np.zeros((len(x), len(predictor.channels))),
        used=good & ~recording.validation,
        weights=np.ones(len(x)),
        factor=np.zeros((0, len(nothing) + 1)),
        solution=Solution(nothing, np.zeros((0, 0)), 0.0, Status.CONVERGED, 0, 0.0, nothing),
        unassembled=tuple(int(k) for k in np.flatnonzero(~good)),
    ), replace(recording, observations=exact)


def _compressed(rows: Array) -> Array:
    """(c, r, k) with as few readings a row as hold the same information: a mirror's twelve points say six things."""
    if rows.shape[1] <= _COMPRESSED:
        return rows
    values, vectors = np.linalg.eigh(rows @ rows.transpose(0, 2, 1))
    rank = max(1, int(np.max(np.sum(values > _RANK * np.max(values, initial=0.0), axis=1))))
    out: Array = vectors[:, :, -rank:].transpose(0, 2, 1) @ rows
    return out


def _stacked(parts: Sequence[Array]) -> Array:
    """Blocks of rows end to end; one that needs fewer readings is filled up with zeros."""
    most = max(part.shape[1] for part in parts)
    return np.concatenate([np.pad(p, ((0, 0), (most - p.shape[1], 0), (0, 0))) for p in parts])


ROWS, LEAST_POSES = 2400, 120
"""Rows to choose from; poses among them at least."""
