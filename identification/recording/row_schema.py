"""The JSON Schema of one row of a recording, by the names of its columns; made from the list of all columns."""

from __future__ import annotations

from typing import Final

from truepose.identification.recording.columns import COLUMNS, JOINTS, KnownColumn
from truepose.models.file.names import RECORDING_SCHEMA
from truepose.models.schemas.machine import DIALECT, Schema

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
