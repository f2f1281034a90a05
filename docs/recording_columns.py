"""Every column that a recording may have: what it holds, in which unit, and who needs it.

`docs/reference/recording.md` and the JSON Schema of a row are made from this list; `truepose.identification.recording.file`
reads the columns.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal

from machine_schema import DIALECT, Schema
from truepose.models.file.driver import Driver

RECORDING_SCHEMA: Final = "https://truepose.dev/schema/recording-1.json"
Holds = Literal["number", "integer", "text", "time"]
_PLACEHOLDER: Final = re.compile(r"<\w+>")


@dataclass(frozen=True)
class KnownColumn:
    """One column, or all of one form: ``<joint>`` and the like stand for a name of the machine.

    ``unit``: a unit, ``length`` or ``angle`` (that of the machine file), ``reading`` (that of the joint), or empty.
    ``default``: what holds where the column is missing. ``sensor``: the types that read it, none where it is no reading.
    """

    name: str
    holds: Holds
    unit: str
    text: str
    default: str = ""
    sensor: tuple[str, ...] = ()
    values: tuple[str | int, ...] = ()
    """All that a cell may say; anything when empty."""

    @property
    def pattern(self) -> str:
        """A regular expression for its header: the name, with a unit in brackets where it has one."""
        parts = [re.escape(part) for part in _PLACEHOLDER.split(self.name)]
        suffix = r"( *\[[^\[\]]+\])?" if self.unit else ""
        return f"^{'.+'.join(parts)}{suffix}$"


def _missing(name: str) -> str:
    """What a driver is taken to be where no column records it."""
    driver = Driver.of(name)
    return f"{driver.default:g} {driver.unit({})}".strip()


def _number(name: str, unit: str, text: str, default: str = "", *sensors: str) -> KnownColumn:
    return KnownColumn(name, "number", unit, text, default, sensors)


def _reading(name: str, unit: str, text: str, *sensors: str) -> KnownColumn:
    return _number(name, unit, text, "", *sensors)


JOINTS: Final = (
    _number(
        "<joint>",
        "reading",
        "Reading of a joint, as commanded or as its encoder says. Every joint of the machine has a column.",
    ),
)
READINGS: Final = (
    *(_reading(axis, "length", f"{axis} of the tool frame's origin.", "pose", "position") for axis in "xyz"),
    *(
        _reading(f"r{axis}", "angle", f"{axis} of the rotation vector: axis times angle, no Euler angle.", "pose")
        for axis in "xyz"
    ),
    *(
        _reading(
            f"<target>.{axis}", "length",
            f"{axis} of a target, by its name in `points`; of the frame that a sensor with a `name` reads.",
            "targets", "pose", "position",
        )
        for axis in "xyz"
    ),
    *(
        _reading(f"<sensor>.r{axis}", "angle", f"{axis} of the rotation vector of a sensor that has a `name`.", "pose")
        for axis in "xyz"
    ),
    _reading("dL", "length", "Change of the distance since the row that `from` names.", "distance", "irradiance"),
    _reading("length", "length", "Distance between the balls of the bar.", "ballbar"),
    _reading("<bar>.length", "length", "The same of a bar that has a `name`.", "ballbar"),
    _reading("azimuth", "angle", "First angle of a direction, where `angles` names no other.", "direction"),
    _reading("elevation", "angle", "Second angle of a direction, where `angles` names no other.", "direction"),
    _reading("<direction>.<angle>", "angle", "Either angle of a direction that has a `name`: `star.ha`.", "direction"),
    *(_reading(f"u{axis}", "", f"{axis} of a direction's unit vector.", "direction") for axis in "xyz"),
    *(_reading(f"tilt.{axis}", "angle", f"Angle of the tool's {axis} axis above the horizon.", "tilt") for axis in "xy"),
    _reading(
        "angle.<joint>", "reading",
        "What an encoder on the load side of a joint, or a scale along a slide, reads; opened by the sensor's `name`.", "angle",
    ),
    KnownColumn("placement", "text", "", "Label of where the sockets stood.", sensor=("socket",)),
    KnownColumn("socket", "text", "", "Label of the socket that held the ball.", sensor=("socket",)),
    KnownColumn("set", "text", "", "Label of a mounting of the tool.", "one set", sensor=("socket",)),
)  # fmt: skip
ORDER: Final = (
    KnownColumn(
        "time", "time", "s",
        "When the row was measured, on one clock: seconds, dates (2026-05-01T10:11:12.125) or times of day. Creep, slow heat "
        "and latency need it; drift is told in hours by it, and in rows without it.",
        "the order of the rows",
    ),
    KnownColumn(
        "session", "integer", "", "Number of the session: what happened between two homings or mountings.",
        "each file is a session",
    ),
    KnownColumn(
        "pose", "integer", "", "Number of the pose. Rows of one number are repeats of it: they tell the noise.", "no repeats"
    ),
    KnownColumn(
        "from", "integer", "", "Number of the pose that the reading is a change from: the latest earlier row that has it.",
        sensor=("distance", "irradiance"),
    ),
    KnownColumn(
        "role", "text", "", "`validation` keeps a row out of every fit, to judge the result by.", "calibration",
        values=("calibration", "validation"),
    ),
)  # fmt: skip
LOGGED: Final = (
    _number("payload", "kg", "Mass carried: that of the mass called `payload`.", "the machine file's, else 0 kg"),
    _number(
        "temperature.<place>", "degC",
        "Temperature of a place: `base`, `platform`, `tool`, `link2`, `leg1` ... Thermal expansion needs it.",
        f"temperature.air, else {_missing('temperature.air')}",
    ),
    _number(
        "temperature.air", "degC", "Temperature of the air. It serves every place without a column of its own.",
        _missing("temperature.air"),
    ),
    _number("pressure", "hPa", "Pressure of the air; refraction needs it.", _missing("pressure")),
    _number("humidity", "%", "Relative humidity of the air; no effect reads it.", _missing("humidity")),
    KnownColumn(
        "approach.<joint>", "number", "",
        "Side that the joint arrived from: +1 moving towards larger readings, -1 towards smaller, 0 unknown.",
        "the order of the rows, unless they are shuffled", values=(-1, 0, 1),
    ),
    _number(
        "torque.<joint>", "N*m",
        "Torque that the joint's drive holds, or that pulls at it (a slide: force, N). A compliance is found without masses.",
        "the load computed from `masses`",
    ),
    _number(
        "current.<joint>", "A", "Current of the joint's motor; stands in for its torque.", "the load computed from `masses`"
    ),
    _number("velocity.<joint>", "reading/s", "Velocity of the joint when the sensor read; latency needs it.", "at rest"),
)  # fmt: skip
AVERAGED: Final = (
    _number("samples", "", "How many samples the row is the average of; a note.", "-"),
    _number("<target>.samples", "", "The same of one target; a note.", "-"),
    _number("<column>.sigma", "", "1-sigma of the average, from the scatter of its samples; a note.", "-"),
)
COLUMNS: Final = (*JOINTS, *READINGS, *ORDER, *LOGGED, *AVERAGED)

_TEXT = (
    "One row of a recording, as cells by column. A header may end with a unit in brackets, `x [um]`. Columns that "
    "no pattern names are those of the machine's joints, or mean nothing to truepose and are left out with a note."
)


_KINDS: Final = {
    "number": ["number"],
    "integer": ["integer"],
    "text": ["string", "integer"],
    "time": ["number", "string"],
}


def row_schema() -> Schema:
    """The schema of a row: joints are named by the machine file, so that any column of numbers may be one."""
    return {
        "$schema": DIALECT,
        "$id": RECORDING_SCHEMA,
        "title": "truepose recording, one row",
        "description": _TEXT,
        "type": "object",
        "minProperties": 1,
        "patternProperties": {column.pattern: _cell(column) for column in COLUMNS if column not in JOINTS},
        "additionalProperties": {
            "type": ["number", "string", "boolean", "null"],
            "description": JOINTS[0].text,
            "unit": JOINTS[0].unit,
        },
    }


def _cell(column: KnownColumn) -> Schema:
    """A lost reading is an empty cell; labels may be numbers."""
    kinds = _KINDS[column.holds]
    lost = ["null"] if column.sensor and column.holds == "number" else []
    missing = f" Left out: {column.default}." if column.default else ""
    out: Schema = {"title": column.name, "description": f"{column.text}{missing}"}
    out |= {"enum": list(column.values)} if column.values else {"type": [*kinds, *lost]}
    return out | ({"unit": column.unit} if column.unit else {})
