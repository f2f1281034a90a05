"""A start as files: the commented machine file, and an empty recording with the columns that the machine needs."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jinja2

from truepose.errors import InputError
from truepose.models.file.names import SCHEMA_LINE
from truepose.models.file.yaml_document import flow_text, read_document
from truepose.models.leaves.starting.start import UPRIGHT, Start, readings_of, tidy
from truepose.wording import joined


@dataclass(frozen=True)
class Preset:
    """A sensor of ``sensors.yaml``: ``shows`` names what its readings show of the tool, its place and its rotation."""

    section: Mapping[str, Any]
    columns: Mapping[str, str]
    shows: Sequence[str]
    words: str


PRESETS: Mapping[str, Preset] = {
    name: Preset(**entry) for name, entry in read_document(Path(__file__).with_name("sensors.yaml")).items()
}
"""By the name of ``--sensor``."""
STAR = "star"
"""The sensor of a mount, whose angles are called as its axes."""
_ENCODER = (("deg", "angle", "5 arcsec"), ("mm", "length", 0.001))
"""Unit of a joint, and the key and size of ``sigma`` of an encoder on it."""
_UNKNOWN = float("inf")
_TOLD = {"xyz": 1.0, "rpy": 0.5}
"""mm and deg, 1-sigma of a frame that was stated without a tolerance."""
_FORMS = {
    "standard": "Standard Denavit-Hartenberg: RotZ(theta) TransZ(d) TransX(a) RotX(alpha), a and alpha beyond the joint.",
    "modified": "Craig's: RotX(alpha) TransX(a) RotZ(theta) TransZ(d), a and alpha before the joint.",
    "khalil": "Khalil's: RotY(beta) RotX(alpha) TransX(d) RotZ(theta) TransZ(r), d is the length of the link.",
    "6-ups": "Six legs from a (base) to b (platform).",
    "mount": "Two axes that point a tube. CHECK latitude (north counts positive): it says which way gravity pulls.",
    "graph": "A joint's frame stands at xyz, rpy in its parent; it moves about or along axis.",
    "urdf": "The chain between two links of a URDF.",
}
"""What a mechanism's section means, by its convention or its type."""
Place = tuple[float, ...] | None
"""xyz (mm) and perhaps rpy (deg) of a frame; None where it is unknown."""


def files_of(start: Start, base: Place = None, tool: Place = None, sensor: str = "") -> tuple[str, str]:
    """Return the texts of the machine file and of the empty recording; nothing is written.

    ``sensor``: names with commas between them, empty for the start's own. Raises InputError for an unknown sensor.
    """
    readings = start.readings or readings_of(start.mechanism)
    chosen = choose_presets(sensor or start.sensor, readings)
    mechanism = tidy(dict(start.mechanism))
    kind = mechanism["type"]
    place, rotation = (any(what in p.shows for p in chosen) for what in ("place", "rotation"))
    frames = {
        "base": _frame("world", base, sees_place=place, sees_rotation=place or rotation),
        "tool": _frame("flange", tool, sees_place=place, sees_rotation=rotation),
    }
    frames |= {name: start.frames[name] for name, stated in (("base", base), ("tool", tool))
               if stated is None and name in start.frames}  # fmt: skip
    columns = {**readings, **{name: unit for preset in chosen for name, unit in preset.columns.items()}}
    first, unit = next(iter(readings.items()))
    by_unit = {u: [name for name, own in columns.items() if own == u] for u in columns.values() if u}
    words = {
        "schema_line": SCHEMA_LINE,
        "start": start,
        "upright": start.gravity == UPRIGHT,
        "mechanism": textwrap.indent(_mechanism_text(mechanism), "  "),
        "mechanism_words": _FORMS[mechanism.get("convention", "khalil") if kind == "serial" else kind],
        "frames": frames,
        "sensors": [preset.section for preset in chosen],
        "sensor_words": joined(preset.words for preset in chosen),
        "example_body": {"6-ups": "platform", "mount": "tube"}.get(kind, "flange"),
        "first": first,
        "example": f"{first} [{'rad' if unit == 'deg' else 'um'}]",
        "units": "; ".join(f"{' '.join(names)} in {unit}" for unit, names in by_unit.items()),
        "header": ",".join(columns),
    }
    machine, recording = (
        _environment().get_template(f"{name}.j2") for name in ("machine.yaml", "recording.csv")
    )
    return machine.render(words), recording.render(words)


def choose_presets(names: str, readings: Mapping[str, str]) -> tuple[Preset, ...]:
    """Return the presets of names with commas between them, for a machine whose joints are ``readings`` (with mm or deg).

    Where a joint is called as a sensor's column, the sensor gets a name, which opens its columns. Raises InputError for a name
    that is none, and for one that stands twice.
    """
    parts = [part.strip() for part in names.split(",")]
    for part in parts:
        if part not in (*PRESETS, STAR) or parts.count(part) > 1:
            twice = " twice" * (parts.count(part) > 1)
            raise InputError(
                f"--sensor: found {part!r}{twice}, expected one of {', '.join(PRESETS)}, or several of them with commas between"
            )
    return tuple(_preset(part, readings) for part in parts)


def _preset(name: str, readings: Mapping[str, str]) -> Preset:
    if name == STAR:
        return _star(readings)
    preset = PRESETS[name]
    if name == "angle":
        sigma = {key: size for unit, key, size in _ENCODER if unit in readings.values()}
        section = {**preset.section, "sigma": sigma, "tolerance": dict.fromkeys(sigma, _UNKNOWN)}
        columns = {f"angle.{joint}": unit for joint, unit in readings.items()}
        return replace(preset, section=section, columns=columns)
    if preset.columns.keys().isdisjoint(readings):
        return preset
    section = {"type": preset.section["type"], "name": "sensor", **preset.section}
    return replace(
        preset, section=section, columns={f"sensor.{n}": unit for n, unit in preset.columns.items()}
    )


def _star(readings: Mapping[str, str]) -> Preset:
    """Return the preset of stars seen through a tube, stated by the angles of its two axes."""
    if list(readings.values()) != ["deg", "deg"]:
        raise InputError(
            f"--sensor: found {STAR!r} for {len(readings)} joints, expected the two axes of a mount"
        )
    return Preset(
        {"type": "direction", "name": STAR, "angles": list(readings), "sigma": {"angle": "5 arcsec"}},
        {f"{STAR}.{axis}": "deg" for axis in readings},
        ("rotation",),
        "stars in the middle of the field, told by the two angles of where they really stood",
    )


def _mechanism_text(mechanism: Mapping[str, Any]) -> str:
    """Return the YAML of the section: joints and legs one on a line."""
    out = []
    for key, value in mechanism.items():
        if key in ("joints", "legs") and isinstance(value, list):
            out += [f"{key}:", *(f"  - {flow_text(row)}" for row in value)]
        else:
            out.append(f"{key}: {flow_text(value)}")
    return "\n".join(out)


def _frame(parent: str, stated: Place, *, sees_place: bool, sees_rotation: bool) -> dict[str, Any]:
    """Return a frame as stated, or unknown; a place and a rotation that no reading shows are taken as they stand."""
    values = [*(stated or ()), *([0.0] * (6 - len(stated or ())))]
    tolerance = dict(_TOLD) if stated else {"xyz": _UNKNOWN, "rpy": _UNKNOWN}
    if not sees_place:
        tolerance["xyz"] = 0.0
    if not sees_rotation:
        tolerance["rpy"] = 0.0
    return {"in": parent, "xyz": values[:3], "rpy": values[3:], "tolerance": tolerance}


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
    """Return a line of text as comments of at most 118 characters; addresses stay whole."""
    lines = textwrap.wrap(
        line,
        118,
        initial_indent="# ",
        subsequent_indent="#   ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(lines)
