"""A start as files: the commented machine file, and an empty recording with the columns that the machine needs."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jinja2

from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_write_text
from truepose.models.file.names import SCHEMA_LINE
from truepose.models.file.yaml_document import flow_text, parse_document
from truepose.models.leaves.starting.start import UPRIGHT, Start, readings_of, tidy
from truepose.wording import joined


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
    made = {STAR: _star, "angle": _encoders}
    found = (made[part](readings) if part in made else PRESETS[part] for part in parts)
    return tuple(_apart(preset, readings) for preset in found)


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


_UNKNOWN = float("inf")
_TOLD = {"xyz": 1.0, "rpy": 0.5}
"""mm and deg, 1-sigma of a frame that was told without a tolerance."""
_WORDS = {
    "standard": "Standard Denavit-Hartenberg: RotZ(theta) TransZ(d) TransX(a) RotX(alpha), a and alpha beyond the joint.",
    "modified": "Craig's: RotX(alpha) TransX(a) RotZ(theta) TransZ(d), a and alpha before the joint.",
    "khalil": "Khalil's: RotY(beta) RotX(alpha) TransX(d) RotZ(theta) TransZ(r), d is the length of the link.",
}
_FORMS = {
    "6-ups": "Six legs from a (base) to b (platform).",
    "mount": "Two axes that point a tube. CHECK latitude (north counts positive): it says which way gravity pulls.",
    "graph": "A joint's frame stands at xyz, rpy in its parent; it moves about or along axis.",
    "urdf": "The chain between two links of a URDF.",
}


@dataclass(frozen=True)
class Asked:
    """What was told of the frames (xyz mm and rpy deg; None: unknown) and which sensor measures (empty: the start's own)."""

    base: tuple[float, ...] | None = None
    tool: tuple[float, ...] | None = None
    sensor: str = ""


@dataclass(frozen=True)
class Written:
    """Texts of the two files."""

    machine_text: str
    recording_text: str

    @property
    def header(self) -> str:
        """The recording's columns."""
        return self.recording_text.splitlines()[-1]


def written(start: Start, asked: Asked) -> Written:
    """Both texts; nothing is written. Raises InputError for an unknown sensor."""
    chosen = presets(asked.sensor or start.sensor, _readings(start))
    return Written(_machine_text(start, asked, chosen), _recording_text(start, chosen))


def verify(files: Written, path: Path) -> None:
    """Build the machine that is to stand at ``path``. Raises InputError where that cannot be done."""
    from truepose.models.file.machine_file import checked_machine
    from truepose.models.load import (
        build_machine,
    )  # the symbolic core takes longer to load than all else here

    build_machine(checked_machine(path, parse_document(files.machine_text, path)))


def write(files: Written, path: Path, recording: Path | None) -> None:
    """Both files, or the machine file alone: whole, and both in one step."""
    if recording is None:
        atomic_write_text(path, files.machine_text)
        return
    with atomic_directory(path.parent) as partial:
        atomic_write_text(partial / path.name, files.machine_text)
        atomic_write_text(partial / recording.name, files.recording_text)


def _machine_text(start: Start, asked: Asked, chosen: Sequence[Preset]) -> str:
    mechanism = tidy(dict(start.mechanism))
    return (
        _environment()
        .get_template("machine.yaml.j2")
        .render(
            schema_line=SCHEMA_LINE,
            start=start,
            upright=start.gravity == UPRIGHT,
            mechanism=textwrap.indent(_mechanism_text(mechanism), "  "),
            mechanism_words=_mechanism_words(mechanism),
            frames=_frames(start, asked, chosen),
            sensors=[preset.section for preset in chosen],
            sensor_words=joined(preset.words for preset in chosen),
            example_body={"6-ups": "platform", "mount": "tube"}.get(mechanism["type"], "flange"),
            first_joint=next(iter(_readings(start))),
        )
    )


def _mechanism_words(mechanism: Mapping[str, Any]) -> str:
    if mechanism["type"] == "serial":
        return _WORDS[mechanism.get("convention", "khalil")]
    return _FORMS.get(mechanism["type"], "")


def _mechanism_text(mechanism: Mapping[str, Any]) -> str:
    """YAML of the section: joints and legs one on a line."""
    out = []
    for key, value in mechanism.items():
        if key in ("joints", "legs") and isinstance(value, list):
            out += [f"{key}:", *(f"  - {flow_text(row)}" for row in value)]
        else:
            out.append(f"{key}: {flow_text(value)}")
    return "\n".join(out)


def _frames(start: Start, asked: Asked, chosen: Sequence[Preset]) -> dict[str, Any]:
    place, turn = any(p.sees_place for p in chosen), any(p.sees_rotation for p in chosen)
    base = _frame("world", asked.base, sees_place=place, sees_rotation=place or turn)
    tool = _frame("flange", asked.tool, sees_place=place, sees_rotation=turn)
    own = start.frames
    return {
        "base": own["base"] if asked.base is None and "base" in own else base,
        "tool": own["tool"] if asked.tool is None and "tool" in own else tool,
    }


def _frame(
    parent: str, told: tuple[float, ...] | None, *, sees_place: bool, sees_rotation: bool
) -> dict[str, Any]:
    """A frame told or unknown; a place and a rotation that no reading shows are taken as they stand."""
    values = [*(told or ()), *([0.0] * (6 - len(told or ())))]
    tolerance = dict(_TOLD) if told else {"xyz": _UNKNOWN, "rpy": _UNKNOWN}
    if not sees_place:
        tolerance["xyz"] = 0.0
    if not sees_rotation:
        tolerance["rpy"] = 0.0
    return {"in": parent, "xyz": values[:3], "rpy": values[3:], "tolerance": tolerance}


def _readings(start: Start) -> Mapping[str, str]:
    return start.readings or readings_of(start.mechanism)


def _recording_text(start: Start, chosen: Sequence[Preset]) -> str:
    readings = _readings(start)
    columns = {**readings, **{name: unit for preset in chosen for name, unit in preset.columns.items()}}
    by_unit: dict[str, list[str]] = {}
    for name, unit in columns.items():
        by_unit.setdefault(unit, []).append(name)
    first, unit = next(iter(readings.items()))
    return (
        _environment()
        .get_template("recording.csv.j2")
        .render(
            name=start.called,
            units="; ".join(f"{' '.join(names)} in {unit}" for unit, names in by_unit.items() if unit),
            example=f"{first} [{'rad' if unit == 'deg' else 'um'}]",
            first=first,
            header=",".join(columns),
        )
    )


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("truepose.models.leaves.starting"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["flow"] = lambda value: flow_text(tidy(value))
    environment.filters["comment"] = _comment
    return environment


def _comment(line: str) -> str:
    """A line of text as comments of at most 118 characters; addresses stay whole."""
    return "\n".join(
        textwrap.wrap(
            line,
            118,
            initial_indent="# ",
            subsequent_indent="#   ",
            break_long_words=False,
            break_on_hyphens=False,
        )
    )
