"""Straight 3-D Euler-Bernoulli beam elements and their assembly.

Units: mm, N, rad, so stiffness N/mm, N, N*mm. Degrees of freedom of a node: ux uy uz phix phiy phiz.
The element is derived from its six natural modes (stretch, twist, and in each plane the uniform bending and
the chord rotation); it is the matrix of eqs. 20-21 of Gayral and Daney (RR-8096), which the tests
check against cantilever formulae rather than against the print.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from .rotations import Array


@dataclass(frozen=True)
class Section:
    """Stiffness of a beam's cross section: EA (N), EI about local y and z, GJ (all N*mm^2)."""

    ea: float
    ei_y: float
    ei_z: float
    gj: float

    @staticmethod
    def round_bar(diameter: float, young: float, poisson: float = 0.3) -> Section:
        """Solid circular bar: k1 = EI, k2 = ES, k3 = GJ of eq. 21; diameter mm, young N/mm^2."""
        second = np.pi * diameter**4 / 64
        shear = young / (2 * (1 + poisson))
        ei = young * second
        return Section(young * np.pi * diameter**2 / 4, ei, ei, shear * 2 * second)

    @staticmethod
    def rectangle(width: float, height: float, young: float, poisson: float = 0.3) -> Section:
        """Solid rectangle, `width` along local y, `height` along local z (mm); Roark's torsion constant."""
        a, b = max(width, height) / 2, min(width, height) / 2
        torsion = a * b**3 * (16 / 3 - 3.36 * b / a * (1 - b**4 / (12 * a**4)))
        shear = young / (2 * (1 + poisson))
        return Section(
            young * width * height,
            young * width * height**3 / 12,
            young * height * width**3 / 12,
            shear * torsion,
        )


def natural_modes(length: float) -> Array:
    """(6, 12) small-displacement map from the nodes to stretch, twist, bend_y, bend_z, chord_y, chord_z.

    Stretch in mm, the rest in rad; local x runs along the beam. `bend` is the relative rotation of the ends,
    `chord` the rotation of the chord against the mean of the end rotations.
    """
    B = np.zeros((6, 12))
    B[0, 0], B[0, 6] = -1, 1
    for row, dof in ((1, 3), (2, 4), (3, 5)):
        B[row, dof], B[row, dof + 6] = -1, 1
    # a chord turned by +beta_y lowers its far end in z, by +beta_z lifts it in y
    B[4, 2], B[4, 8], B[4, 4], B[4, 10] = 1 / length, -1 / length, -0.5, -0.5
    B[5, 1], B[5, 7], B[5, 5], B[5, 11] = -1 / length, 1 / length, -0.5, -0.5
    return B


def modal_stiffness(section: Section, length: float) -> Array:
    """(6,) stiffness of the natural modes: EA/l, GJ/l, EI/l twice, 12 EI/l twice."""
    s = section
    return np.array([s.ea, s.gj, s.ei_y, s.ei_z, 12 * s.ei_y, 12 * s.ei_z]) / length


def element_stiffness(section: Section, length: float) -> Array:
    """(12, 12) stiffness in the local frame, loads = K displacements (eqs. 20-21)."""
    B = natural_modes(length)
    return np.asarray(B.T @ (modal_stiffness(section, length)[:, None] * B))


def beam_frame(start: Array, end: Array, up: Array) -> Array:
    """(3, 3) axes as columns: x from start to end, z as near to `up` as it can be."""
    x = (end - start) / np.linalg.norm(end - start)
    y = np.cross(up, x)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def global_stiffness(section: Section, start: Array, end: Array, up: Array) -> Array:
    """(12, 12) stiffness of one element in the frame in which `start` and `end` (mm) are given."""
    T = np.kron(np.eye(4), beam_frame(start, end, up))
    return np.asarray(T @ element_stiffness(section, float(np.linalg.norm(end - start))) @ T.T)


def assemble(nodes: Array, elements: Iterable[tuple[int, int, Section]], up: Array) -> Array:
    """(6n, 6n) stiffness of a frame of beams over `nodes` (n, 3), mm; `up` sets every section's z."""
    K = np.zeros((6 * len(nodes), 6 * len(nodes)))
    for i, j, section in elements:
        dofs = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        K[np.ix_(dofs, dofs)] += global_stiffness(section, nodes[i], nodes[j], up)
    return K
