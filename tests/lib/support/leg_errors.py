"""Legs of a hexapod as measured poses have them, in numpy: how far a fit's readings are from their lengths."""

from __future__ import annotations

import numpy as np

from support.plain_kinematics import frame, frame_of
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.models import lie


def leg_errors(fit: Estimate, recording: Recording) -> np.ndarray:
    """(n, 6) leg length from the measured pose less offset + gain * reading, mm (zero shifts not included)."""
    values = dict(zip(fit.prior.names, fit.p, strict=True))
    for name, value in list(values.items()):
        if name.startswith("wrong-constant@"):
            values[name.removeprefix("wrong-constant@").split(":")[0]] += value
    world = np.tile(np.eye(4), (len(recording), 1, 1))
    world[:, :3, 3] = np.column_stack([recording.observations[c] for c in ("x", "y", "z")])
    world[:, :3, :3] = lie.exp_so3(np.column_stack([recording.observations[c] for c in ("rx", "ry", "rz")]))
    shift = {a: values.get(f"frame-shift@base,session=1:{a}", 0.0) for a in ("x", "y", "z", "rx", "ry", "rz")}
    moved = frame([shift[a] for a in ("x", "y", "z")], [shift[a] for a in ("rx", "ry", "rz")])
    after = (recording.session_rank() >= 1)[:, None, None]
    base = np.where(after, frame_of(values, "base") @ moved, frame_of(values, "base"))
    platform = np.linalg.inv(base) @ world @ np.linalg.inv(frame_of(values, "tool"))
    out = []
    for leg in range(1, 7):
        a, b = (np.array([values[f"leg{leg}.{point}.{c}"] for c in "xyz"]) for point in "ab")
        length = np.linalg.norm(platform[:, :3, :3] @ b + platform[:, :3, 3] - a, axis=1)
        out.append(length - values[f"leg{leg}.offset"] - values[f"leg{leg}.gain"] * recording.q[:, leg - 1])
    return np.array(out).T
