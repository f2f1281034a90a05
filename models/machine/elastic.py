"""An elastic rod between two bodies: flexure, bar, flexure in series, clamped at both ends.

The rod's straight, unstrained state is the one at home. The displacements of its far end against the near
end's rigid motion are six relative ones e, and the energy is e' F^-1 e / 2, F the flexibility of the chain as a
cantilever. That is the 12 x 12 stiffness of Gayral and Daney 2012 (INRIA RR-8096, eqs. 20 to 27, whose K12 and K21 are
printed with two wrong signs each) after its inner nodes are condensed, without forming it: sections are round,
so that only the rod's direction counts.

As in the report (eq. 28) the rod keeps the direction it has at home. What it stretches is then wrong by w^2/2l when
its ends move by w across each other; a rod that ``follows`` takes the change of their distance instead.
Motions are small all the same: rotations add as vectors. Forces N, lengths mm, energy N mm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from truepose.models import lie
from truepose.models.machine.mechanism import ElasticChain


@dataclass(frozen=True)
class Segment:
    """One straight piece of a chain: ``length`` (mm), bending EI (N mm^2), tension EA (N), torsion GJ (N mm^2)."""

    length: ca.SX
    bending: ca.SX
    tension: ca.SX
    torsion: ca.SX


@dataclass(frozen=True)
class Flexibility:
    """The far end of a clamped chain under unit loads: ``stretch`` mm/N, ``twist`` rad/(N mm), and across the chain.

    ``tip`` (mm/N) is the deflection by a force, ``slope`` (rad/N) the turn by it, ``turn`` (rad/(N mm)) the turn by a
    moment.
    """

    stretch: ca.SX
    twist: ca.SX
    tip: ca.SX
    slope: ca.SX
    turn: ca.SX

    @classmethod
    def of(cls, segments: list[Segment]) -> Flexibility:
        """Cantilever formulae of each segment, carried to the far end and added."""
        zero = ca.SX(0)
        stretch = twist = tip = slope = turn = zero
        beyond = zero  # from a segment's end to the far end
        for s in reversed(segments):
            own_tip, own_slope, own_turn = (
                s.length**3 / (3 * s.bending),
                s.length**2 / (2 * s.bending),
                s.length / s.bending,
            )
            tip += own_tip + 2 * beyond * own_slope + beyond**2 * own_turn
            slope += own_slope + beyond * own_turn
            turn += own_turn
            stretch += s.length / s.tension
            twist += s.length / s.torsion
            beyond += s.length
        return cls(stretch, twist, tip, slope, turn)

    def energy(self, along: ca.SX, shift: ca.SX, turned: ca.SX) -> ca.SX:
        """N mm of ``shift`` (3,) and small rotation ``turned`` (3,) of the far end, the chain ``along`` a unit vector."""
        drawn, screwed = ca.dot(along, shift), ca.dot(along, turned)
        across, lean = shift - drawn * along, ca.cross(turned, along)
        determinant = self.tip * self.turn - self.slope**2
        bent = (
            self.turn * ca.sumsqr(across) - 2 * self.slope * ca.dot(across, lean) + self.tip * ca.sumsqr(lean)
        )
        return (drawn**2 / self.stretch + screwed**2 / self.twist + bent / determinant) / 2


@dataclass(frozen=True)
class Ends:
    """Where a rod is clamped: frames (4, 4) of its two bodies, and its ball centres (3,), base frame."""

    frame_a: ca.SX
    frame_b: ca.SX
    point_a: ca.SX
    point_b: ca.SX


def strain_energy(
    chain: ElasticChain,
    home: Ends,
    now: Ends,
    length: ca.SX,
    growth: ca.SX,
    values: Mapping[str, ca.SX],
) -> ca.SX:
    """Energy (N mm) of a rod of unstrained ``length`` (mm, between ball centres) plus ``growth`` since home.

    The flexures' middles are where ball joints would be: each reaches half its length beyond (eq. 22).
    """
    flexure = values[chain.flexure_length]
    along = home.point_b - home.point_a
    along = along / ca.norm_2(along)
    half = flexure / 2 * along
    shift_a, turn_a = _moved(home.frame_a, now.frame_a, now.point_a - home.point_a, -half)
    shift_b, turn_b = _moved(home.frame_b, now.frame_b, now.point_b - home.point_b, half)
    carried = shift_a + ca.cross(turn_a, (length + flexure) * along)
    joint = Segment(flexure, *(values[name] for name in chain.flexure))
    bar = Segment(length - flexure, *(values[name] for name in chain.bar))
    chained = Flexibility.of([joint, bar, joint])
    shift = shift_b - carried
    if chain.follows:
        apart = ca.norm_2(now.point_b - now.point_a) - ca.norm_2(home.point_b - home.point_a)
        shift += (apart - ca.dot(along, shift)) * along
    return chained.energy(along, shift - growth * along, turn_b - turn_a)


def _moved(home: ca.SX, now: ca.SX, shift: ca.SX, beyond: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Displacement and small rotation of what a body holds ``beyond`` (3,) a point that moved by ``shift``."""
    turn = now[:3, :3] @ home[:3, :3].T
    return shift + (turn - ca.SX.eye(3)) @ beyond, lie.vee(turn)
