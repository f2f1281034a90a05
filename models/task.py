"""Which components of the tool's pose a machine has to meet: its task.

Positions count along the axes of the base, turns about the axes of the tool, where it should be. ``axis`` is the
direction of the tool's z axis, whatever the turn about it; ``axis.x`` and ``axis.y`` are those of the others. The
inverse in numpy and the generated C solve the same conditions: those of ``Task.gap`` and ``Task.turns``.

Next to a pose where a joint turns the tool no longer, it may move only so far for a small turn: ``CALM``, ``FARTHEST``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models import lie
from truepose.models.lie import AXES
from truepose.wording import joined

AXIS: Final = {"axis": 2, "axis.x": 0, "axis.y": 1}
"""Which of the tool's axes each direction is of."""
COMPONENTS: Final = (*AXES, *AXIS)
"""What a task may ask for: x y z along the axes of the base, rx ry rz about those of the tool, the direction of one of them."""
CALM: Final = 0.2
"""Turn of the tool by a turn of a joint, about rad a rad, from which no pose counts as next to a singular one."""
FARTHEST: Final = 0.05
"""rad that a joint may move for a turn that it makes slowly."""
NOTHING: Final = 5e-10
"""rad; a turn below this is met as it is."""
_OPPOSITE = 1e-6
"""One plus the cosine of an angle at which directions count as opposite: no way to turn is the shorter one."""


@dataclass(frozen=True)
class Task:
    """Components of the pose that have to be met, in the order of ``COMPONENTS``. A whole pose has the first six."""

    components: tuple[str, ...] = AXES

    @classmethod
    def of(cls, names: Sequence[str]) -> Task:
        """Return the task of these components; the axis together with the turn about it is the whole rotation.

        Raises ValueError, with what was expected, for unknown names, repeats and contradictions.
        """
        unknown = [name for name in names if name not in COMPONENTS]
        if unknown or not names or len(set(names)) < len(names):
            raise ValueError(f"one or several of {joined(COMPONENTS)}, each once")
        axes, turns = [name for name in names if name in AXIS], {name for name in names if name in AXES[3:]}
        if axes and (len(axes) > 1 or turns - {AXES[3 + AXIS[axes[0]]]}):
            raise ValueError(
                "one direction of an axis, which holds both turns across it, and at most the turn about it"
            )
        rotation = AXES[3:] if axes and turns else names
        chosen = {name for name in (*names, *rotation) if not (turns and name in axes)}
        return cls(tuple(name for name in COMPONENTS if name in chosen))

    @property
    def is_whole(self) -> bool:
        """True if the whole pose counts."""
        return self.components == AXES

    @property
    def axis(self) -> int | None:
        """The axis of the tool whose direction counts, and not the turn about it; None where there is none."""
        return next((AXIS[name] for name in self.components if name in AXIS), None)

    @property
    def along(self) -> tuple[int, ...]:
        """Axes of the base along which the position counts."""
        return tuple(k for k in range(3) if AXES[k] in self.components)

    @property
    def about(self) -> tuple[int, ...]:
        """Axes of the tool about which the rotation counts."""
        if self.axis is not None:
            return tuple(sorted({0, 1, 2} - {self.axis}))
        return tuple(k for k in range(3) if AXES[3 + k] in self.components)

    @property
    def rows(self) -> tuple[int, ...]:
        """Rows that count of a twist, the velocity along the axes of the base and the turn about those of the tool."""
        return (*self.along, *(3 + k for k in self.about))

    @property
    def position(self) -> Task | None:
        """The same without turns; None where it has none, or no position, and for the whole pose."""
        along = tuple(AXES[k] for k in self.along)
        return Task(along) if along and self.about and not self.is_whole else None

    @property
    def words(self) -> str:
        """What has to be met, for readers."""
        if self.is_whole:
            return "the whole pose"
        position, turns = joined(AXES[k] for k in self.along), joined("xyz"[k] for k in self.about)
        within = "" if len(self.along) == len("xyz") else " along axes of the base"
        parts = [f"{position} of the tool's position{within}"] if position else []
        if self.axis is not None:
            parts.append(f"the direction of the tool's {'xyz'[self.axis]} axis")
        elif turns:
            parts.append(f"the turn about the tool's {turns} ax{'is' if len(self.about) == 1 else 'es'}")
        return " and ".join(parts)

    def turns(self, goal: ca.SX, rotation: ca.SX) -> ca.SX:
        """Return how far a rotation (3, 3) is turned from its goal (3, 3) about each axis of ``about``, (k,).

        To first order rad; twice the tangent of half the angle. Zero where, and only where, the goal is met.
        """
        from_goal = goal.T @ rotation
        if self.axis is not None:
            seen = from_goal[:, self.axis]
            across = ca.cross(ca.DM.eye(3)[:, self.axis], seen)
            return _half_tangents(across[list(self.about)], 1 + seen[self.axis])
        sines = lie.vee(from_goal)[list(self.about)]
        return _half_tangents(sines, 0.5 * (1 + ca.trace(from_goal)))

    def gap(self, goal: ca.SX, pose: ca.SX, base: ca.SX) -> ca.SX:
        """Return what is left from a goal to a pose (4, 4), mm and rad, (6,); zero in places that do not count.

        ``base`` (3, 3) turns the axes of the base into those that poses are given in.
        """
        place = pose[:3, 3] - goal[:3, 3]
        if self.is_whole:
            return ca.vertcat(place, lie.log_so3_sx(pose[:3, :3] @ goal[:3, :3].T))
        out = ca.SX.zeros(6)
        out[list(self.along)] = (base.T @ place)[list(self.along)]
        if self.about:
            out[[3 + k for k in self.about]] = self.turns(goal[:3, :3], pose[:3, :3])
        return out

    def counted(self, twists: Array, goals: Array, base: Array) -> Array:
        """Return the part (n, 6) of twists from goals (n, 4, 4) that counts, in the same axes, [mm, rad].

        ``base`` (3, 3) as in ``gap``. The rest of a twist is what the task does not ask for.
        """
        if self.is_whole:
            return twists
        tool, out = goals[:, :3, :3], np.zeros_like(twists)
        along = base[:, list(self.along)]
        out[:, :3] = twists[:, :3] if len(self.along) == len(base) else twists[:, :3] @ along @ along.T
        if self.axis is not None:
            axis = tool[:, :, self.axis]
            moved = (lie.exp_so3(twists[:, 3:]) @ axis[..., None])[..., 0]
            across = np.cross(axis, moved)
            sine = np.linalg.norm(across, axis=1, keepdims=True)
            angle = np.arctan2(sine, np.sum(axis * moved, axis=1, keepdims=True))
            out[:, 3:] = across * np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 1.0)
        else:
            about = tool[:, :, list(self.about)]
            out[:, 3:] = np.einsum("nik,njk,nj->ni", about, about, twists[:, 3:])
        return out


WHOLE: Final = Task()


def _half_tangents(sines: ca.SX, denominator: ca.SX) -> ca.SX:
    """Return twice the tangents of half the angles with these sines and one plus their cosine; 1 where this is nothing."""
    is_opposite = denominator <= _OPPOSITE
    return ca.if_else(is_opposite, 1.0, 2 * sines / ca.if_else(is_opposite, 1.0, denominator))
