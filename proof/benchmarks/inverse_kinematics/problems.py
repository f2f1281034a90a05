"""What the solvers are asked: poses from joints uniform in their ranges, with guesses near them or anywhere."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .arms import Arm
from .forward import poses

Array = NDArray[np.float64]
NEAR = np.radians(1.0)
"""How far a near guess is from the solution, every joint, either way."""


@dataclass(frozen=True)
class Problems:
    """Targets (n, 4, 4) in mm, and guesses (n, joints) in rad."""

    targets: Array
    guesses: Array

    def head(self, n: int) -> Problems:
        return Problems(self.targets[:n], self.guesses[:n])


@dataclass(frozen=True)
class ProblemFiles:
    """``Problems`` as rows of doubles: 12 numbers of [R|p] and the guess; ``metres`` has p in m."""

    targets: Path
    metres: Path
    guesses: Path


def near(arm: Arm, n: int, seed: int = 1) -> Problems:
    """Guesses one degree away in every joint; the solutions stand that far inside the ranges."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm.ranges[:, 0] + NEAR, arm.ranges[:, 1] - NEAR, (n, len(arm.ranges)))
    return Problems(poses(arm, q), q + NEAR * rng.choice([-1.0, 1.0], q.shape))


def anywhere(arm: Arm, n: int, seed: int = 2) -> Problems:
    """Solutions and guesses uniform in the ranges, independent of each other."""
    rng = np.random.default_rng(seed)
    q, guesses = rng.uniform(arm.ranges[:, 0], arm.ranges[:, 1], (2, n, len(arm.ranges)))
    return Problems(poses(arm, q), guesses)


def save(problems: Problems, folder: Path, name: str) -> ProblemFiles:
    """Write the files that the drivers read."""
    files = ProblemFiles(*(folder / f"{name}_{part}.bin" for part in ("mm", "m", "guess")))
    rows = problems.targets[:, :3, :].copy()
    rows.tofile(files.targets)
    rows[:, :, 3] *= 1e-3
    rows.tofile(files.metres)
    problems.guesses.tofile(files.guesses)
    return files
