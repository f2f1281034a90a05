"""`simulate`: readings of a sensor for given actuator travels of one true telescope.

mm, N, rad, except that a pose sensor reads its rotation vector in deg, as the machine file's recordings do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from .machine import TARGETS, Machine
from .ring import Ring, leg_end_compliance, leg_end_nodes
from .rotations import Array, exp_so3, transform
from .statics import Flexure, Poses, elastic_poses, rigid_poses

Joints = Literal["auto", "spherical", "flexure"]


@dataclass(frozen=True)
class TargetsSensor:
    """Photogrammetry: targets (tool frame, mm) seen in the world, N(0, sigma_xyz mm) on every coordinate."""

    points: Mapping[str, tuple[float, float, float]] = field(default_factory=lambda: TARGETS)
    sigma_xyz: float = 0.005

    @property
    def columns(self) -> tuple[str, ...]:
        """P1.x P1.y P1.z P2.x ..."""
        return tuple(f"{name}.{axis}" for name in self.points for axis in "xyz")

    def machine_lines(self) -> str:
        """The `sensor:` block of a machine file."""
        points = "".join(
            f"    {name}: [{x:.10g}, {y:.10g}, {z:.10g}]\n" for name, (x, y, z) in self.points.items()
        )
        head, tail = "sensor:\n  type: targets\n  points:\n", f"  sigma: {{xyz: {self.sigma_xyz}}}\n"
        return head + points + tail + "  tolerance: {points: 0}\n"

    def read(self, world_T_tool: Array, rng: np.random.Generator | None) -> Array:
        """(n, 3 targets) readings in mm; exact without `rng`."""
        points = np.array(list(self.points.values()))
        seen = np.einsum("nij,kj->nki", world_T_tool[:, :3, :3], points) + world_T_tool[:, None, :3, 3]
        observed: Array = seen.reshape(len(seen), -1)
        if rng is not None:
            observed = observed + self.sigma_xyz * rng.standard_normal(observed.shape)
        return observed


@dataclass(frozen=True)
class PoseSensor:
    """Pose of the tool frame in the world: x y z (mm), rotation vector rx ry rz (deg).

    Noise: N(0, sigma_xyz mm) on the position; R becomes R Exp(w), w ~ N(0, sigma_rot deg) on each component.
    """

    sigma_xyz: float = 0.005
    sigma_rot: float = 0.001
    columns: tuple[str, ...] = ("x", "y", "z", "rx", "ry", "rz")

    def machine_lines(self) -> str:
        """The `sensor:` block of a machine file."""
        return f"sensor:\n  type: pose\n  sigma: {{xyz: {self.sigma_xyz}, rot: {self.sigma_rot}}}\n"

    def read(self, world_T_tool: Array, rng: np.random.Generator | None) -> Array:
        """(n, 6) readings in mm and deg; exact without `rng`."""
        position, R = world_T_tool[:, :3, 3], world_T_tool[:, :3, :3]
        if rng is not None:
            position = position + self.sigma_xyz * rng.standard_normal(position.shape)
            R = R @ exp_so3(np.radians(self.sigma_rot) * rng.standard_normal(position.shape))
        return np.hstack([position, np.degrees(Rotation.from_matrix(R).as_rotvec())])


Sensor = TargetsSensor | PoseSensor


@dataclass(frozen=True)
class Simulation:
    """What was commanded, what the sensor reads, and the truth behind it."""

    rho: Array  # (n, 6) commanded, mm
    columns: tuple[str, ...]  # of the observations
    observations: Array  # (n, len(columns)), with noise
    exact_observations: Array  # the same without noise
    poses: Poses  # platform in the base frame, leg-end displacements
    pose_world_tool: Array  # (n, 4, 4)


@lru_cache(maxsize=8)
def _compliance(ring: Ring) -> Array:
    C = leg_end_compliance(ring)
    C.flags.writeable = False
    return C


def solve(
    machine: Machine,
    travel: Array,
    *,
    ring_stiffness: float = 1.0,
    joints: Joints = "auto",
    flexure: Flexure | None = None,
    ring: Ring | None = None,
) -> Poses:
    """Platform poses for true travels (n, 6), mm; the options are those of `simulate`."""
    if not ring_stiffness > 0:
        raise ValueError(f"ring_stiffness is a positive factor or inf, got {ring_stiffness}")
    if joints not in {"auto", "spherical", "flexure"}:
        raise ValueError(f"joints is auto, spherical or flexure, got {joints!r}")
    is_rigid = np.isinf(ring_stiffness)
    if joints == "spherical" or (joints == "auto" and is_rigid):
        return rigid_poses(machine, travel)
    platform = ring or Ring()
    compliance = None if is_rigid else _compliance(platform) / ring_stiffness
    return elastic_poses(machine, travel, flexure or Flexure(), leg_end_nodes(platform), compliance)


def simulate(
    machine: Machine,
    rho: Array,
    *,
    ring_stiffness: float = 1.0,
    joints: Joints = "auto",
    flexure: Flexure | None = None,
    ring: Ring | None = None,
    actuator_scale: float | Sequence[float] = 0.0,
    sensor: Sensor | None = None,
    seed: int = 0,
) -> Simulation:
    """A recording of `machine` at commanded travels rho (n, 6), mm.

    ring_stiffness: factor on the ring's stiffness; inf is a rigid platform.
    joints: "flexure" bends the flexures; "spherical" is the exact 6-PUS geometry (nothing is loaded, so the
        ring stays straight too); "auto" is "spherical" for a rigid platform and "flexure" otherwise.
    actuator_scale: s of the actuators (one for all, or six): rho becomes (1 + s) rho before offset is added.
    sensor: targets with 5 um noise unless told.
    seed: of the sensor's noise alone; the machine has its own (`draw_machine`).
    """
    commanded = np.array(rho, dtype=float)
    if commanded.ndim != 2 or commanded.shape[1] != 6:
        raise ValueError(f"rho has one row a pose and six columns, got shape {commanded.shape}")
    travel = (1 + np.asarray(actuator_scale, dtype=float)) * commanded
    poses = solve(machine, travel, ring_stiffness=ring_stiffness, joints=joints, flexure=flexure, ring=ring)
    base_T_platform = transform(poses.rotation, poses.position)
    world_T_tool = machine.frame("base") @ base_T_platform @ machine.frame("tool")
    chosen = sensor or TargetsSensor()
    return Simulation(
        commanded,
        chosen.columns,
        chosen.read(world_T_tool, np.random.default_rng(seed)),
        chosen.read(world_T_tool, None),
        poses,
        world_T_tool,
    )
