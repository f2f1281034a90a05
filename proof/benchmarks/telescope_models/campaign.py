"""The measurements of one telescope as files, and its machine file in every model. mm, N, deg in files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from telescope_simulator import (
    Flexure,
    Machine,
    Simulation,
    draw_machine,
    machine_text,
    nominal_machine,
    paper_poses,
    recording_text,
    simulate,
)

from challenge.simulator.telescope_ring.beams import Section
from challenge.simulator.telescope_ring.machine import TARGETS
from challenge.simulator.telescope_ring.simulation import PoseSensor, TargetsSensor
from truepose.identification.leaves.photogrammetry.pose_table import pose_table

Array = NDArray[np.float64]
MODELS = ("spherical", "linear", "beam", "stiffness")
"""The report's four, in its order; ``elastic`` is a fifth."""
SIGMA = 0.005
ROD = Section.round_bar(40.0, 200e3)
SHARE = 0.1
"""1-sigma of a section's stiffness and of beta, of the value itself."""
_FREE_FRAMES = ("tolerance: {xyz: 5, rpy: 1}", "tolerance: {xyz: 1, rpy: 0.5}")
_EXACT = "tolerance: {xyz: 0, rpy: 0}"


@dataclass(frozen=True, eq=False)
class Campaign:
    """One telescope, measured: files (``targets.csv``, ``poses.csv`` and ``<sensor>-<model>.yaml``), the ring's
    displacements at the leg ends as measured (46, 6), mm, and the truth for judging results only."""

    folder: Path
    rho: Array
    calibration: NDArray[np.bool_]
    ring: Array
    truth: Machine
    simulation: Simulation

    def machine(self, model: str, sensor: str) -> Path:
        """Machine file of a model, seen by ``targets`` or by ``pose``."""
        path = self.folder / f"{sensor}-{model}.yaml"
        if not path.exists():
            path.write_text(model_text(model, sensor), encoding="utf-8")
        return path

    def recording(self, sensor: str) -> Path:
        """The same measurements as points or as poses."""
        return self.folder / ("targets.csv" if sensor == "targets" else "poses.csv")

    @property
    def coefficients(self) -> Array:
        """(6, 6) K of eq. 2 from the measured ring, by least squares for each leg (section 3.3)."""
        rows = self.calibration
        columns = np.column_stack([np.ones(int(rows.sum())), self.rho[rows]])
        fitted = np.linalg.lstsq(columns, self.ring[rows], rcond=None)[0]
        return np.asarray(fitted[1:].T)

    @property
    def kappa(self) -> Array:
        """(6,) kappa of eq. 1: each leg end by its own actuator alone."""
        rho = self.rho[self.calibration] - self.rho[self.calibration].mean(axis=0)
        return np.asarray(np.sum(rho * self.ring[self.calibration], axis=0) / np.sum(rho * rho, axis=0))


@contextmanager
def measured(seed: int, *, ring_stiffness: float = 1.0) -> Iterator[Campaign]:
    """A telescope drawn from its tolerances and measured at the poses of Tables 3 and 4.

    Base and tool stand where the drawing says, so that a and b mean what the report's tables mean.
    ``ring_stiffness=inf``: a rigid platform on ball joints.
    """
    truth = _in_nominal_frames(draw_machine(seed))
    roles, rho = paper_poses()
    simulation = simulate(truth, rho, ring_stiffness=ring_stiffness, sensor=TargetsSensor(), seed=seed + 1)
    rng = np.random.default_rng(seed + 2)
    ring = simulation.poses.leg_end_displacement[..., 2] + truth.upper_centres[:, 2]
    with TemporaryDirectory() as folder:
        at = Path(folder)
        text = recording_text(simulation, roles)
        (at / "targets.csv").write_text(text, encoding="utf-8")
        _poses(at / "targets.csv").to_csv(at / "poses.csv", index=False)
        yield Campaign(
            at,
            rho,
            np.array([role == "calibration" for role in roles]),
            ring + SIGMA * rng.standard_normal(ring.shape),
            truth,
            simulation,
        )


def _in_nominal_frames(machine: Machine) -> Machine:
    drawn = nominal_machine().parameters
    kept = {
        name: drawn[name] if name.startswith(("base.", "tool.")) else value
        for name, value in machine.parameters.items()
    }
    return replace(machine, parameters=MappingProxyType(kept))


def _poses(targets: Path) -> pd.DataFrame:
    """Pose of the tool frame in each row, from its twelve targets (section 3.1)."""
    table = pose_table(pd.read_csv(targets), SIGMA, TARGETS)
    return table.drop(columns=[c for c in table.columns if c.endswith((".std", "suspects", "per_dof"))])


def pose_sigma() -> PoseSensor:
    """The noise of such a pose (mm, deg): the twelve targets' at the tool frame's origin."""
    points = np.array(list(TARGETS.values()))
    information = np.zeros((6, 6))
    for x, y, z in points:
        rows = np.hstack([np.eye(3), -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])])
        information += rows.T @ rows / SIGMA**2
    std = np.sqrt(np.diag(np.linalg.inv(information)))
    return PoseSensor(float(np.mean(std[:3])), float(np.degrees(np.mean(std[3:]))))


def model_text(model: str, sensor: str) -> str:
    """Machine file of a model, seen by ``targets`` or by ``pose``; base and tool stand exactly as drawn."""
    text = machine_text(TargetsSensor() if sensor == "targets" else pose_sigma())
    for line in _FREE_FRAMES:
        text = text.replace(line, _EXACT)
    flexure = Flexure()
    section = {"bending": flexure.section.ei_y, "tension": flexure.section.ea, "torsion": flexure.section.gj}
    rod = {"bending": ROD.ei_y, "tension": ROD.ea, "torsion": ROD.gj}
    lines = [
        f"model: {model}",
        f"flexure: {{length: {flexure.length:g}, {_fields(section)}}}",
        f"rod: {{{_fields(rod)}}}",
    ]
    text = text.replace(f"flexure: {{length: {flexure.length:g}}}", "\n  ".join(lines))
    return text.replace("tolerances: {", "tolerances: {" + _tolerances(model, section, rod))


def _fields(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name}: {value:.6g}" for name, value in values.items())


def _tolerances(model: str, flexure: Mapping[str, float], rod: Mapping[str, float]) -> str:
    """What the model has beside geometry is not known exactly either."""
    if model == "beam":
        return f"beta: {0.25 * SHARE:g}, "
    if model in {"stiffness", "elastic"}:
        parts = {"flexure": flexure, "rod": rod}
        return "".join(
            f"{part}.{name}: {SHARE * value:.6g}, "
            for part, of in parts.items()
            for name, value in of.items()
        )
    return ""
