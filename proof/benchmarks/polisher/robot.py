"""The robot as built, by products of exponentials: joints of one degree of freedom, every source error a twist.

Independent of the library: each limb's loop is closed by six equations against the middle limb, with Newton steps by
the screws of the joints, and errors are exponentials in the joints' frames (appendix A of the paper).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from . import workspace as ws
from .motions import Array, adjoint, exp, gap, inverse, shift

LIMBS, MIDDLE = (1, 2, 3), 4
_NEWTON, _CLOSED = 40, 1e-9
_STILL = np.eye(4)
_AXES = {name: np.eye(6)[k] for k, name in enumerate(("tx", "ty", "tz", "rx", "ry", "rz"))}


@dataclass(frozen=True)
class Element:
    """A nominal offset (4, 4), the error of link ``link`` behind it, then a joint about or along ``axis``."""

    offset: Array
    link: int | None = None
    axis: str | None = None


def limb(k: int) -> tuple[Element, ...]:
    """Limb k from the base to the middle of the platform: universal joint, screw, spherical joint."""
    azimuth, ray = (k - 1) * 2 * np.pi / 3, ws.azimuths()[k - 1]
    axes = ("rx", "ry", "tz", "rx", "ry", "rz")
    joints = [Element(_STILL, link, axis) for link, axis in enumerate(axes)]
    joints[0] = Element(shift(ws.BASE_RADIUS * ray, azimuth), 0, "rx")
    end = inverse(shift(ws.PLATFORM_RADIUS * ray, azimuth))
    return (*joints, Element(_STILL, 6), Element(end))


MIDDLE_LIMB = (
    *(Element(_STILL, link, axis) for link, axis in enumerate(("rx", "ry", "tz"))),
    Element(_STILL, 3),
)
WRIST = (
    Element(shift(np.array([0.0, 0.0, ws.PLATFORM_OFFSET])), None, "rz"),
    Element(_STILL, 4, "ry"),
    Element(_STILL, 5, "rx"),
    Element(shift(np.array([0.0, 0.0, ws.WRIST_OFFSET + ws.HEAD])), 6),
)


@dataclass(frozen=True)
class Robot:
    """What the drawing does not say: twists (6,) of link errors by (link, limb), encoder offsets (6,), mm and rad.

    Limb 4 is the middle limb with the wrist behind it. Link j's twist acts in the frame of joint j + 1, that of the
    last link at the ball's centre or, in limb 4, at the tool frame.
    """

    errors: Mapping[tuple[int, int], Array] = field(default_factory=dict)
    offsets: Array = field(default_factory=lambda: np.zeros(6))

    def tool_poses(self, q: Array, added: Array | float = 0.0) -> Array:
        """(n, 4, 4) tool frame in the workpiece frame at encoder readings ``q`` (n, 6).

        ``added`` (n, 6) are further displacements of the driven joints: what heat and loads do.
        """
        moved = q + self.offsets + added
        wrist, _ = self._forward(WRIST, MIDDLE, moved[:, 3:])
        world = np.eye(4)
        world[:3, :3], world[:3, 3] = ws.WORKPIECE_R_BASE, ws.base_origin()
        out: Array = world @ self.platform_poses(moved[:, :3]) @ wrist
        return out

    def platform_poses(self, lengths: Array) -> Array:
        """(n, 4, 4) platform in the base frame at limb lengths (n, 3). Raises ArithmeticError if loops stay open."""
        middle, limbs = _guess(lengths)
        for _ in range(_NEWTON):
            platform, screws = self._forward(MIDDLE_LIMB, MIDDLE, middle)
            slopes, gaps = np.zeros((len(lengths), 18, 18)), []
            for k, joints in enumerate(limbs):
                end, own = self._forward(limb(k + 1), k + 1, np.insert(joints, 2, lengths[:, k], axis=1))
                gaps.append(gap(end @ inverse(platform)))
                rows = slice(6 * k, 6 * k + 6)
                slopes[:, rows, :3] = -screws
                slopes[:, rows, 3 + 5 * k : 8 + 5 * k] = np.delete(own, 2, axis=2)
            step = np.linalg.solve(slopes, np.hstack(gaps)[..., None])[..., 0]
            middle = middle - step[:, :3]
            limbs = [joints - step[:, 3 + 5 * k : 8 + 5 * k] for k, joints in enumerate(limbs)]
            if np.max(np.abs(step)) < _CLOSED:
                return self._forward(MIDDLE_LIMB, MIDDLE, middle)[0]
        raise ArithmeticError("the loops could not be closed")

    def _forward(self, chain: Sequence[Element], number: int, joints: Array) -> tuple[Array, Array]:
        """Poses (n, 4, 4) at the end of a chain and spatial screws (n, 6, k) of its joints at values (n, k)."""
        pose, screws = np.broadcast_to(_STILL, (len(joints), 4, 4)), []
        for element in chain:
            pose = pose @ element.offset
            twist = self.errors.get((element.link, number)) if element.link is not None else None
            if twist is not None:
                pose = pose @ exp(twist[None])[0]
            if element.axis is not None:
                axis = _AXES[element.axis]
                screws.append(adjoint(pose) @ axis)
                pose = pose @ exp(joints[:, len(screws) - 1, None] * axis)
        return pose, np.stack(screws, axis=2)


def _guess(lengths: Array) -> tuple[Array, list[Array]]:
    """Joint values of the nominal robot with equal limbs: middle limb (n, 3), limbs (n, 5) without their screw."""
    reach = ws.BASE_RADIUS - ws.PLATFORM_RADIUS
    height = np.sqrt(np.mean(lengths, axis=1) ** 2 - reach**2)
    tilt, zero = np.arctan2(-reach, height), np.zeros(len(lengths))
    middle = np.column_stack([zero, zero, height])
    return middle, 3 * [np.column_stack([zero, tilt, zero, -tilt, zero])]
