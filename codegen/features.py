"""What the generated C offers: everything by default, or what a list names.

A list also asks for small code: what is not the way from a nearby guess is compiled for size on controllers, and what
nothing calls is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from truepose.errors import InputError
from truepose.wording import joined, meant

FEATURES: Final[Mapping[str, str]] = {
    "warm": "fk, jac, ik from a nearby guess, compensate; always there",
    "cold": "ik goes on from other starts where the guess does not lead to the pose",
    "branches": "ik_all: every solution of an open chain of six readings",
    "p": "parameters at run time; without it the calibrated ones are built in, and p must be NULL",
    "batch": "NAME_batch.c: many poses a call",
    "state": "NAME_state.c: drivers that remember (direction of motion, lagged heat), worked out in every control cycle",
}
"""Names and what they stand for."""


@dataclass(frozen=True)
class Features:
    """``listed``: whether someone asked for these and for nothing else; the others are those of ``FEATURES``."""

    cold: bool = True
    branches: bool = True
    p: bool = True
    batch: bool = True
    state: bool = True
    listed: bool = False

    @classmethod
    def of(cls, text: str) -> Features:
        """Features of a list, separated by commas. Raises InputError that lists what exists."""
        names = [name.strip() for name in text.split(",")]
        unknown = [name for name in names if name not in FEATURES]
        if unknown:
            hint = meant(unknown[0], FEATURES)
            raise InputError(
                f"features: found {unknown[0]!r}, expected one or several of {joined(FEATURES)}, separated by commas"
                + (f"; {hint}" if hint else "")
            )
        chosen = {name: name in names for name in FEATURES if name != "warm"}
        return cls(**chosen, listed=True)

    @property
    def names(self) -> tuple[str, ...]:
        """Those that are on, in the order of ``FEATURES``."""
        return tuple(name for name in FEATURES if name == "warm" or getattr(self, name))


ALL: Final = Features()
