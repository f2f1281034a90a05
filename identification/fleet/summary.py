"""Sums over machines that add: a fleet's statistics need nothing else, however large it is.

Every entry is a whole number (log likelihoods and moments in units of 2^-20), so that sums are exact: any order of machines,
any grouping into shards, and taking a machine out again give the very same summary.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Whole = NDArray[np.int64]
SCHEMA = "truepose/fleet-summary/1"


@dataclass(frozen=True)
class Summary:
    """machines: how many; sums: whole numbers (k,) by what they are sums of."""

    machines: int
    sums: Mapping[str, Whole]

    @classmethod
    def empty(cls) -> Summary:
        """Of no machine."""
        return cls(0, {})

    @classmethod
    def of(cls, kept: Mapping[str, Any]) -> Summary:
        """Of one machine, from what ``truepose.identification.fleet.evidence.kept`` keeps of it."""
        raise NotImplementedError

    def __add__(self, other: Summary) -> Summary:
        """Of the machines of both."""
        raise NotImplementedError

    def __sub__(self, other: Summary) -> Summary:
        """Without machines that are part of this one."""
        raise NotImplementedError

    def to_json(self) -> dict[str, Any]:
        """For a file: texts and whole numbers."""
        raise NotImplementedError

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Summary:
        """What ``to_json`` gave. Raises InputError for anything else."""
        raise NotImplementedError
