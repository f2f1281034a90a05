"""Table 1 of the paper, the task workspace and its nodes (section 3, Fig. 3), in mm and rad.

Base frame {R0}: origin A0, z from base to platform, limb 1 at azimuth 0. Workpiece frame {R}: z up, origin under the
middle of the workspace, in its lowest layer. The paper's x0 is our y0: with its own x0 (limb 1 along x0 as well) the
nodes would not share a symmetry plane with limbs 2 and 3, as its section 5 says they do.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BASE_RADIUS, PLATFORM_RADIUS = 350.0, 135.0
PLATFORM_OFFSET, WRIST_OFFSET, HEAD, TOOL = 345.0, 405.0, 120.0, 250.0
GAUGE = 200.0
LIMB_RANGE = (628.0, 1178.0)
BETA = np.pi / 6
WIDTH, HEIGHT = 500.0, 120.0
SIGMA = 0.005
"""Noise of one coordinate of a target, mm (section 5)."""
ENCODER_MM, ENCODER_DEG = 2.0, 0.3
"""1-sigma of encoders that were zeroed by hand."""
LAYERS = {"lower": 0.0, "middle": HEIGHT / 2, "upper": HEIGHT}
CENTRE = 1205.0
"""A0 to the wrist's centre at the reference pose. The paper does not say; here the workspace leaves equal parts of
the limbs' stroke at both ends."""
POINTS = {"P1": (0.0, GAUGE, 0.0), "P2": (GAUGE, 0.0, 0.0), "P3": (-GAUGE, 0.0, 0.0)}
"""Targets on the gauge in the tool frame, whose origin is P0; P stands at (0, 0, TOOL) in it."""


def rotation_y(angle: float) -> Array:
    """(3, 3) rotation about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


WORKPIECE_R_BASE = rotation_y(np.pi - BETA)
"""Eq. (8) without its Rot(z, pi/2), which is in our choice of x0."""
REFERENCE = WORKPIECE_R_BASE @ rotation_y(BETA)
"""Orientation of tool and flange in {R}: q4 = 0, q5 = beta, q6 = 0; the tool's z points down."""


def base_origin() -> Array:
    """(3,) A0 in {R}: P stands at the workspace's centre when the wrist's centre is ``CENTRE`` along z0."""
    to_p = np.array([0.0, 0.0, WRIST_OFFSET + HEAD + TOOL])
    centre = np.array([0.0, 0.0, HEIGHT / 2])
    out: Array = centre - REFERENCE @ to_p - WORKPIECE_R_BASE @ np.array([0.0, 0.0, CENTRE])
    return out


def nodes(count: int, layer: str) -> Array:
    """(count^2, 3) positions of P in {R}, row by row of one layer."""
    line = np.linspace(-WIDTH / 2, WIDTH / 2, count)
    y, x = np.meshgrid(line, line, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.full(count**2, LAYERS[layer])])


def layers(count: int, *names: str) -> Array:
    """(n, 3) nodes of several layers, one after the other."""
    return np.concatenate([nodes(count, name) for name in names])


def tool_poses(positions: Array, turns: Array | None = None) -> Array:
    """(n, 4, 4) poses of the tool frame (origin P0) in {R} with P at (n, 3); ``turns`` (n, 3, 3) from the reference."""
    out = np.broadcast_to(np.eye(4), (len(positions), 4, 4)).copy()
    out[:, :3, :3] = REFERENCE if turns is None else turns @ REFERENCE
    out[:, :3, 3] = positions - out[:, :3, 2] * TOOL
    return out


def joints(poses: Array) -> Array:
    """(n, 6) nominal inverse kinematics in closed form: limb lengths in mm, wrist angles in rad.

    The wrist's centre gives direction and length of the middle limb, hence the platform; what is left of the
    orientation is Rz(q4) Ry(q5) Rx(q6).
    """
    turn = np.einsum("ij,njk->nik", WORKPIECE_R_BASE.T, poses[:, :3, :3])
    at = (poses[:, :3, 3] - base_origin()) @ WORKPIECE_R_BASE - turn[:, :, 2] * (WRIST_OFFSET + HEAD)
    length = np.linalg.norm(at, axis=1)
    platform = platform_turn(at / length[:, None])
    middle = platform[:, :, 2] * (length - PLATFORM_OFFSET)[:, None]
    limbs = [
        np.linalg.norm(middle + platform @ (PLATFORM_RADIUS * u) - BASE_RADIUS * u, axis=1)
        for u in azimuths()
    ]
    wrist = platform.transpose(0, 2, 1) @ turn
    q4 = np.arctan2(wrist[:, 1, 0], wrist[:, 0, 0])
    q5 = np.arcsin(-wrist[:, 2, 0])
    q6 = np.arctan2(wrist[:, 2, 1], wrist[:, 2, 2])
    return np.column_stack([*limbs, q4, q5, q6])


def azimuths() -> Array:
    """(3, 3) unit vectors of the limbs' azimuths, 0, 120 and 240 deg."""
    angle = np.arange(3) * 2 * np.pi / 3
    return np.column_stack([np.cos(angle), np.sin(angle), np.zeros(3)])


def platform_turn(direction: Array) -> Array:
    """(n, 3, 3) Rx(a) Ry(b) that turns z to a unit direction (n, 3): what the middle limb's universal joint does."""
    sin_b = direction[:, 0]
    cos_b = np.sqrt(1 - sin_b**2)
    sin_a, cos_a = -direction[:, 1] / cos_b, direction[:, 2] / cos_b
    zero = np.zeros_like(sin_b)
    rows = [
        [cos_b, zero, sin_b],
        [sin_a * sin_b, cos_a, -sin_a * cos_b],
        [-cos_a * sin_b, sin_a, cos_a * cos_b],
    ]
    return np.array(rows).transpose(2, 0, 1)
