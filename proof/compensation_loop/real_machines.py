"""The real machines, simulated: what they write, log and do. Only ``__main__`` and tests bring them to a controller.

Each knows the truth of one machine of ``truepose demo`` and hands out what a real one would: its drawing, a recording,
thermometers while it moves, and where an independent instrument sees it stand. Lengths mm, angles rad.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Protocol

import numpy as np
from nanopositioner.geometry import Constants, lengths, mirror_pose, reflection
from nanopositioner.plan import paper_plan
from nanopositioner.recordings import recording_text as interferometer_text
from nanopositioner.tables import DAY_0
from numpy.typing import NDArray
from polisher import bundle as polishing
from polisher.physics import Head
from polisher.regression import pose_errors
from polisher.robot import Robot
from telescope_simulator import Simulation, draw_machine, paper_poses, simulate
from telescope_simulator import machine_text as telescope_text
from telescope_simulator import recording_text as photogrammetry_text

Array = NDArray[np.float64]
Errors = Mapping[str, Array]
"""(n,) sizes of errors by name and unit, as they are printed."""


class RealMachine(Protocol):
    """A machine on its bench."""

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Machine file as drawn and recording: all that a controller may know of it."""

    def drivers(self, q: Array, seconds: Array) -> Mapping[str, Array]:
        """What the machine's own sensors log (n,) while it stands at readings (n, 6) at times (n,)."""

    def errors(self, q: Array, wanted: Array, seconds: Array) -> Errors:
        """How far it stands from sensor-frame tool poses (n, 4, 4) at commands (n, 6)."""


@dataclass(frozen=True)
class Nanopositioner:
    """The stages of Tables II and III, seen by one beam; ``points`` readings along each of 69 motions."""

    points: int = 100

    def write(self, folder: Path) -> tuple[Path, Path]:
        return _files(folder, _drawing("nanopositioner"), interferometer_text(paper_plan(), self.points))

    def drivers(self, q: Array, seconds: Array) -> Mapping[str, Array]:
        return {}

    def errors(self, q: Array, wanted: Array, seconds: Array) -> Errors:
        """How far the point of the mirror that the beam meets at first moves away, and how the cavity changes, nm."""
        true = Constants.tabled(DAY_0)
        first, on_mirror = reflection(true, q[:1])
        mirror = mirror_pose(true, q)
        moved = mirror[:, :3, :3] @ on_mirror[0] + mirror[:, :3, 3] - first[0]
        cavity = lengths(true, q)
        return {
            "point of the mirror, nm": 1e6 * np.linalg.norm(moved, axis=1),
            "cavity, nm": 1e6 * np.abs(cavity - cavity[0]),
        }


@dataclass(frozen=True)
class Telescope:
    """A telescope drawn from its tolerances, with an elastic ring on flexures, seen by photogrammetry."""

    seed: int = 20121009

    def write(self, folder: Path) -> tuple[Path, Path]:
        roles, rho = paper_poses()
        return _files(folder, telescope_text(), photogrammetry_text(self._simulated(rho), roles))

    def drivers(self, q: Array, seconds: Array) -> Mapping[str, Array]:
        return {}

    def errors(self, q: Array, wanted: Array, seconds: Array) -> Errors:
        """Errors of the tool frame in the world of the photogrammetry."""
        real = self._simulated(q).pose_world_tool
        turned = real[:, :3, :3] @ wanted[:, :3, :3].transpose(0, 2, 1)
        return {
            "position, um": 1e3 * np.linalg.norm(real[:, :3, 3] - wanted[:, :3, 3], axis=1),
            "orientation, urad": 1e6 * _angle(turned),
        }

    def _simulated(self, rho: Array) -> Simulation:
        return simulate(draw_machine(self.seed), rho, seed=self.seed + 1)


@dataclass(frozen=True)
class Polisher:
    """A hybrid robot with errors in every joint and link, screws that warm up and a wrist gear that winds up."""

    payload: float = polishing.HEAVY

    def write(self, folder: Path) -> tuple[Path, Path]:
        _, rows, simulation = self._demo
        return _files(folder, _drawing("polisher"), polishing.recording_text(rows, simulation))

    def drivers(self, q: Array, seconds: Array) -> Mapping[str, Array]:
        """Thermometers on the nuts, to 0.01 K, and the weight of the polishing tool."""
        out = {"payload": np.full(len(q), self.payload)}
        for k, screw in enumerate(polishing.SCREWS):
            out[f"temperature.leg{k + 1}"] = np.round(screw.growth(self._clock(seconds), q[:, k])[1], 2)
        return out

    def errors(self, q: Array, wanted: Array, seconds: Array) -> Errors:
        """Errors of the polishing point P in the frame of the workpiece, and of the head's orientation."""
        robot = self._demo[0]
        added = np.zeros((len(q), 6))
        for k, screw in enumerate(polishing.SCREWS):
            added[:, k] = screw.growth(self._clock(seconds), q[:, k])[0]
        weight = np.full(len(q), self.payload)
        added[:, 4] = Head().torsion_q5(robot.tool_poses(q), weight, q[:, 5])
        twist = pose_errors(robot.tool_poses(q, added), wanted)
        return {
            "position of P, um": 1e3 * np.linalg.norm(twist[:, :3], axis=1),
            "orientation, 1e-3 deg": np.degrees(1e3) * np.linalg.norm(twist[:, 3:], axis=1),
        }

    @cached_property
    def _demo(self) -> tuple[Robot, polishing.Plan, polishing.Simulation]:
        return polishing.demo()

    def _clock(self, seconds: Array) -> Array:
        """The path is followed after the recording: s since the screws were cold."""
        return np.asarray(self._demo[1].time[-1] + polishing.SECONDS + seconds)


def _angle(turns: Array) -> Array:
    """(n,) rad of rotations (n, 3, 3); exact for small ones too."""
    return np.asarray(
        2 * np.arcsin(np.minimum(np.linalg.norm(turns - np.eye(3), axis=(1, 2)) / np.sqrt(8), 1))
    )


def _drawing(name: str) -> str:
    """A bundled machine file: nominal values only."""
    return (resources.files("truepose.models") / "machines" / name / "machine.yaml").read_text("utf-8")


def _files(folder: Path, machine: str, recording: str) -> tuple[Path, Path]:
    paths = folder / "machine.yaml", folder / "recording.csv"
    for path, text in zip(paths, (machine, recording), strict=True):
        path.write_text(text, encoding="utf-8", newline="\n")
    return paths


__all__ = ["Errors", "Nanopositioner", "Polisher", "RealMachine", "Telescope"]
