"""The platform: a ring of beam elements through the six leg ends, held by spokes to a rigid hub.

Platform frame, mm, N. A stiffening rib makes the ring high everywhere but between legs 1 and 6, where it is a
flat strip ("there is no strengthening ... between the attachment points of legs 1 and 6", section 3.3 of
RR-8096) and where no spoke supports it either: two spokes flank that sector from outside, two more stand
midway between legs 2-3 and 4-5. About each of them a leg pair can tilt like a seesaw, which gives the strong
opposite coupling of legs 1-6, 2-3 and 4-5 of eq. 4. The hub is the platform frame itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .beams import Section, assemble
from .rotations import Array

ALUMINIUM = 70_000.0  # Young's modulus, N/mm^2
LEG_ANGLES = (-46.0, 46.0, 74.0, 166.0, 194.0, 286.0)  # deg, legs 1..6
OPEN_SECTOR = (286.0, 314.0)  # deg, between legs 6 and 1: without the rib
PAIR_SPOKES = (60.0, 180.0)  # deg, midway between legs 2-3 and 4-5
FLANK_SPOKES = (280.0, 320.0)  # deg, beside legs 6 and 1
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Ring:
    """Sections (width in the platform's plane, height along z, mm) and sizes of the platform."""

    radius: float = 250.0
    hub_radius: float = 120.0
    ribbed: tuple[float, float] = (28.0, 20.0)
    open_strip: tuple[float, float] = (28.0, 5.0)
    pair_spoke: tuple[float, float] = (17.0, 24.0)
    flank_spoke: tuple[float, float] = (9.0, 18.0)
    elements_per_sector: int = 8
    elements_per_spoke: int = 4
    young: float = ALUMINIUM

    def spokes(self) -> list[tuple[float, Section]]:
        """Angle (deg) and section of each spoke."""
        pair, flank = (Section.rectangle(*s, self.young) for s in (self.pair_spoke, self.flank_spoke))
        return [(a, pair) for a in PAIR_SPOKES] + [(a, flank) for a in FLANK_SPOKES]


def _ring_nodes(ring: Ring) -> tuple[list[float], list[Section]]:
    """Angles of the ring's nodes (deg, ascending) and the section of the element that starts at each."""
    ribbed = Section.rectangle(*ring.ribbed, ring.young)
    strip = Section.rectangle(*ring.open_strip, ring.young)
    keys = sorted({a % 360 for a in (*LEG_ANGLES, *PAIR_SPOKES, *FLANK_SPOKES)})
    angles: list[float] = []
    sections: list[Section] = []
    for start, end in zip(keys, [*keys[1:], keys[0] + 360], strict=True):
        is_open = OPEN_SECTOR[0] <= start and end <= OPEN_SECTOR[1]
        angles += np.linspace(start, end, ring.elements_per_sector, endpoint=False).tolist()
        sections += [strip if is_open else ribbed] * ring.elements_per_sector
    return angles, sections


def leg_end_compliance(ring: Ring) -> Array:
    """(36, 36) displacements of the six leg-end nodes against the hub under unit loads there.

    Order leg by leg, ux uy uz phix phiy phiz each; mm and rad per N and N*mm; platform frame.
    """
    angles, sections = _ring_nodes(ring)
    n = len(angles)
    turn = np.radians(angles)
    nodes = [ring.radius * np.array([np.cos(t), np.sin(t), 0.0]) for t in turn]
    elements = [(i, (i + 1) % n, s) for i, s in enumerate(sections)]
    clamped: list[int] = []
    for angle, section in ring.spokes():
        outer = angles.index(angle)
        direction = nodes[outer] / ring.radius
        chain = [outer]
        for r in np.linspace(ring.radius, ring.hub_radius, ring.elements_per_spoke + 1)[1:]:
            chain.append(len(nodes))
            nodes.append(r * direction)
        clamped.append(chain[-1])
        elements += [(i, j, section) for i, j in pairwise(chain)]
    K = assemble(np.array(nodes), elements, UP)
    free = np.array([d for d in range(len(K)) if d // 6 not in clamped])
    leg_nodes = [angles.index(a % 360) for a in LEG_ANGLES]
    loads = np.zeros((len(K), 36))
    for k, node in enumerate(leg_nodes):
        loads[6 * node : 6 * node + 6, 6 * k : 6 * k + 6] = np.eye(6)
    displacement = np.zeros_like(loads)
    displacement[free] = np.linalg.solve(K[np.ix_(free, free)], loads[free])
    return np.asarray(loads.T @ displacement)


def leg_end_nodes(ring: Ring) -> Array:
    """(6, 3) nominal leg ends on the ring's axis, platform frame, mm."""
    t = np.radians(LEG_ANGLES)
    return ring.radius * np.stack([np.cos(t), np.sin(t), np.zeros(6)], axis=1)
