"""What visits to the same place tell: how far a reading repeats, and whether the arm or its joint readings moved."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from real_recordings.common import Array, Mask, rms
from real_recordings.linearised import Linearised

REPEATS = {"configurations": 0.03, "grid": 0.5}
"""deg: rows whose joints differ by less (norm) visit the same place."""
EDGES = (0.0, 0.03, 0.5, 2.0, 2.5, 3.0, 5.0, 8.0, 12.0)
ROTATION_WEIGHT = 100.0
"""mm per rad: how rotations count beside positions where the two are fitted together."""
_ROUNDS = 4


@dataclass(frozen=True)
class Moments:
    """Scatter of positions as noise without direction (um per axis) and as noise of joints 1 to 5 (urad).

    share: of the mean square, without direction first.
    """

    rms: float
    isotropic: float
    joints: Array
    share: Array


def pairs(data: Linearised, outlier: Mask, degrees: float) -> Array:
    """(m, 2) rows, none an outlier, whose joints differ by less."""
    found = cKDTree(np.rad2deg(data.q)).query_pairs(degrees, output_type="ndarray")
    return np.asarray(found[~outlier[found].any(axis=1)])


def moments(scatter: Array, joint: Array) -> Moments:
    """Variances v that explain scatter (n, 3) mm by cov = v0 I + sum v_k J_k J_k', J (n, 3, 5) mm per rad."""
    parts = [np.tile(np.eye(3), (len(scatter), 1, 1))]
    parts += [np.einsum("ni,nj->nij", joint[:, :, k], joint[:, :, k]) for k in range(joint.shape[2])]
    x = np.array([p.reshape(-1) for p in parts]).T
    y = np.einsum("ni,nj->nij", scatter, scatter).reshape(-1)
    weight, v = np.ones(len(scatter)), np.zeros(len(parts))
    for _ in range(_ROUNDS):
        by_entry = np.repeat(weight, 9)
        scale = np.linalg.norm(x * by_entry[:, None], axis=0)
        v = nnls(x * by_entry[:, None] / scale, y * by_entry)[0] / scale
        weight = 1.0 / np.maximum(np.einsum("k,knii->n", v, np.array(parts)), 1e-12)
    traces = np.array([np.mean(np.trace(p, axis1=1, axis2=2)) for p in parts])
    return Moments(
        1e3 * rms(scatter), 1e3 * float(np.sqrt(v[0])), 1e6 * np.sqrt(v[1:]), v * traces / (v @ traces)
    )


def unreal_share(data: Linearised, left: Array, rows: Array) -> tuple[Array, Array]:
    """(nq,) part of what a joint's reading changed by between visits that the arm did not do; and its sigma.

    0: the arm moved as it was read; 1: it stood still and the reading is noise.
    """
    weight = np.array([1.0] * 3 + [ROTATION_WEIGHT] * 3)
    change = data.q[rows[:, 1]] - data.q[rows[:, 0]]
    x = (data.joint[rows].mean(axis=1) * change[:, None, :] * weight[:, None]).reshape(-1, data.q.shape[1])
    y = ((left[rows[:, 1]] - left[rows[:, 0]]) * weight).reshape(-1)
    solution = np.linalg.lstsq(x, y, rcond=None)[0]
    spread = float(np.std(y - x @ solution))
    return solution, spread * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))


def still(data: Linearised, left: Array, rows: Array) -> Array:
    """(m, 6) what two visits differ by when joint readings are taken not to have changed."""
    change = data.q[rows[:, 1]] - data.q[rows[:, 0]]
    moved = np.einsum("nij,nj->ni", data.joint[rows].mean(axis=1), change)
    return np.asarray(left[rows[:, 1]] - left[rows[:, 0]] - moved)


def variogram(data: Linearised, left: Array, outlier: Mask) -> list[tuple[float, float, int, float, float]]:
    """From, to (deg between joints), number of pairs, and the scatter of one row of them: um, urad."""
    rows = pairs(data, outlier, EDGES[-1])
    apart = np.linalg.norm(np.rad2deg(data.q[rows[:, 0]] - data.q[rows[:, 1]]), axis=1)
    out = []
    for low, high in pairwise(EDGES):
        some = rows[(apart >= low) & (apart < high)]
        if len(some) >= 10:
            differ = (left[some[:, 0]] - left[some[:, 1]]) / np.sqrt(2.0)
            out.append((low, high, len(some), 1e3 * rms(differ[:, :3]), 1e6 * rms(differ[:, 3:])))
    return out
