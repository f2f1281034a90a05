"""Machines whose physics shifts named values row by row: parameters, error motions, joint displacements.

A ``Work`` holds what each row of a campaign has: every parameter of the drawing as built, (n,), what is added to each
joint, and what the instrument sees. Each sort of imperfection (``Physics``) adds to it, in stages: before the
mechanism is assembled, under loads (repeated until pose and loads agree), in the instrument, in the written rows.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any

import numpy as np
import yaml

from .base import Array, Campaign, Imperfection, Kind, Place, Plan, SimulatedMachine, Specimen
from .campaigns import Setting, draw

SETTLED, ROUNDS = 1e-13, 60
"""mm and rad: where poses and loads agree; most rounds to get there."""


class Stage(IntEnum):
    """When an imperfection acts."""

    GEOMETRY = 0
    LOADS = 1
    INSTRUMENT = 2
    ROWS = 3


@dataclass
class Work:
    """One campaign in the making. ``values``: (n,) by name; ``moved`` (n, nq): added to joint displacements;
    ``solved``: the machine's own solution; ``seen`` (n, k): what its instrument sees."""

    campaign: Campaign
    values: dict[str, Array]
    moved: Array
    solved: Any = None
    seen: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __len__(self) -> int:
        return len(self.campaign)

    def value(self, name: str) -> Array:
        """(n,) value of a parameter or error motion; 0 where nothing is known of it."""
        return self.values.get(name, np.zeros(len(self)))

    def stacked(self, names: tuple[str, ...]) -> Array:
        """(n, k) values of k names, as `value` gives them."""
        return np.stack([self.value(name) for name in names], axis=-1)

    def add(self, name: str, change: Array | float) -> None:
        """Add a change (n,), or one number in all rows, to a value."""
        self.values[name] = self.value(name) + change

    def copy(self) -> Work:
        """The same, apart."""
        return replace(self, values=dict(self.values), moved=self.moved.copy(), seen=self.seen.copy())


Act = Callable[[Work, Imperfection], None]
Draw = Callable[[Place, np.random.Generator], Mapping[str, float]]


def shapeless(_place: Place, _rng: np.random.Generator) -> Mapping[str, float]:
    """No phases, lags or thresholds."""
    return {}


@dataclass(frozen=True)
class Physics:
    """A kind with what it does, when, and how its shape is drawn."""

    kind: Kind
    act: Act
    shape: Draw = shapeless
    stage: Stage = Stage.GEOMETRY


@dataclass(frozen=True)
class Drawn:
    """A parameter on the drawing: nominal and 1-sigma tolerance, mm and rad."""

    nominal: float
    tolerance: float = 0.0


class PortedMachine(SimulatedMachine):
    """A simulated machine made of a drawing, physics and an instrument."""

    @property
    @abstractmethod
    def drawing(self) -> Mapping[str, Drawn]:
        """Every parameter by the tool's own name."""

    @property
    @abstractmethod
    def physics(self) -> tuple[Physics, ...]:
        """What this machine can have."""

    @property
    @abstractmethod
    def setting(self) -> Setting:
        """What an experimenter can vary."""

    @property
    @abstractmethod
    def sigma(self) -> Array:
        """(n_columns,) noise of a reading, mm and rad."""

    @abstractmethod
    def document(self, sigma_factor: float, tolerance_factor: float) -> dict[str, Any]:
        """The machine file as data, mm and deg."""

    @abstractmethod
    def solve(self, work: Work) -> Any:
        """Assemble the mechanism in every row: poses, and what loads follow from."""

    @abstractmethod
    def see(self, work: Work) -> Array:
        """(n, k) what the instrument sees of the solution."""

    def told(self, seen: Array, campaign: Campaign) -> Array:
        """(n, n_columns) readings that the instrument makes of what it sees."""
        return seen

    def machine_text(self, *, sigma_factor: float = 1.0, tolerance_factor: float = 1.0) -> str:
        document = self.document(sigma_factor, tolerance_factor)
        return str(yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=120))

    def kinds(self) -> tuple[Kind, ...]:
        return tuple(physics.kind for physics in self.physics)

    def shape(self, kind: str, place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return self._physics(kind, place).shape(place, rng)

    def specimen(self, rng: np.random.Generator, *, scale: float = 1.0) -> Specimen:
        """Nominal + N(0, (scale * tolerance)^2), parameters in the order of the drawing."""
        errors = scale * rng.standard_normal(len(self.drawing))
        return Specimen(
            {
                name: drawn.nominal + float(error) * drawn.tolerance
                for (name, drawn), error in zip(self.drawing.items(), errors, strict=True)
            }
        )

    def campaign(self, plan: Plan, rng: np.random.Generator) -> Campaign:
        return draw(self.setting, plan, rng)

    def measure(
        self, specimen: Specimen, imperfections: tuple[Imperfection, ...], campaign: Campaign
    ) -> Array:
        stages: dict[Stage, list[tuple[Physics, Imperfection]]] = {stage: [] for stage in Stage}
        for imperfection in imperfections:
            physics = self._physics(imperfection.kind, imperfection.place)
            if imperfection.size != 0.0:
                stages[physics.stage].append((physics, imperfection))
        n = len(campaign)
        values = {
            name: np.full(n, specimen.parameters.get(name, d.nominal)) for name, d in self.drawing.items()
        }
        work = Work(campaign, values, np.zeros_like(campaign.q))
        _apply(stages[Stage.GEOMETRY], work)
        work = self._balanced(work, stages[Stage.LOADS])
        work.seen = self.see(work)
        _apply(stages[Stage.INSTRUMENT], work)
        work.seen = self.told(work.seen, campaign)
        _apply(stages[Stage.ROWS], work)
        return work.seen

    def noisy(
        self, exact: Array, campaign: Campaign, rng: np.random.Generator, *, factor: float = 1.0
    ) -> Array:
        return np.asarray(exact + factor * self.sigma * rng.standard_normal(exact.shape))

    def _balanced(self, work: Work, loaded: list[tuple[Physics, Imperfection]]) -> Work:
        """The work with its solution; loads are those of the loaded pose, by fixed-point steps."""
        work.solved = self.solve(work)
        if not loaded:
            return work
        before = self.see(work)
        bent = work
        for _ in range(ROUNDS):
            # all loads of a round are those of the round before
            latest, bent = bent.solved, work.copy()
            bent.solved = latest
            _apply(loaded, bent)
            bent.solved = self.solve(bent)
            now = self.see(bent)
            if np.max(np.abs(now - before)) < SETTLED * max(1.0, float(np.max(np.abs(now)))):
                return bent
            before = now
        raise ValueError(f"{self.name}: no equilibrium under these loads; are the compliances too large?")

    def _physics(self, kind: str, place: Place) -> Physics:
        for physics in self.physics:
            if physics.kind.name == kind:
                if place not in physics.kind.places:
                    raise ValueError(f"{kind}: found place {place}, expected one of {physics.kind.places}")
                return physics
        raise ValueError(f"found kind {kind!r}, expected one of {[p.kind.name for p in self.physics]}")


def _apply(acting: list[tuple[Physics, Imperfection]], work: Work) -> None:
    for physics, imperfection in acting:
        physics.act(work, imperfection)


__all__ = ["Act", "Draw", "Drawn", "Physics", "PortedMachine", "Stage", "Work", "shapeless"]
