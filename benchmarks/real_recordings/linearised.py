"""A recording about a fit of geometry alone: residuals and exact derivatives by geometry, joints and mounts.

Around that fit the second order is below a micrometre (a milliradian times a millimetre), so every hypothesis about
what is missing is linear least squares on these arrays, and takes seconds where a diagnosis takes minutes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from real_recordings.common import Array, Mask
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

AXES = ("x", "y", "z", "rx", "ry", "rz")
WIDE = {"mm": 1.0, "rad": 1e-3}
"""Prior of a frame that the machine file leaves open: the fit of geometry has found it already."""
GRAVITY = np.array([0.0, 0.0, -9.80665])
MM_TO_M = 1e-3


@dataclass(frozen=True)
class Linearised:
    """One recording of an arm with a 6-D probe, about its fit of geometry.

    residual (n, 6): prediction less reading, mm and rad (rotation in the tool's frame); geometry (n, 6, g) and joint
    (n, 6, nq) its derivatives, by parameters in units of their tolerance and by joint angles (rad); motion: the same by
    six small motions (mm, rad) of base, tool and every joint; q (n, nq) rad; held (n,) held-out rows; position (n, 3) mm
    and rotation (n, 3, 3) of the tool before the tracker; body (nq, n, 4, 4) frames of the nominal links in the base.
    """

    residual: Array
    geometry: Array
    joint: Array
    motion: Mapping[str, Array]
    q: Array
    held: Mask
    position: Array
    rotation: Array
    body: Array
    temperature: Array
    time: Array | None

    def __len__(self) -> int:
        return len(self.q)

    @property
    def steps(self) -> Array:
        """(n, nq) how far each joint went since the row before, rad; 0 in the first row."""
        return np.diff(self.q, axis=0, prepend=self.q[:1])


def linearise(machine_file: Path, recording_file: Path) -> Linearised:
    """Fit geometry robustly, then take residuals and derivatives there."""
    machine = load_machine(machine_file)
    recording = load_recording(machine, [recording_file])
    fit = estimate(machine, recording, loss="huber", start=aligned_start(Predictor(machine, recording)))
    predictor = Predictor(machine, recording, ports=True)
    p = predictor.model.p_home.copy()
    p[: len(fit.p)] = fit.p
    x, _ = predictor.assemble(p)
    blocks = list(predictor.blocks(p, x))
    sigma = np.array([channel.sigma for channel in predictor.channels])
    residual = np.concatenate([b.residual for b in blocks]) * sigma
    jacobian = np.concatenate([b.jacobian for b in blocks]) * sigma[:, None]
    names = list(predictor.model.names)
    joints = machine.mechanism.readings
    poses, _ = predictor.poses(p, x)
    tolerance = [
        q.tolerance
        if 0 < q.tolerance < np.inf
        else WIDE["rad" if q.unit == "rad" else "mm"] * (q.tolerance > 0)
        for q in machine.parameters
    ]
    temperature = recording.driver("temperature.air")
    return Linearised(
        residual,
        jacobian[:, :, : len(tolerance)] * np.array(tolerance),
        jacobian[:, :, [names.index(f"{j}.displacement") for j in joints]],
        {
            m: jacobian[:, :, [names.index(f"{m}.motion.{a}") for a in AXES]]
            for m in ("base", "tool", *joints)
        },
        recording.q,
        recording.validation,
        poses[:, :3, 3],
        poses[:, :3, :3],
        link_frames([machine.geometry[f"{j}.{c}"].nominal for j in joints for c in _DH], recording.q),
        np.zeros(len(recording)) if temperature is None else temperature,
        recording.time,
    )


_DH = ("beta", "alpha", "d", "theta", "r")


def link_frames(constants: list[float], q: Array) -> Array:
    """(nq, n, 4, 4) frames of a serial arm's links in its base, mm: RotY RotX TransX RotZ TransZ for each joint."""
    at, out = np.tile(np.eye(4), (len(q), 1, 1)), []
    for k in range(q.shape[1]):
        beta, alpha, d, theta, r = constants[5 * k : 5 * k + 5]
        cb, sb, ca, sa = np.cos(beta), np.sin(beta), np.cos(alpha), np.sin(alpha)
        fixed = np.array(
            [[cb, sb * sa, sb * ca, cb * d], [0, ca, -sa, 0], [-sb, cb * sa, cb * ca, -sb * d], [0, 0, 0, 1]]
        )
        turn = np.tile(np.eye(4), (len(q), 1, 1))
        c, s = np.cos(theta + q[:, k]), np.sin(theta + q[:, k])
        turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 3] = c, -s, s, c, r
        at = at @ fixed @ turn
        out.append(at)
    return np.array(out)


def gravity_torques(data: Linearised, joint: int) -> Array:
    """(n, m) torque about a joint, N m, of 1 kg at the next links' origins and of 0.1 kg m along each link's axes.

    Any masses and centres of mass are a combination of these columns.
    """
    axis, origin = data.body[joint][:, :3, 2], data.body[joint][:, :3, 3]
    columns = []
    for link in range(joint, data.q.shape[1]):
        arms = [0.1 * data.body[link][:, :3, a] for a in range(3)]
        if link > joint:
            arms.append(MM_TO_M * (data.body[link][:, :3, 3] - origin))
        columns += [np.einsum("ni,ni->n", axis, np.cross(arm, GRAVITY)) for arm in arms]
    return np.array(columns).T
