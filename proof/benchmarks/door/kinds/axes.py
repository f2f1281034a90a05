"""Readings in a left-handed frame, the other way round, or with their turns told otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from ..pairs import TURNS, XYZ, Pair
from ..rotations import columns, inverse, poses
from .spoilt import Spoilt

Order = Literal["xyz", "XYZ", "ZYX", "ZYZ"]
CONVENTIONS: Mapping[str, Order] = {
    "roll, pitch, yaw": "xyz",
    "Euler xyz, moving": "XYZ",
    "yaw, pitch, roll": "ZYX",
    "Euler zyz": "ZYZ",
}


def handedness(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """One axis of the measuring frame points the other way; a pose is mirrored as a whole."""
    if not pair.points:
        return None
    k = int(rng.integers(3))
    document, table = pair.draft()
    for point in pair.points:
        table[point[k]] = -table[point[k]]
    if pair.sensor == "pose":  # a turn is an axial vector: the other two components change sign
        for j, name in enumerate(TURNS):
            if j != k:
                table[name] = -table[name]
    unknown = not np.isfinite(document["frames"]["base"]["tolerance"]["rpy"])
    own = tuple(point[k] for point in pair.points)
    where = ("xyz"[k], *own, *pair.readings, "readings", "sensor", "base", "xyz")
    return Spoilt(f"-{'xyz'[k]}", document, table, where, kinds=("permutation",) if unknown else ())


def inverse_pose(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """The sensor in the frame of the tool."""
    if pair.sensor != "pose":
        return None
    document, table = pair.draft()
    names = [*XYZ, *TURNS]
    table[names] = columns(inverse(poses(table[names].to_numpy())))
    return Spoilt("inverse", document, table, (*names, "readings", "sensor", "pose", "xyz"))


def rotation_convention(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """``rx ry rz`` hold Euler angles, or the turn from the tool to the base."""
    if pair.sensor != "pose":
        return None
    document, table = pair.draft()
    turns = Rotation.from_rotvec(np.radians(table[list(TURNS)].to_numpy()))
    where = (*TURNS, "readings", "sensor", "rotations", "rotation", "pose")
    if rng.random() < 0.2:
        table[list(TURNS)] = -table[list(TURNS)]
        return Spoilt("transposed", document, table, where)
    variant = str(rng.choice(list(CONVENTIONS)))
    table[[*TURNS]] = turns.as_euler(CONVENTIONS[variant], degrees=True)
    return Spoilt(variant, document, table, where)
