"""All solutions of a six-joint arm of any geometry, by elimination (Raghavan and Roth 1990; Manocha and Canny 1994).

E1 E2 ... E6 = G is the loop of the arm's screws Ek (turns or slides) with the displacement G of its tool from readings zero.
Joint 6 moves neither a point p on its axis nor its direction l, so E3 E4 E5 (p, l) = E2^-1 E1^-1 G (p, l). Fourteen
numbers of a point and a direction follow a rigid motion linearly: p, p.p, l, p.l, p x l and (p.p) l - 2 (p.l) p. They are
bilinear in sine and cosine on each side. Eight of the fourteen equations eliminate joints 1 and 2; the other six, and the
same six times the half-angle of joint 4, are twelve equations for twelve power products of joints 4 and 5. Their
determinant is a trigonometric polynomial of degree 8 in joint 3, whose real zeros are the solutions.

Which joint is taken for the first can be chosen, as the loop is closed. Where axes meet or are parallel the determinant
vanishes altogether for some choices: ``elimination_of`` tries all on poses with known readings. Where none finds every
one, the screws are moved a little: the solutions of an arm nearby are good starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array
from truepose.codegen.chain import ChainExpressions, jacobians_and_tools
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.states import across

DEGREE = 8
"""Of the determinant in joint 3: an arm has 16 solutions at most."""
NUDGE = 4e-5
"""How far screws of special arms are moved: rad, and parts of the reach. More moves the solutions away: of 192 poses of three
drawings (CRX-10iA, Gen3 lite, UR10) 191 had a start within _NEAR of their readings, 172 at ten times this, 94 at fifty."""
SAMPLES = 24
"""Poses that a choice of the first joint is tried on."""
_ENOUGH = 0.9
"""Share of the poses that a choice must find."""
_NEAR = 0.03
"""Largest distance (rad, parts of the reach) of a start from its solution: Newton's method gets there from farther."""
_HALF_ANGLE = np.array([[1.0, -1.0, 0.0], [0.0, 0.0, 2.0], [1.0, 1.0, 0.0]])
"""Factors of x^2, x and 1 (over 1 + x^2) for those of 1, cos and sin."""
_TURNED = np.array([[0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 1.0]])
"""Factors of 1, cos and sin for values at angles 0, pi and pi / 2."""
_SLID = np.array([[-1.0, 0.5, 0.5], [0.0, 0.5, -0.5], [1.0, 0.0, 0.0]])
"""Factors of d^2, d and 1 for values at 0, 1 and -1."""


@dataclass(frozen=True)
class Screws:
    """Joints at readings zero: unit axes (6, 3), points on them (6, 3) from the tool, in parts of the reach, and kinds (6,).

    ``turns`` says which joints turn; the others slide.
    """

    axes: Array
    points: Array
    turns: tuple[bool, ...]

    def motion(self, k: int, value: float) -> tuple[Array, Array]:
        """Rotation (3, 3) and shift (3,) of joint k by an angle, or a length in parts of the reach."""
        if not self.turns[k]:
            return np.eye(3), value * self.axes[k]
        c, s, (x, y, z) = np.cos(value), np.sin(value), self.axes[k]
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotation = c * np.eye(3) + s * cross + (1.0 - c) * np.outer(self.axes[k], self.axes[k])
        return rotation, self.points[k] - rotation @ self.points[k]

    def from_joint(self, first: int, G: tuple[Array, Array]) -> Screws:
        """The same loop, begun with another joint: those before it follow the last, as the tool has moved them."""
        rotation, shift = G
        axes = np.vstack([self.axes[first:], self.axes[:first] @ rotation])
        points = np.vstack([self.points[first:], (self.points[:first] - shift) @ rotation])
        return Screws(axes, points, self.turns[first:] + self.turns[:first])


@dataclass(frozen=True)
class Elimination:
    """Which joint is taken for the first, which joints turn, and how much axes and points (6, 3) are moved first."""

    first: int
    turns: tuple[bool, ...]
    tilts: Array
    shifts: Array


def elimination_of(
    model: SymbolicModel,
    chain: ChainExpressions,
    reach: float,
    turning: Sequence[bool],
    vectors: Sequence[tuple[Array, Array]],
) -> Elimination | None:
    """The choice that finds the readings of most of ``vectors`` (readings, pose); None where none finds nearly all."""
    found = screws_of(model, chain, reach, turning)
    if found is None:
        return None
    screws, tool, units = found
    samples = [(q * units, displacement(pose[:3], tool, reach)) for q, pose in vectors[:SAMPLES]]
    sequence = np.random.default_rng(1)
    tilts, shifts = np.round(NUDGE * sequence.uniform(-1, 1, (2, 6, 3)), 9)
    firsts = [k for k in range(6) if screws.turns[(k + 2) % 6] and screws.turns[(k + 5) % 6]]
    best, chosen = (_ENOUGH, -np.inf), None
    for size in (0.0, 1.0, 10.0):
        moved = replace(screws, axes=_unit(screws.axes + size * tilts), points=screws.points + size * shifts)
        for first in firsts:
            errors = _errors(moved, first, samples)
            score = (float(np.mean(errors < _NEAR)), -float(np.max(errors)))
            if score > best:
                best, chosen = score, Elimination(first, screws.turns, size * tilts, size * shifts)
        if best[0] == 1.0:
            break
    return chosen


def screws_of(
    model: SymbolicModel, chain: ChainExpressions, reach: float, turning: Sequence[bool]
) -> tuple[Screws, Array, Array] | None:
    """Screws of a chain of six readings, its tool (3, 4) at readings zero, mm, and units (6,) of the readings.

    The units are rad, or parts of the reach. None where a joint neither turns by its reading nor slides.
    """
    (jacobian,), (tool,) = jacobians_and_tools(model, chain, np.zeros((1, 6)), 1.0)
    v, w = jacobian[:3].T, jacobian[3:].T
    turn, slide = np.linalg.norm(w, axis=1), np.linalg.norm(v, axis=1)
    turns = turn > 0.5
    if not np.all(
        np.where(turns, np.array(turning) & (np.abs(turn - 1.0) < 0.05), turn * reach < 1e-3 * slide)
    ):
        return None
    points = np.where(turns[:, None], np.cross(w, v) / np.maximum(turn, 0.5)[:, None] ** 2, 0.0)
    axes = np.where(turns[:, None], w, v)
    kinds = tuple(bool(t) for t in turns)
    return Screws(_unit(axes), points / reach, kinds), tool, np.where(turns, 1.0, slide / reach)


def displacement(pose: Array, tool: Array, reach: float) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,), in parts of the reach, about the tool (3, 4) at readings zero, to a pose (3, 4)."""
    return pose[:, :3] @ tool[:, :3].T, (pose[:, 3] - tool[:, 3]) / reach


def solutions(screws: Screws, G: tuple[Array, Array], first: int) -> Array:
    """All solutions (m, 6) of E1 ... E6 = G, in rad and parts of the reach, with joint ``first`` taken for the first."""
    loop = screws.from_joint(first, G)
    left, right = _left(loop), _right(loop, G)
    eliminated = np.linalg.svd(right[1:].T)[0][:, 8:].T  # (6, 14): what is across joints 1 and 2
    terms = np.einsum("ra,ijka->irjk", eliminated, left)
    ones = [np.array([1.0, 0.0, 1.0]) if loop.turns[k] else np.array([0.0, 0.0, 1.0]) for k in (3, 4)]
    terms[0] -= np.einsum("r,j,k->rjk", eliminated @ right[0], *ones)
    twelve = np.zeros((3, 12, 4, 3))
    twelve[:, :6, :3], twelve[:, 6:, 1:] = terms, terms
    matrices = twelve.reshape(3, 12, 12)
    angles = 2 * np.pi * np.arange(2 * DEGREE + 1) / (2 * DEGREE + 1)
    values = np.linalg.det(_at(matrices / np.abs(matrices).max(), angles))
    powers = np.roll(np.fft.fft(values), DEGREE)  # of z^-8 ... z^8
    zeros = np.roots(powers[::-1])
    found = [
        _behind(loop, G, right, matrices, float(np.angle(z))) for z in zeros if abs(np.log(abs(z))) < 0.1
    ]
    return np.roll(np.array(found).reshape(-1, 6), first, axis=1)


def _left(loop: Screws) -> Array:
    """(3, 3, 3, 14): factors of 1, cos, sin of joint 3, and of x^2, x, 1 of joints 4 and 5, in the fourteen numbers."""
    out = np.empty((3, 3, 3, 14))
    for place in np.ndindex(3, 3, 3):
        p, direction = loop.points[5], loop.axes[5]
        for k, sample in zip((4, 3, 2), place[::-1], strict=True):
            rotation, shift = loop.motion(k, _samples(loop, k)[sample])
            p, direction = rotation @ p + shift, rotation @ direction
        out[place] = _fourteen(p, direction)
    factors = [_HALF_ANGLE @ _TURNED if loop.turns[k] else _SLID for k in (3, 4)]
    return np.asarray(np.einsum("ai,bj,ck,ijkn->abcn", _TURNED, *factors, out))


def _right(loop: Screws, G: tuple[Array, Array]) -> Array:
    """(9, 14): factors of 1, cos, sin (d^2, d, 1 last to first) of joint 1 times those of joint 2."""
    out = np.empty((3, 3, 14))
    for place in np.ndindex(3, 3):
        p, direction = G[0] @ loop.points[5] + G[1], G[0] @ loop.axes[5]
        for k, sample in enumerate(place):
            rotation, shift = loop.motion(k, -_samples(loop, k)[sample])
            p, direction = rotation @ p + shift, rotation @ direction
        out[place] = _fourteen(p, direction)
    factors = [_TURNED if loop.turns[k] else _SLID[::-1] for k in (0, 1)]
    return np.asarray(np.einsum("ai,bj,ijn->abn", *factors, out)).reshape(9, 14)


def _behind(loop: Screws, G: tuple[Array, Array], right: Array, matrices: Array, third: float) -> Array:
    """The other joints behind a zero of joint 3."""
    null = np.linalg.svd(_at(matrices, np.array([third]))[0])[2][-1].reshape(4, 3)
    of_4, _, of_5 = np.linalg.svd(null)
    q = np.zeros(6)
    q[2:5] = third, _ratio(of_4[:, 0], loop.turns[3]), _ratio(of_5[0], loop.turns[4])
    p, direction = loop.points[5], loop.axes[5]
    for k in (4, 3, 2):
        rotation, shift = loop.motion(k, q[k])
        p, direction = rotation @ p + shift, rotation @ direction
    products = np.linalg.lstsq(right[1:].T, _fourteen(p, direction) - right[0], rcond=None)[0]
    table = np.concatenate([[1.0], products]).reshape(3, 3)
    q[0] = np.arctan2(table[2, 0], table[1, 0]) if loop.turns[0] else table[1, 0]
    q[1] = np.arctan2(table[0, 2], table[0, 1]) if loop.turns[1] else table[0, 1]
    side = across(loop.axes[5])[0]
    turned = G[0] @ side
    for k in range(5):
        turned = loop.motion(k, q[k])[0].T @ turned
    q[5] = np.arctan2(loop.axes[5] @ np.cross(side, turned), side @ turned)
    return q


def _fourteen(p: Array, direction: Array) -> Array:
    """What follows a rigid motion linearly, of a point and a direction."""
    square, along = p @ p, p @ direction
    last = square * direction - 2.0 * along * p
    return np.concatenate([p, [square], direction, [along], np.cross(p, direction), last])


def _samples(loop: Screws, k: int) -> tuple[float, float, float]:
    return (0.0, np.pi, 0.5 * np.pi) if loop.turns[k] else (0.0, 1.0, -1.0)


def _at(matrices: Array, angles: Array) -> Array:
    """(n, 12, 12) of factors of 1, cos and sin (3, 12, 12)."""
    c, s = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    return np.asarray(matrices[0] + c * matrices[1] + s * matrices[2])


def _ratio(powers: Array, turn: bool) -> float:
    """The joint whose x has these powers, highest first, times any factor; x is the tangent of half a turn."""
    k = int(np.argmax(powers[:-1] ** 2 + powers[1:] ** 2))
    if turn:
        return float(2.0 * np.arctan2(powers[k], powers[k + 1]))
    return float(powers[k] / powers[k + 1]) if powers[k + 1] else np.inf


def _errors(screws: Screws, first: int, samples: Sequence[tuple[Array, tuple[Array, Array]]]) -> Array:
    """How far the solution next to the readings of each sample is off; infinite where there is none."""
    out = []
    for q, G in samples:
        with np.errstate(all="ignore"):
            off = solutions(screws, G, first) - q
            off = np.where(screws.turns, np.mod(off + np.pi, 2 * np.pi) - np.pi, off)
        far = np.nan_to_num(np.abs(off), nan=np.inf).max(axis=1)
        out.append(float(far.min(initial=np.inf)))
    return np.array(out)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
