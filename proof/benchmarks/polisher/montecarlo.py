"""Least squares against Liu over many noise draws (eqs. 11-14, 17, 18), with the estimate under tolerances beside them.

One robot's displacements come from the simulator, noise from 10^4 draws; each estimator is a handful of matrix
products on one decomposition (``truepose.identification.fit.relinearised``).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.identification.fit.relinearised import LinearEstimate, Spectrum, decompose, ols
from truepose.identification.leaves.shrinking import estimating as biased

from . import ranks, regression
from . import workspace as ws
from .motions import Array
from .robot import LIMBS, MIDDLE, Robot

RUNS = 10_000
TILT = np.radians(5.0)
FIELDS = ("calibration", "test", "tilted")
Estimator = Callable[[Spectrum], LinearEstimate]


@dataclass(frozen=True)
class Size:
    """1-sigma of the source errors of a robot, mm and deg."""

    mm: float
    deg: float

    @property
    def sigma(self) -> Array:
        """(150,) in mm and rad; encoders as they were zeroed by hand, whatever the rest."""
        turns = np.array([error.turns for error in regression.errors()])
        out = np.where(turns, np.radians(self.deg), self.mm)
        encoders = np.where(turns, np.radians(ws.ENCODER_DEG), ws.ENCODER_MM)[: regression.ENCODERS]
        return np.concatenate([encoders, out[regression.ENCODERS :]])


def robot_of(size: Size, seed: int) -> Robot:
    """A robot whose structural errors are drawn; its encoders are right, as after the coarse calibration."""
    rng = np.random.default_rng(seed)
    scale = np.array([size.mm] * 3 + [np.radians(size.deg)] * 3)
    return Robot({(link, limb): scale * rng.normal(size=6) for limb in (*LIMBS, MIDDLE) for link in range(7)})


@dataclass(frozen=True)
class Field:
    """Wanted tool frames (n, 4, 4) and the nominal model at the joints that should reach them."""

    wanted: Array
    nodes: regression.Nodes

    def errors(self, robot: Robot) -> Array:
        """(n, 6) pose errors of P that a robot makes at the nominal commands, mm and rad."""
        return regression.pose_errors(robot.tool_poses(self.nodes.q), self.wanted)


@cache
def field(name: str) -> Field:
    """``calibration``: lower and upper layers, 7 x 7; ``test``: middle layer; ``tilted``: the same, turned by 5 deg."""
    if name == "calibration":
        turned = ranks.TURNED[ranks.NEARLY]
        return Field(ranks.poses(turned), ranks.nodes(turned))
    at, turns = ws.nodes(7, "middle"), None
    if name == "tilted":
        drawn = np.random.default_rng(8).uniform(-TILT, TILT, (len(at), 3)) * [1.0, 1.0, 0.0]
        turns = Rotation.from_rotvec(drawn).as_matrix()
    wanted = ws.tool_poses(at, turns)
    return Field(wanted, regression.at(ws.joints(wanted)))


def displacements(robot: Robot) -> Array:
    """(882,) of the targets at the calibration nodes, mm, without noise: eq. (9)'s Delta p."""
    nodes = field("calibration").nodes
    poses = robot.tool_poses(nodes.q)
    points = np.array(list(ws.POINTS.values()))
    read = np.einsum("nij,kj->nki", poses[:, :3, :3], points) + poses[:, None, :3, 3]
    return np.asarray(read.reshape(len(poses), 9) - nodes.nominal).ravel()


@dataclass(frozen=True)
class Scheme:
    """A way to estimate: which of the 150 columns, their unit (150,), the estimator; readings count in ``reading``."""

    name: str
    columns: Sequence[int]
    unit: Array
    estimator: Estimator
    reading: float = 1.0

    def estimate(self, h: Array, y: Array) -> tuple[Array, Array]:
        """Errors (150, k), mm and rad, for right-hand sides y (m, k), and what tuned each (k,)."""
        own, unit = list(self.columns), self.unit[list(self.columns)]
        found = self.estimator(decompose(h[:, own] * unit / self.reading, y / self.reading))
        out = np.zeros((h.shape[1], y.shape[1]))
        out[own] = found.b * unit[:, None]
        return out, found.tuning


def schemes(size: Size, angle: str = "deg") -> list[Scheme]:
    """The paper's two on its 54 columns, three more biased ones, and all 150 errors under tolerances ``size``."""
    unit, columns = regression.unit(angle), ranks.kept()
    return [
        Scheme("OLS", columns, unit, ols),
        Scheme("LE, eq. (14)", columns, unit, biased.liu),
        Scheme("LE, Liu's d", columns, unit, partial(biased.liu, rule="unbiased")),
        Scheme("ridge", columns, unit, biased.ridge),
        Scheme("PCR", columns, unit, biased.pcr),
        Scheme("MAP", range(len(unit)), size.sigma, partial(biased.ridge, k=1.0), ws.SIGMA),
    ]


def draws(size: Size, seed: int, runs: int) -> Array:
    """(882, runs) displacements of one robot with noise."""
    exact = displacements(robot_of(size, seed))
    noise = np.random.default_rng([seed, runs]).normal(size=(len(exact), runs))
    return np.asarray(exact[:, None] + ws.SIGMA * noise)


@dataclass(frozen=True)
class Spread:
    """Eq. (18) over the draws, in mm and in deg or rad together: with variances as D, and with standard deviations
    as printed; mean and quartiles of what tuned the estimator."""

    by_variance: float
    as_printed: float
    tuning: float
    quartiles: tuple[float, float]

    @classmethod
    def of(cls, scheme: Scheme, y: Array) -> Spread:
        """Of the estimated errors in the scheme's unit."""
        found, tuning = scheme.estimate(field("calibration").nodes.H, y)
        std = np.std(found[list(scheme.columns)] / scheme.unit[list(scheme.columns), None], axis=1)
        low, high = np.quantile(tuning, (0.25, 0.75))
        return cls(
            float(np.sqrt(np.sum(std**2))),
            float(np.sqrt(np.sum(std))),
            float(np.mean(tuning)),
            (float(low), float(high)),
        )


def eta(spread: Spread, other: Spread) -> tuple[float, float]:
    """Eq. (17) in per cent: how much less ``spread`` scatters than ``other``, by both readings of eq. (18)."""
    one = 100 * (1 - spread.by_variance / other.by_variance)
    return one, 100 * (1 - spread.as_printed / other.as_printed)


def eta_rows(sizes: Sequence[Size], angle: str, runs: int = RUNS, seed: int = 1) -> list[list[str]]:
    """For each size of the source errors: scatter of least squares, then eta of Liu by three rules for d."""
    rows = []
    for size in sizes:
        y = draws(size, seed, runs)
        ols, plug, own = (Spread.of(scheme, y) for scheme in schemes(size, angle)[:3])
        held = 100 * (1 - plug.tuning)
        quartiles = f"{100 * (1 - plug.quartiles[1]):.0f} to {100 * (1 - plug.quartiles[0]):.0f}"
        rows.append(
            [
                f"{size.mm:g} mm, {size.deg:g} deg",
                f"{ols.by_variance:.0f}",
                *(f"{value:.1f}" for value in eta(plug, ols)),
                *(f"{value:.1f}" for value in eta(own, ols)),
                f"{held:.1f} ({quartiles})",
            ]
        )
    return rows


ERROR_HEAD = (
    "model",
    *(f"{name}: {what}" for name in FIELDS for what in ("position, um", "orientation, 1e-3 deg")),
)
ETA_HEAD = (
    "source errors, 1 sigma",
    "OLS, eq. (18)",
    "eq. (14)",
    "printed (18)",
    "Liu's d",
    "printed (18)",
    "d held",
)


def error_rows(size: Size, runs: int = RUNS, seed: int = 1) -> list[list[str]]:
    """Mean over the draws of the largest and of the mean pose error that each model leaves in each field.

    Position in um, orientation in 1e-3 deg.
    """
    y = draws(size, seed, runs)
    robot = robot_of(size, seed)
    rows = []
    for scheme in schemes(size):
        found, _ = scheme.estimate(field("calibration").nodes.H, y)
        cells = [scheme.name]
        for name in FIELDS:
            here = field(name)
            left = np.einsum("nij,jk->nik", here.nodes.B, found) - here.errors(robot)[:, :, None]
            for part, factor in ((slice(0, 3), 1e3), (slice(3, 6), np.degrees(1e3))):
                norm = factor * np.linalg.norm(left[:, part], axis=1)
                cells.append(f"{np.mean(np.max(norm, axis=0)):.2f} / {np.mean(norm):.2f}")
        rows.append(cells)
    return rows


def seconds(runs: int = RUNS) -> float:
    """CPU time that least squares and Liu take over ``runs`` draws, the decomposition included."""
    size = Size(0.1, 0.1)
    y, h = draws(size, 1, runs), field("calibration").nodes.H
    start = time.process_time()
    for scheme in schemes(size)[:2]:
        scheme.estimate(h, y)
    return time.process_time() - start
