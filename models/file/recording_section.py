"""The section ``recordings`` of a machine file: what differs between files or sessions (tool, payload, date)."""

from __future__ import annotations

import datetime
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from truepose.models.file.fields import (
    AngleVector,
    LengthToleranceVector,
    LengthVector,
    Mass,
    MassTolerance,
    Section,
    bad_value,
)

_ZERO = (0.0, 0.0, 0.0)


class OwnTool(Section):
    """A tool of other length or place."""

    in_: Literal["flange", "tool"] = Field(default="flange", alias="in")
    """`flange`: in place of `frames.tool`; `tool`: so much further in its frame, whatever of that is unknown."""
    xyz: LengthVector = _ZERO
    """Where its origin stands."""
    rpy: AngleVector = _ZERO
    """How it is turned, `in: flange`: Rz(yaw) Ry(pitch) Rx(roll)."""

    @model_validator(mode="after")
    def _stands(self) -> OwnTool:
        if self.in_ == "tool" and any(self.rpy):
            raise bad_value(
                "xyz alone with `in: tool`; a tool that is turned has `in: flange`", list(self.rpy)
            )
        return self


class OwnPayloadTolerance(Section):
    """How well a payload is known."""

    kg: MassTolerance = 0.0
    """1-sigma of the mass; .inf where it is unknown."""
    com: LengthToleranceVector = _ZERO
    """1-sigma of its centre."""


class OwnPayload(Section):
    """What is carried in place of the mass called ``payload``."""

    kg: Mass = Field(ge=0.0)
    """Mass."""
    com: LengthVector = _ZERO
    """Centre of mass in the frame of `in`."""
    in_: str = Field(default="tool", alias="in")
    """Body that carries it, as for masses."""
    tolerance: OwnPayloadTolerance = OwnPayloadTolerance()
    """How well both are known; left out: exactly. Otherwise `NAME.payload.kg`, `NAME.payload.x` ... are estimated."""


def _texts(value: object) -> object:
    return [value] if isinstance(value, (str, int)) and not isinstance(value, bool) else value


def _moment(value: object) -> datetime.datetime:
    """A date, or a date and a time of day; without a zone it is that of the place."""
    if isinstance(value, datetime.datetime):
        return value
    if isinstance(value, datetime.date):
        return datetime.datetime(value.year, value.month, value.day)
    try:
        return datetime.datetime.fromisoformat(value if isinstance(value, str) else "")
    except ValueError:
        raise bad_value("a date such as 2026-03-14 or 2026-03-14 08:30", value) from None


Moment = Annotated[datetime.datetime, BeforeValidator(_moment, json_schema_input_type=str)]
Texts = Annotated[tuple[str, ...], BeforeValidator(_texts, json_schema_input_type=str | list[str])]
Numbers = Annotated[tuple[int, ...], BeforeValidator(_texts, json_schema_input_type=int | list[int])]


class RecordingSection(Section):
    """Which recordings are meant, and what they were measured with."""

    files: Texts = ()
    """Names of the files; `*` stands for anything: `long_tip*.csv`."""
    sessions: Numbers = ()
    """Numbers of sessions in the column `session`, in place of `files`."""
    tool: OwnTool | None = None
    """Its own tool; left out: that of `frames.tool`."""
    payload: OwnPayload | None = None
    """Its own payload; left out: the mass called `payload`, if any."""
    date: Moment | None = None
    """When the file was begun: its `time` counts from then. Every file of one command has one, or none."""

    @model_validator(mode="after")
    def _is_of_some(self) -> RecordingSection:
        if bool(self.files) == bool(self.sessions):
            raise bad_value("either `files` or `sessions`", "both" if self.files else "neither")
        if self.date is not None and not self.files:
            raise bad_value(
                "`files` beside `date`: rows of a session may be of several files", list(self.sessions)
            )
        return self


__all__ = ["OwnPayload", "OwnTool", "RecordingSection"]
