"""The key of a case: what was put in, what cannot be told from it, and what there is to compare with.

Lengths mm, angles rad. Written apart from the case, which the engine alone sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import TypeAdapter

Names = tuple[str, tuple[str, ...]]
"""Slug of an effect, place."""
Table = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Truth:
    """One imperfection: kind of the simulator, name in the interface (``effect`` empty: it has none), size beside
    its typical one and its detection limit, signal-to-noise ratio, names that the data cannot tell from it, and the chi2 of
    it (of ``snr`` squared) that the catalogue's best single form there cannot reproduce (None: it has none)."""

    kind: str
    effect: str
    place: tuple[str, ...]
    size: float
    typical: float
    limit: float
    snr: float
    shape: Mapping[str, float] = field(default_factory=dict)
    equivalents: tuple[Names, ...] = ()
    misfit: float | None = None

    @property
    def factor(self) -> float:
        """Size in detection limits."""
        return abs(self.size) / self.limit if self.limit > 0 else 0.0


@dataclass(frozen=True)
class Geometry:
    """True constants with their tolerances, and the (k, n) orthonormal combinations of them, in tolerances, that the
    readings determine better than the drawing."""

    names: tuple[str, ...]
    truth: tuple[float, ...]
    tolerance: tuple[float, ...]
    combinations: Table


@dataclass(frozen=True)
class HeldOut:
    """Noise-free readings of the held-out rows (rows, columns) with unit (mm, rad) and 1-sigma of each column."""

    columns: tuple[str, ...]
    units: tuple[str, ...]
    sigma: tuple[float, ...]
    truth: Table


@dataclass(frozen=True)
class Reference:
    """What a fit reaches: held-out error in sigma, rms error of the identifiable combinations in tolerances."""

    held_out: float | None
    bias: float | None
    effects: tuple[str, ...] = ()


@dataclass(frozen=True)
class Solution:
    """Everything that the scorer knows of a case.

    aliases: names of one part (a leg and its reading) as one. before: the fit without effects; oracle: the fit told
    the effects and their places, None outside the library.
    """

    case: str
    machine: str
    stratum: str
    variant: str
    truths: tuple[Truth, ...]
    concealed: bool
    free_chi2_per_dof: float
    aliases: Mapping[str, str]
    geometry: Geometry
    held_out: HeldOut
    before: Reference
    oracle: Reference | None
    noise: float = 1.0
    tolerance_scale: float = 1.0


_ADAPTER = TypeAdapter(Solution)


def to_text(solution: Solution) -> str:
    """As JSON."""
    return _ADAPTER.dump_json(solution, indent=1).decode() + "\n"


def from_file(path: Path) -> Solution:
    """Read back what ``to_text`` made."""
    return _ADAPTER.validate_json(path.read_bytes())


__all__ = ["Geometry", "HeldOut", "Names", "Reference", "Solution", "Truth", "from_file", "to_text"]
