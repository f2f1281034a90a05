"""The arm's chain with motions that should not be, and what gravity does to it.

Values beside the drawing's parameters are small motions, x y z (mm) rx ry rz (rad): ``qK.motion.*`` moves the axis of
joint K (in the frame that carries it, before the joint turns), ``base.motion.*`` the robot on its stand,
``tool.motion.*`` the tool on the flange.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import rigid
from .arm_drawing import AXES, GRAVITY, JOINTS, MASSES
from .base import Array
from .ported import Work

TOOL = len(JOINTS) + 1
MM = 1e-3


@dataclass(frozen=True)
class ArmPose:
    """Frames in the world: ``axes`` (n, 6, 4, 4) of the joints, z the axis, before they turn; ``links`` (n, 7, 4, 4), the
    stand first; ``tool`` (n, 4, 4). Masses: ``spots`` (n, m, 3) mm, ``weights`` (n, m, 3) N and ``bodies`` (m,), the
    number of the link (7: the tool).
    """

    axes: Array
    links: Array
    tool: Array
    spots: Array
    weights: Array
    bodies: NDArray[np.int64]

    def borne(self, link: int) -> tuple[Array, Array]:
        """(n, 3) N of what lies beyond the outer end of a link, and its moment (n, 3) N*mm about that end."""
        end = self.axes[:, link, :3, 3] if link < len(JOINTS) else self.links[:, -1, :3, 3]
        return self._wrench(self.bodies > link, end)

    def moment(self, link: int, about: Array) -> Array:
        """(n, 3) N*m of the weight of ``link`` and what it carries, about points (n, 3), world axes."""
        return self._wrench(self.bodies >= link, about)[1] * MM

    def torque(self, joint: int) -> Array:
        """(n,) N*m that gravity exerts about the axis of a joint (0 to 5)."""
        frame = self.axes[:, joint]
        moment = self.moment(joint + 1, frame[:, :3, 3])
        return np.asarray(np.einsum("ni,ni->n", moment, frame[:, :3, 2]))

    def _wrench(self, beyond: NDArray[np.bool_], about: Array) -> tuple[Array, Array]:
        force = self.weights[:, beyond]
        arm = self.spots[:, beyond] - about[:, None]
        return force.sum(axis=1), np.cross(arm, force).sum(axis=1)


def pose(work: Work) -> ArmPose:
    """The arm in every row."""
    n = len(work)
    world = rigid.frame(
        rigid.roll_pitch_yaw(*(work.value(f"base.{a}") for a in AXES[3:])),
        work.stacked(tuple(f"base.{a}" for a in AXES[:3])),
    )
    down = world[:, :3, :3] @ np.array(GRAVITY)
    links, axes = [world @ _motion(work, "base")], []
    turned = work.campaign.q + work.moved
    for k, joint in enumerate(JOINTS):
        beta, alpha, d, theta, r = (work.value(f"{joint}.{f}") for f in ("beta", "alpha", "d", "theta", "r"))
        tilt = rigid.turn(1, beta) @ rigid.turn(0, alpha)
        axes.append(links[-1] @ rigid.frame(tilt, tilt[:, :, 0] * d[:, None]) @ _motion(work, joint))
        along = np.stack([np.zeros(n), np.zeros(n), r], axis=-1)
        links.append(axes[-1] @ rigid.frame(rigid.turn(2, theta + turned[:, k]), along))
    hand = rigid.frame(
        rigid.roll_pitch_yaw(*(work.value(f"tool.{a}") for a in AXES[3:])),
        work.stacked(tuple(f"tool.{a}" for a in AXES[:3])),
    )
    tool = links[-1] @ _motion(work, "tool") @ hand
    spots, weights = _masses(work, links, tool, down)
    return ArmPose(np.stack(axes, 1), np.stack(links, 1), tool, spots, weights, BODIES)


def seen_points(work: Work, targets: tuple[str, ...]) -> Array:
    """(n, 3 k) points of the tool in the tracker's frame, mm; its origin without targets."""
    tool = work.solved.tool
    if not targets:
        return np.array(tool[:, :3, 3])
    points = [work.stacked(tuple(f"{name}.{a}" for a in "xyz")) for name in targets]
    return np.concatenate(
        [tool[:, :3, 3] + np.einsum("nij,nj->ni", tool[:, :3, :3], p) for p in points], axis=1
    )


def body_number(body: str) -> int:
    """Of ``linkK`` or ``tool``."""
    return TOOL if body == "tool" else int(body.removeprefix("link"))


BODIES = np.array([body_number(body) for body, _, _ in MASSES.values()])


def _motion(work: Work, name: str) -> Array:
    twist = work.stacked(tuple(f"{name}.motion.{a}" for a in AXES))
    return rigid.moved(twist)


def _masses(work: Work, links: list[Array], tool: Array, down: Array) -> tuple[Array, Array]:
    """(n, m, 3) centres of mass and weights, world."""
    spots, weights = [], []
    for name, (body, kg, com) in MASSES.items():
        frame = tool if body == "tool" else links[body_number(body)]
        spots.append(frame[:, :3, :3] @ np.array(com) + frame[:, :3, 3])
        mass = work.campaign.payload if name == "payload" else np.full(len(work), kg)
        weights.append(mass[:, None] * down)
    return np.stack(spots, 1), np.stack(weights, 1)
