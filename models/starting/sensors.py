"""Sections ``sensor:`` to start from, each with the words that explain it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Preset:
    """A sensor's section in mm and deg, its columns with their units (empty for labels and numbers of rows), what it is in a
    line, and whether its readings show how the tool is turned."""

    section: Mapping[str, Any]
    columns: Mapping[str, str]
    words: str
    sees_rotation: bool = True


PRESETS: Mapping[str, Preset] = {
    "pose": Preset(
        {"type": "pose", "sigma": {"xyz": 0.02, "rot": 0.01}},
        {"x": "mm", "y": "mm", "z": "mm", "rx": "deg", "ry": "deg", "rz": "deg"},
        "an instrument that reads position and rotation vector of the tool frame: x y z rx ry rz",
    ),
    "position": Preset(
        {"type": "position", "sigma": {"xyz": 0.02}},
        {"x": "mm", "y": "mm", "z": "mm"},
        "a laser tracker on one reflector, which is the tool frame's origin: x y z",
        sees_rotation=False,
    ),
    "targets": Preset(
        {
            "type": "targets",
            "points": {"P1": [100, 0, 0], "P2": [0, 100, 0], "P3": [-100, 0, 0]},
            "sigma": {"xyz": 0.02},
            "tolerance": {"points": 0.05},
        },
        {f"P{k}.{axis}": "mm" for k in (1, 2, 3) for axis in "xyz"},
        "a tracker or cameras on several points of the tool body, whose places in the tool frame are points: P1.x P1.y ...",
    ),
    "ballbar": Preset(
        {
            "type": "ballbar",
            "centre": [0, 0, 0],
            "ball": [0, 0, 0],
            "sigma": {"distance": 0.002},
            "tolerance": {"centre": 0, "ball": 0},
        },
        {"length": "mm"},
        "a ball bar between a ball at centre (the origin of the sensor's frame) and the tool frame's origin: length",
        sees_rotation=False,
    ),
    "socket": Preset(
        {"type": "socket", "ball": [0, 0, 0], "sigma": {"xyz": 0.02}, "tolerance": {"ball": 0}},
        {"placement": "", "socket": ""},
        "a ball on the tool that is seated again and again in fixed sockets: placement and socket say in which",
        sees_rotation=False,
    ),
    "distance": Preset(
        {
            "type": "distance",
            "beam": {"in": "world", "xyz": [0, 0, 0], "rx": 0, "rz": 0},
            "mirror": {"in": "flange", "z": 0, "rx": 0, "ry": 0},
            "sigma": {"distance": 0.00001},
            "tolerance": {"beam.xyz": 2, "beam.angle": 2, "mirror.z": 1, "mirror.angle": 2},
        },
        {"dL": "mm", "pose": "", "from": ""},
        "an interferometer: change of the distance along a beam to a mirror on the flange since row from: dL",
        sees_rotation=False,
    ),
}
"""By the name of ``--sensor``."""

__all__ = ["PRESETS", "Preset"]
