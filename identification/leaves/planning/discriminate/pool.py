"""The rows that an experiment may choose from, and which of them hold a kind of factor still or vary it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.leaves.planning.discriminate.factors import Factor, settings
from truepose.identification.leaves.planning.discriminate.rows import Rows
from truepose.identification.leaves.planning.information import PoseInformation
from truepose.identification.leaves.planning.rounding import rounded
from truepose.identification.leaves.planning.supply import Supply
from truepose.models.file.driver import Driver
from truepose.models.machine.machine import Machine

ROWS, LEAST_POSES, MORE_POSES = 2400, 120, 120
"""Rows to choose from; poses among them at least; poses at which a factor that was not offered is tried."""
STEP = 1e-6
"""Joint values are rounded to about this share of their range."""


@dataclass(frozen=True)
class Pool:
    """Rows that may be taken. main: those that are offered; beyond: further rows by kind of factor not offered;
    still: rows by kind of factor that is offered, at its nominal value."""

    rows: Rows
    reference: Array
    main: Mask
    beyond: dict[str, Mask]
    still: dict[str, Mask]

    @classmethod
    def of(
        cls, machine: Machine, varied: Sequence[Factor], candidates: Array | None, rng: np.random.Generator
    ) -> Pool:
        """From poses ``candidates`` (c, nq), or from drawn ones, crossed with the levels of all factors."""
        information = PoseInformation(machine)
        q = rng.permutation(Supply.of(information, candidates, rng).poses.q)
        q = q if candidates is not None else rounded(q, machine, STEP)
        names = [factor.driver for factor in varied]
        every = _levels(varied, {f.driver for f in varied if f.offered}, rng)
        q = q[: max(LEAST_POSES, ROWS // len(every))]
        rows, beyond = Rows.crossed(q, names, every), {}
        sizes = [len(rows)]
        for kind in _kinds(f for f in varied if not f.offered):
            inside = {f.driver for f in varied if f.offered or kind_of(f) == kind}
            more = Rows.crossed(q[:MORE_POSES], names, _levels(varied, inside, rng))
            rows = rows.joined(more)
            sizes.append(len(more))
            beyond[kind] = np.zeros(0, dtype=bool)
        part = np.repeat(np.arange(len(sizes)), sizes)
        main = part == 0
        beyond = {kind: main | (part == k) for k, kind in enumerate(beyond, start=1)}
        still = {
            kind: main
            & np.all([rows.drivers[f.driver] == f.nominal for f in varied if kind_of(f) == kind], axis=0)
            for kind in _kinds(f for f in varied if f.offered)
        }
        return cls(rows, information.home, main, beyond, still)

    def nominal(self) -> Mask:
        """(n,) rows at which every factor that is offered has its nominal value."""
        return np.asarray(np.logical_and.reduce([self.main, *self.still.values()]))


def kind_of(factor: Factor) -> str:
    """``approach`` of ``approach.q2``: factors of a kind are held, or varied, together."""
    return Driver.of(factor.driver).kind


def _kinds(some: Iterable[Factor]) -> list[str]:
    return list(dict.fromkeys(kind_of(f) for f in some))


def _levels(varied: Sequence[Factor], free: set[str], rng: np.random.Generator) -> Array:
    """(s, f) settings when only some drivers may move."""
    held = [f if f.driver in free else replace(f, levels=(f.nominal,)) for f in varied]
    return settings(held, rng)
