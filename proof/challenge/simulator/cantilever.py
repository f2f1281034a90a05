"""Straight bars between nodes in space, by finite elements: links that bend, platforms of welded tube.

Timoshenko's bar element (Przemieniecki 1968, with shear), exact at its ends for loads at nodes; a load along a bar
is put on its nodes consistently, which is exact for a uniform one. N, mm, rad.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEEL, ALUMINIUM = 210_000.0, 70_000.0
POISSON = 0.3


@dataclass(frozen=True)
class Section:
    """A closed tube alike in both directions: area (mm^2), second moment (mm^4), Young's modulus (N/mm^2)."""

    area: float
    second: float
    young: float

    @classmethod
    def tube(cls, outer: float, inner: float, young: float = ALUMINIUM) -> Section:
        """A round tube, diameters in mm."""
        return cls(np.pi / 4 * (outer**2 - inner**2), np.pi / 64 * (outer**4 - inner**4), young)

    @classmethod
    def box(cls, outer: float, inner: float, young: float = ALUMINIUM) -> Section:
        """A square tube, sides in mm."""
        return cls(outer**2 - inner**2, (outer**4 - inner**4) / 12, young)


@dataclass(frozen=True)
class Frame:
    """Bars (pairs of nodes) of one section between nodes (m, 3), some of them clamped."""

    nodes: Array
    bars: tuple[tuple[int, int], ...]
    section: Section
    clamped: tuple[int, ...]

    def displacements(self, loads: Array) -> Array:
        """(m, 6, k) displacements and turns of all nodes under k load cases (m, 6, k): forces N, moments N*mm."""
        m = len(self.nodes)
        free = np.array([6 * node + d for node in range(m) if node not in self.clamped for d in range(6)])
        flat = loads.reshape(6 * m, -1)
        out = np.zeros_like(flat)
        out[free] = np.linalg.solve(self.stiffness()[np.ix_(free, free)], flat[free])
        return out.reshape(loads.shape)

    def stiffness(self) -> Array:
        """(6 m, 6 m) of all nodes."""
        K = np.zeros((6 * len(self.nodes), 6 * len(self.nodes)))
        for i, j in self.bars:
            place = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
            K[np.ix_(place, place)] += bar_stiffness(self.nodes[i], self.nodes[j], self.section)
        return K


def bar_stiffness(start: Array, end: Array, section: Section) -> Array:
    """(12, 12) of a bar in the common frame: [u, turn] of start, then of end."""
    span = end - start
    length = float(np.linalg.norm(span))
    shear = section.young / (2 * (1 + POISSON))
    ei = section.young * section.second
    phi = 12 * ei / (shear * section.area / 2 * length**2)
    side, tip = 12 * ei / length**3 / (1 + phi), 6 * ei / length**2 / (1 + phi)
    near, far = (4 + phi) * ei / length / (1 + phi), (2 - phi) * ei / length / (1 + phi)
    k = np.zeros((12, 12))
    for d, value in ((0, section.young * section.area / length), (3, shear * 2 * section.second / length)):
        k[d, d] = k[d + 6, d + 6] = value
        k[d, d + 6] = k[d + 6, d] = -value
    for u, w, sign in ((1, 5, 1.0), (2, 4, -1.0)):
        p = np.array([u, w, u + 6, w + 6])
        s = sign * tip
        k[np.ix_(p, p)] = [[side, s, -side, s], [s, near, -s, far], [-side, -s, side, -s], [s, far, -s, near]]
    R = along(span)
    T = np.kron(np.eye(4), R.T)
    K: Array = T.T @ k @ T
    return K


def along(span: Array) -> Array:
    """(3, 3) axes of a bar in columns: x along ``span``."""
    x = span / np.linalg.norm(span)
    y = np.cross(np.eye(3)[np.argmin(np.abs(x))], x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def cantilever(root: Array, tip: Array, section: Section) -> tuple[Array, Array]:
    """Tip of a bar clamped at its root: (6, 6) displacement by a wrench at the tip, (6, 3) by its whole weight (3,).

    The weight is spread evenly. Displacement: mm and rad; wrench: N and N*mm; all in the frame of root and tip.
    """
    frame = Frame(np.stack([root, tip]), ((0, 1),), section, (0,))
    cases = np.zeros((2, 6, 9))
    cases[1, :, :6] = np.eye(6)
    cases[1, :, 6:] = spread(tip - root)
    seen = frame.displacements(cases)[1]
    return seen[:, :6], seen[:, 6:]


def spread(span: Array) -> Array:
    """(6, 3) loads at the far end that stand for a force (3,) spread evenly along ``span``: half, and a moment.

    Held in the span's own frame by the fixed-end moment F L / 12 of Euler and Bernoulli.
    """
    s = np.asarray(span, dtype=float)
    lever = np.array([[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]])
    return np.vstack([np.eye(3) / 2, -lever / 12])


def loads_at(places: Sequence[int], total: int) -> Array:
    """(total, 6, 3 k) unit forces along x, y, z at each of k nodes."""
    cases = np.zeros((total, 6, 3 * len(places)))
    for k, node in enumerate(places):
        cases[node, :3, 3 * k : 3 * k + 3] = np.eye(3)
    return cases
