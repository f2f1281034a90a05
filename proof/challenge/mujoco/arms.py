"""The arms as machines of the examination: drawn, built as specimens, moved in MuJoCo and read by an instrument."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from challenge.mujoco import kinds
from challenge.mujoco.drawing import MM, Drawing, Instrument, document, drawn, heights
from challenge.mujoco.motion import Way, driven
from challenge.mujoco.packages import SOURCES, installed
from challenge.simulator.base import (
    Campaign,
    Imperfection,
    Kind,
    Place,
    Plan,
    SimulatedMachine,
    Specimen,
)
from challenge.simulator.campaigns import Setting, draw
from challenge.simulator.operators import waypoints
from truepose.errors import InputError

Array = NDArray[np.float64]
OVERSHOOT = float(np.radians(2.0))
LOWEST, NEAREST = 30.0, 200.0
"""mm: above the stand, and from the first axis; what lies below or nearer is not measured."""


class MujocoArm(SimulatedMachine):
    """An arm of a package. Subclasses say which one, with what instrument, gears and payloads."""

    arm: ClassVar[str]
    instrument: ClassVar[Instrument]
    gears: ClassVar[tuple[int, ...]]
    payloads: ClassVar[tuple[float, float, float]]
    """kg: none, usual, heaviest."""

    def __init__(self, *, straight: bool = False) -> None:
        """``straight``: poses are gone to from the last one, without an overshoot from a stated side."""
        self.straight = straight

    @cached_property
    def drawing(self) -> Drawing:
        """As the package has it."""
        return drawn(self.arm, self.instrument, self.gears)

    def machine_text(self, *, sigma_factor: float = 1.0, tolerance_factor: float = 1.0) -> str:
        data = document(self.drawing, self.name, sigma_factor, tolerance_factor)
        return str(yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=120))

    def kinds(self) -> tuple[Kind, ...]:
        return kinds.kinds(self.drawing)

    def shape(self, kind: str, place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return kinds.shape(kind, place, rng)

    def specimen(self, rng: np.random.Generator, *, scale: float = 1.0) -> Specimen:
        drawing = self.drawing.parameters
        errors = scale * rng.standard_normal(len(drawing))
        values = {
            name: d.nominal + float(e) * d.tolerance
            for (name, d), e in zip(drawing.items(), errors, strict=True)
        }
        return Specimen(values)

    def campaign(self, plan: Plan, rng: np.random.Generator) -> Campaign:
        low, high = self.drawing.ranges.T
        empty, usual, heaviest = self.payloads
        step = float(np.radians(1e-4))
        setting = Setting(low, high, (), (empty, usual), heaviest, accept=self._free, step=step)
        drawn_up = draw(setting, plan, rng)
        if not self.straight:
            return drawn_up
        moves = np.diff(drawn_up.q, axis=0, prepend=drawn_up.q[:1])
        return replace(drawn_up, approach=np.where(moves < 0, -1.0, 1.0))

    def measure(
        self, specimen: Specimen, imperfections: tuple[Imperfection, ...], campaign: Campaign
    ) -> Array:
        physics = kinds.built(self.drawing, imperfections)
        before = waypoints(campaign.q, campaign.approach, OVERSHOOT)[0::2]
        way = Way(physics.motors(campaign.q), physics.motors(before), campaign.payload)
        tool = driven(self.drawing.build(specimen.parameters), physics.yielding, way)
        tool[:, :3, 3] /= MM
        return self._seen(specimen, self.drawing.mount(specimen.parameters, "base") @ tool)

    def noisy(
        self, exact: Array, campaign: Campaign, rng: np.random.Generator, *, factor: float = 1.0
    ) -> Array:
        noise = factor * self.instrument.sigmas * rng.standard_normal(exact.shape)
        out = exact + noise
        if self.instrument.kind == "pose":
            turned = Rotation.from_rotvec(exact[:, 3:]) * Rotation.from_rotvec(noise[:, 3:])
            out[:, 3:] = turned.as_rotvec()
        return np.asarray(out)

    def _seen(self, specimen: Specimen, tool: Array) -> Array:
        """(n, n_columns) of the tool (n, 4, 4) mm in the instrument's frame."""
        if self.instrument.kind == "pose":
            return np.hstack([tool[:, :3, 3], Rotation.from_matrix(tool[:, :3, :3]).as_rotvec()])
        names = tuple(self.instrument.targets)
        if not names:
            return np.array(tool[:, :3, 3])
        points = [[self.drawing.value(specimen.parameters, f"{p}.{a}") for a in "xyz"] for p in names]
        return np.hstack([tool[:, :3, 3] + tool[:, :3, :3] @ np.array(point) for point in points])

    def _free(self, q: Array) -> bool:
        low, out = heights(self.drawing, q)
        return low > LOWEST and out > NEAREST


SIX, SEVEN = (tuple(f"q{k + 1}" for k in range(n)) for n in (6, 7))
POSITION, POSE = ("x", "y", "z"), ("x", "y", "z", "rx", "ry", "rz")
THREE = tuple(f"{target}.{a}" for target in ("P1", "P2", "P3") for a in "xyz")


class Ur5e(MujocoArm):
    """Six joints, three of them parallel."""

    name, arm, readings, revolute = "mujoco-ur5e", "ur5e", SIX, (True,) * 6
    instrument, columns, column_units = Instrument("position"), POSITION, ("mm",) * 3
    gears, payloads = (101,) * 6, (0.0, 2.5, 5.0)


class Panda(MujocoArm):
    """Seven joints, read by three targets."""

    name, arm, readings, revolute = "mujoco-panda", "panda", SEVEN, (True,) * 7
    instrument, columns, column_units = Instrument("targets"), THREE, ("mm",) * 9
    gears, payloads = (100,) * 7, (0.0, 1.5, 3.0)


class Sawyer(MujocoArm):
    """Seven joints with offsets."""

    name, arm, readings, revolute = "mujoco-sawyer", "sawyer", SEVEN, (True,) * 7
    instrument, columns, column_units = Instrument("position"), POSITION, ("mm",) * 3
    gears, payloads = (120, 120, 100, 100, 80, 80, 80), (0.0, 2.0, 4.0)


class Iiwa(MujocoArm):
    """Seven joints, its pose read."""

    name, arm, readings, revolute = "mujoco-iiwa", "iiwa", SEVEN, (True,) * 7
    instrument, columns, column_units = Instrument("pose"), POSE, ("mm",) * 3 + ("rad",) * 3
    gears, payloads = (160, 160, 160, 160, 100, 160, 160), (0.0, 3.5, 7.0)


class Kinova3(MujocoArm):
    """Seven joints, upside down in its own frames; three targets."""

    name, arm, readings, revolute = "mujoco-kinova3", "kinova3", SEVEN, (True,) * 7
    instrument, columns, column_units = Instrument("targets", 0.05), THREE, ("mm",) * 9
    gears, payloads = (100,) * 7, (0.0, 1.0, 2.0)


class Xarm7(MujocoArm):
    """Seven joints with bent links."""

    name, arm, readings, revolute = "mujoco-xarm7", "xarm7", SEVEN, (True,) * 7
    instrument, columns, column_units = Instrument("position", 0.05), POSITION, ("mm",) * 3
    gears, payloads = (100,) * 7, (0.0, 1.5, 3.5)


class Jaco(MujocoArm):
    """Six joints with a wrist of 60 deg, its pose read."""

    name, arm, readings, revolute = "mujoco-jaco", "jaco", SIX, (True,) * 6
    instrument, columns, column_units = Instrument("pose", 0.05, 1e-4), POSE, ("mm",) * 3 + ("rad",) * 3
    gears, payloads = (136, 160, 136, 110, 110, 110), (0.0, 0.8, 1.6)


_CLASSES: tuple[type[MujocoArm], ...] = (Ur5e, Panda, Sawyer, Iiwa, Kinova3, Xarm7, Jaco)


def machines() -> Mapping[str, type[MujocoArm]]:
    """Arms by name whose packages are installed. Raises InputError where none is."""
    here = installed()
    found = {known.name: known for known in _CLASSES if known.arm in here}
    if not found:
        packages = " or ".join(sorted({source.package for source in SOURCES.values()}))
        raise InputError(
            f"challenge.mujoco: found no arm, expected the package {packages}: pip install '.[mujoco]'"
        )
    return found


__all__ = ["MujocoArm", "machines"]
