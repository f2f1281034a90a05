"""Sections ``sensor:`` to start from, each with the words that explain it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from truepose.errors import InputError


@dataclass(frozen=True)
class Preset:
    """A sensor's section in mm and deg, its columns with their units (empty for labels and numbers of rows), what it is in a
    line, and whether its readings show how the tool is turned, and where it is."""

    section: Mapping[str, Any]
    columns: Mapping[str, str]
    words: str
    sees_rotation: bool = True
    sees_place: bool = True


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
    "direction": Preset(
        {"type": "direction", "of": "origin", "sigma": {"angle": "1 arcsec"}},
        {"azimuth": "deg", "elevation": "deg"},
        "a theodolite at the origin of the sensor's frame that sights the tool frame's origin: azimuth (clockwise) elevation",
        sees_rotation=False,
    ),
    "tilt": Preset(
        {"type": "tilt", "sigma": {"angle": "2 arcsec"}, "tolerance": {"zero": 0.1}},
        {"tilt.x": "deg", "tilt.y": "deg"},
        "an inclinometer on the tool: how far its x and y axes point above the horizon: tilt.x tilt.y",
        sees_place=False,
    ),
    "angle": Preset(
        {"type": "angle"},
        {},
        "encoders on the load side of the joints, after gear and play; joints: [..] where not all have one",
        sees_rotation=False,
        sees_place=False,
    ),
}
"""By the name of ``--sensor``."""
STAR = "star"
"""The sensor of a mount, whose angles are called as its axes."""
_ENCODER = (("deg", "angle", "5 arcsec"), ("mm", "length", 0.001))
"""Unit of a joint, and the key and size of ``sigma`` of an encoder on it."""


def presets(names: str, readings: Mapping[str, str]) -> tuple[Preset, ...]:
    """The presets of names with commas between them, for a machine whose joints are ``readings`` (columns with mm or deg).

    Raises InputError for a name that is none, and for one that stands twice.
    """
    parts = [part.strip() for part in names.split(",")]
    for part in parts:
        if part not in (*PRESETS, STAR) or parts.count(part) > 1:
            twice = " twice" * (parts.count(part) > 1)
            raise InputError(
                f"--sensor: found {part!r}{twice}, expected one of {', '.join(PRESETS)}, or several of them with commas between"
            )
    return tuple(_apart(_preset(part, readings), readings) for part in parts)


def _apart(preset: Preset, readings: Mapping[str, str]) -> Preset:
    """Return the preset, with a name that opens its columns where a joint is called as one of them."""
    section, columns = preset.section, preset.columns
    if not columns.keys() & readings.keys():
        return preset
    from truepose.models.machine.sensor import sensors  # takes longer to load than all else here

    if not sensors.get(section["type"], "--sensor").opens_columns:
        return preset
    named = {"type": section["type"], "name": "sensor", **section}
    return replace(preset, section=named, columns={f"sensor.{name}": unit for name, unit in columns.items()})


def _preset(name: str, readings: Mapping[str, str]) -> Preset:
    if name == STAR:
        return _star(readings)
    return _encoders(readings) if name == "angle" else PRESETS[name]


def _star(readings: Mapping[str, str]) -> Preset:
    """The preset of stars seen through a tube, told by the angles of its two axes. Raises InputError where they are not two."""
    if list(readings.values()) != ["deg", "deg"]:
        raise InputError(
            f"--sensor: found {STAR!r} for {len(readings)} joints, expected the two axes of a mount"
        )
    return Preset(
        {"type": "direction", "name": STAR, "angles": list(readings), "sigma": {"angle": "5 arcsec"}},
        {f"{STAR}.{axis}": "deg" for axis in readings},
        "stars in the middle of the field, told by the two angles of where they really stood",
        sees_place=False,
    )


def _encoders(readings: Mapping[str, str]) -> Preset:
    """The preset of encoders on all joints of a machine."""
    kinds = [(key, size) for unit, key, size in _ENCODER if unit in readings.values()]
    section = {"type": "angle", "sigma": dict(kinds), "tolerance": {key: float("inf") for key, _ in kinds}}
    columns = {f"angle.{joint}": unit for joint, unit in readings.items()}
    return replace(PRESETS["angle"], section=section, columns=columns)
