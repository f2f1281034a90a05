"""Forward kinematics and physics of serial arms, in numpy alone: mm, rad, N m.

Rows are (beta, alpha, d, theta, r) of RotY(beta) RotX(alpha) TransX(d) RotZ(theta) TransZ(r).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..pairs import Array
from ..rotations import shift, turn
from .campaign import Campaign

DOWN = 9.80665
EXPANSION = 1.2e-5


@dataclass(frozen=True)
class Physics:
    """What the drawing leaves out; zero where nothing is.

    compliance (n,) rad/(N m), play (n,) mm or rad, wave (n,) mm or rad once a turn of the motor at ``ratio`` (n,),
    heat: whether links grow with the air.
    """

    compliance: Array
    play: Array
    wave: Array
    ratio: Array
    heat: bool = False

    def times(self, factor: float) -> Physics:
        """Return as many times as much of it; heat stays."""
        return replace(
            self, compliance=factor * self.compliance, play=factor * self.play, wave=factor * self.wave
        )

    @property
    def none(self) -> bool:
        """Whether nothing is there."""
        return not (self.compliance.any() or self.play.any() or self.wave.any() or self.heat)


@dataclass(frozen=True)
class Body:
    """A weight: the link it is fixed to (1 to n; n + 1: the tool), kg (NaN: the payload), centre in that frame (mm)."""

    link: int
    kg: float
    com: Array


@dataclass(frozen=True)
class Arm:
    """A specimen: rows (n, 5), which joints slide (n,), base and tool (4, 4), weights."""

    rows: Array
    slides: Array
    base: Array
    tool: Array
    bodies: tuple[Body, ...] = field(default=())


def links(arm: Arm, q: Array, grow: Array | float = 1.0) -> tuple[list[Array], list[Array]]:
    """Frames (n, 4, 4) in the base: of every link, the base first, and of every joint's axis."""
    at = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    frames, axes = [at], []
    for k, (beta, alpha, d, theta, r) in enumerate(arm.rows):
        turned, slid = (0.0, q[:, k]) if arm.slides[k] else (q[:, k], 0.0)
        at = at @ turn("y", beta) @ turn("x", alpha) @ shift(x=d * grow)
        axes.append(at)
        at = at @ turn("z", theta + turned) @ shift(z=r * grow + slid)
        frames.append(at)
    return frames, axes


def tool_poses(arm: Arm, c: Campaign, physics: Physics) -> Array:
    """(n, 4, 4) of the tool as the instrument stands."""
    moved = c.q - 0.5 * physics.play * c.approach + physics.wave * np.sin(physics.ratio * c.q + 0.7)
    if physics.compliance.any():
        moved = moved + physics.compliance * torques(arm, moved, c.payload)
    grow = 1.0 + EXPANSION * (c.temperature - 20.0) if physics.heat else 1.0
    frames, _ = links(arm, moved, grow)
    return np.asarray(arm.base @ frames[-1] @ arm.tool)


def torques(arm: Arm, q: Array, payload: Array) -> Array:
    """(n, nq) N m that gravity exerts about each turning joint; zero for slides. Gravity is -z of the base."""
    frames, axes = links(arm, q)
    frames = [*frames, frames[-1] @ arm.tool]
    out = np.zeros(q.shape)
    for body in arm.bodies:
        at = frames[body.link][:, :3, :3] @ body.com + frames[body.link][:, :3, 3]
        kg = payload if np.isnan(body.kg) else body.kg
        weight = np.zeros((len(q), 3))
        weight[:, 2] = -kg * DOWN
        for k in range(min(body.link, q.shape[1])):
            lever = (at - axes[k][:, :3, 3]) * 1e-3
            out[:, k] += np.einsum("ni,ni->n", np.cross(lever, weight), axes[k][:, :3, 2])
    return np.asarray(np.where(arm.slides, 0.0, out))
