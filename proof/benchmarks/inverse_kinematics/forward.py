"""Forward kinematics of a calibrated arm by products of elementary matrices: numpy, nothing of truepose.

RotY(beta) RotX(alpha) TransX(d) RotZ(theta + q) TransZ(r) a joint (Khalil and Kleinfinger with Hayati), then the tool.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .arms import Arm

Array = NDArray[np.float64]
CLOSE = (1e-6, 1e-9)
"""What counts as solved: mm (1e-9 m), rad."""


def poses(arm: Arm, q: Array) -> Array:
    """(n, 4, 4) poses of the tool in the base frame, mm, at joints ``q`` (n, joints) in rad."""
    out = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for k in range(len(arm.joints)):
        out = out @ placement(arm, k) @ _about_z(q[:, k]) @ _behind(arm, k)
    return np.asarray(out @ arm.tool)


def placement(arm: Arm, k: int) -> Array:
    """(4, 4) from the frame of joint k - 1 to that of joint k at reading zero, without its r along the axis; mm."""
    beta, alpha, d, theta, _ = arm.joints[k]
    y, x, z, shift = np.eye(4), np.eye(4), np.eye(4), np.eye(4)
    y[:3, :3] = [[np.cos(beta), 0, np.sin(beta)], [0, 1, 0], [-np.sin(beta), 0, np.cos(beta)]]
    x[:3, :3] = [[1, 0, 0], [0, np.cos(alpha), -np.sin(alpha)], [0, np.sin(alpha), np.cos(alpha)]]
    z[:3, :3] = [[np.cos(theta), -np.sin(theta), 0], [np.sin(theta), np.cos(theta), 0], [0, 0, 1]]
    shift[0, 3] = d
    return np.asarray(y @ x @ shift @ z)


def placements(arm: Arm) -> Array:
    """(n + 1, 4, 4) fixed offsets of the chain: before each joint, and from the last joint to the tool, mm."""
    n = len(arm.joints)
    offsets = [placement(arm, k) if k == 0 else _behind(arm, k - 1) @ placement(arm, k) for k in range(n)]
    return np.stack([*offsets, _behind(arm, n - 1) @ arm.tool])


def errors(arm: Arm, q: Array, targets: Array) -> tuple[Array, Array]:
    """(n,) distances in mm and angles in rad between the poses at ``q`` (n, joints) and ``targets`` (n, 4, 4)."""
    reached = poses(arm, q)
    distance = np.linalg.norm(reached[:, :3, 3] - targets[:, :3, 3], axis=1)
    E = targets[:, :3, :3] @ reached[:, :3, :3].transpose(0, 2, 1)
    w = np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=1)
    sine, trace = 0.5 * np.linalg.norm(w, axis=1), np.trace(E, axis1=1, axis2=2)
    return distance, np.arctan2(sine, 0.5 * (trace - 1.0))


def solved(
    arm: Arm, q: Array, targets: Array, position: float = CLOSE[0], rotation: float = CLOSE[1]
) -> NDArray[np.bool_]:
    """(n,) whether the joints meet their targets (mm, rad); NaN does not."""
    distance, angle = errors(arm, q, targets)
    return np.asarray((distance <= position) & (angle <= rotation))


def _about_z(angles: Array) -> Array:
    out = np.zeros((len(angles), 4, 4))
    out[:, 0, 0] = out[:, 1, 1] = np.cos(angles)
    out[:, 1, 0] = np.sin(angles)
    out[:, 0, 1] = -out[:, 1, 0]
    out[:, 2, 2] = out[:, 3, 3] = 1.0
    return out


def _behind(arm: Arm, k: int) -> Array:
    out = np.eye(4)
    out[2, 3] = arm.joints[k, 4]
    return out
