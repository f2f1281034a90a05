"""Hold the rows that an experiment may choose from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.leaves.planning.discriminate.factors import (
    Factor,
    settings,
)
from truepose.identification.leaves.planning.discriminate.rows import LEAST_POSES, ROWS, Rows
from truepose.identification.leaves.planning.information import (
    PoseInformation,
    Supply,
    rounded,
)
from truepose.models.machine.machine import Machine

STEP = 1e-6
"""Joint values are rounded to about this share of their range."""


@dataclass(frozen=True)
class Pool:
    """Rows that may be taken; nominal (n,): those at which every factor has its nominal value."""

    rows: Rows
    reference: Array
    nominal: Mask

    @classmethod
    def of(
        cls, machine: Machine, varied: Sequence[Factor], candidates: Array | None, rng: np.random.Generator
    ) -> Pool:
        """From poses ``candidates`` (c, nq), or from drawn ones, crossed with the levels of all factors."""
        information = PoseInformation(machine)
        q = rng.permutation(Supply.of(information, candidates, rng).poses.q)
        q = q if candidates is not None else rounded(q, machine, STEP)
        every = settings(varied, rng)
        q = q[: max(LEAST_POSES, ROWS // len(every))]
        levels = np.tile(every, (len(q), 1)).T
        drivers = {factor.driver: own for factor, own in zip(varied, levels, strict=True)}
        rows = Rows(np.repeat(q, len(every), axis=0), drivers)
        still = [rows.drivers[factor.driver] == factor.nominal for factor in varied]
        return cls(rows, information.home, np.logical_and.reduce([np.ones(len(rows), dtype=bool), *still]))
