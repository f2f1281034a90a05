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
CONCEALED = 1.3
"""chi2 per degree of freedom of the free fit below which the ordinary fit looks good (interface, section 4)."""


@dataclass(frozen=True)
class Truth:
    """One imperfection: kind of the simulator, name in the interface (``effect`` empty: it has none), size beside
    its typical one and its detection limit, signal-to-noise ratio, names that the data cannot tell from it, and the chi2 of
    it (of ``snr`` squared) that the catalogue's best single form there cannot reproduce (None: it has none).

    snr_beside: the ratio when everything else that is wrong may have any size. family: the kind that was drawn at all its
    places at once, empty for a single."""

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
    snr_beside: float | None = None
    family: str = ""

    @property
    def factor(self) -> float:
        """Size in detection limits."""
        return abs(self.size) / self.limit if self.limit > 0 else 0.0

    @property
    def factor_beside(self) -> float:
        """The same when everything else that is wrong may have any size."""
        return (
            self.factor
            if self.snr_beside is None or not self.snr
            else self.factor * self.snr_beside / self.snr
        )


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

    aliases: names of one part (a leg and its reading) as one. concealed: whether the free fit looks good, to first order by
    the simulator's derivatives, wild rows left out; free_chi2_linear is its chi2 per degree of freedom then, and
    free_chi2_per_dof that of the product's own free fit. before: the fit without effects; oracle: the fit told the effects,
    their places and the wild rows, with the true sigma and tolerances. Each is None where it did not converge, or where the
    catalogue has no such effect. empirical: held-out error of the best model without names of 0, 1, 2 ... columns.
    noise, tolerance_scale: true over stated sigma and tolerances. wild: numbers of the rows that are off, from 1; rows: of
    all that may be fitted. tool: where the sensor reads points, what a perfect instrument would read on the held-out rows.
    """

    case: str
    machine: str
    stratum: str
    variant: str
    truths: tuple[Truth, ...]
    concealed: bool
    free_chi2_per_dof: float | None
    aliases: Mapping[str, str]
    geometry: Geometry
    held_out: HeldOut
    before: Reference | None
    oracle: Reference | None
    noise: float = 1.0
    tolerance_scale: float = 1.0
    free_chi2_linear: float | None = None
    empirical: tuple[float, ...] = ()
    wild: tuple[int, ...] = ()
    rows: tuple[int, ...] = ()
    missing: tuple[str, ...] = ()
    simulator: str = ""
    tool: Table | None = None


_ADAPTER = TypeAdapter(Solution)


def to_text(solution: Solution) -> str:
    """As JSON."""
    return _ADAPTER.dump_json(solution, indent=1).decode() + "\n"


def from_file(path: Path) -> Solution:
    """Read back what ``to_text`` made."""
    return _ADAPTER.validate_json(path.read_bytes())


__all__ = [
    "CONCEALED",
    "Geometry",
    "HeldOut",
    "Names",
    "Reference",
    "Solution",
    "Truth",
    "from_file",
    "to_text",
]
