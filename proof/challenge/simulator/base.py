"""What an examination asks of a simulated machine: its drawing, a true specimen, a campaign, exact readings.

mm, rad, N, kg, K, s throughout; files are written in mm and deg.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Place = tuple[str, ...]
Answer = tuple[str, Place]
"""A name as a diagnosis gives it: slug of the interface, place."""


@dataclass(frozen=True)
class Imperfection:
    """One thing that the drawing leaves out. ``size`` scales it (0: none); ``shape`` holds phases, lags, thresholds."""

    kind: str
    place: Place
    size: float
    shape: Mapping[str, float] = field(default_factory=dict)

    def scaled(self, factor: float) -> Imperfection:
        """The same, ``factor`` times as large."""
        return replace(self, size=self.size * factor)


@dataclass(frozen=True)
class Kind:
    """A sort of imperfection that a machine can have.

    typical: a size that a shop would call usual (``Imperfection.size`` is in the same unit).
    needs: columns of the recording (``temperature.leg1``, ``approach.q2``, ``payload``) without which no one could tell.
    in_library: whether the interface has a slug for it; ``slug`` is that one, else empty.
    conceals: whether geometry swallows most of it, so that the ordinary fit looks good.
    """

    name: str
    places: tuple[Place, ...]
    typical: float
    slug: str = ""
    needs: tuple[str, ...] = ()
    conceals: bool = False

    @property
    def in_library(self) -> bool:
        """Whether the interface has a slug for it."""
        return bool(self.slug)


@dataclass(frozen=True)
class Campaign:
    """What was done and logged, one entry a row, in the order of acquisition.

    q (n, nq): readings in mm and rad; pose (n,): same number = a repeat; approach (n, nq): +1 or -1, the side from
    which each joint arrived (the joint truly overshoots, whatever the order of rows says); session (n,);
    temperatures: degC of each logged place; pressure hPa; payload kg; validation (n,): rows not to be fitted;
    origin (n,): row that a change of length counts from (own row: none), for sensors that read changes.
    velocity (n, nq): mm/s and rad/s of the joints while the row was read, None for rows measured at rest.
    dwell (n,): s that the machine had stood still before the reading (None: 2 s everywhere); not written.
    """

    q: Array
    time: Array
    pose: NDArray[np.int64]
    approach: Array
    session: NDArray[np.int64]
    payload: Array
    temperatures: Mapping[str, Array]
    pressure: Array
    validation: NDArray[np.bool_]
    origin: NDArray[np.int64]
    velocity: Array | None = None
    dwell: Array | None = None

    def __len__(self) -> int:
        return len(self.q)


@dataclass(frozen=True)
class Plan:
    """What an experimenter varies; what is not varied stays at its nominal value.

    poses, repeats: how many different poses and how often each is visited. Flags say whether repeats come from both
    sides, the payload is changed, the room and parts warm up, there are two sessions. ``extreme`` poses lie at the
    ends of the ranges, and loads and temperatures beyond those of other plans: for hold-outs that extrapolate (all
    rows are validation then). held_out: share of the poses whose rows are marked validation. ``moving``: rows are
    read on the move and velocities logged.
    """

    poses: int = 40
    repeats: int = 2
    both_sides: bool = True
    loads: bool = True
    heat: bool = True
    sessions: int = 1
    extreme: bool = False
    held_out: float = 0.2
    moving: bool = False


@dataclass(frozen=True)
class Specimen:
    """One machine as built: true values of the tool's own parameter names (``leg1.a.x``; mm, rad), and what else the
    simulator drew (opaque to others)."""

    parameters: Mapping[str, float]
    hidden: Mapping[str, float] = field(default_factory=dict)


class SimulatedMachine(ABC):
    """A machine with its instrument. Deterministic: all randomness comes from the generators given."""

    name: ClassVar[str]
    readings: ClassVar[tuple[str, ...]]
    """Joint columns."""
    revolute: ClassVar[tuple[bool, ...]]
    """Which joints are angles (deg in files)."""
    columns: ClassVar[tuple[str, ...]]
    """Sensor columns."""
    column_units: ClassVar[tuple[str, ...]]
    """mm or rad, of each sensor column (rad is written as deg)."""

    @abstractmethod
    def machine_text(self, *, sigma_factor: float = 1.0, tolerance_factor: float = 1.0) -> str:
        """The drawing as a machine file (YAML) of the interface; factors misstate sigma and tolerances."""

    @abstractmethod
    def kinds(self) -> tuple[Kind, ...]:
        """What this machine can have."""

    @abstractmethod
    def shape(self, kind: str, place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        """Phases, lags and thresholds of a kind at a place, drawn."""

    @abstractmethod
    def specimen(self, rng: np.random.Generator, *, scale: float = 1.0) -> Specimen:
        """A machine as built: nominal + N(0, (scale * tolerance)^2) on every toleranced parameter, frames included."""

    @abstractmethod
    def campaign(self, plan: Plan, rng: np.random.Generator) -> Campaign:
        """Poses, order, sides, loads and temperatures of a measurement."""

    @abstractmethod
    def measure(
        self, specimen: Specimen, imperfections: tuple[Imperfection, ...], campaign: Campaign
    ) -> Array:
        """(n, n_columns) exact readings, mm and rad, without noise. Raises ValueError for a kind or place unknown here."""

    @abstractmethod
    def noisy(
        self, exact: Array, campaign: Campaign, rng: np.random.Generator, *, factor: float = 1.0
    ) -> Array:
        """(n, n_columns) exact readings with the instrument's noise, ``factor`` times the drawing's sigma."""
