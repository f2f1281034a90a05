"""The section ``frames`` of a machine file: where the base and the tool stand, and further frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict, Field

from truepose.errors import InputError
from truepose.models.file.fields import (
    AngleToleranceVector,
    AngleVector,
    LengthToleranceVector,
    LengthVector,
    Section,
)
from truepose.wording import close_matches

_ZERO = (0.0, 0.0, 0.0)
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class FrameTolerance:
    """1-sigma of a frame's components: `xyz` mm, `rpy` rad; 0 exactly known, inf unknown."""

    xyz: Triple = _ZERO
    rpy: Triple = _ZERO


@dataclass(frozen=True)
class FrameSpec:
    """Where a frame stands in the frame `in_`: `xyz` mm, then Rz(yaw) Ry(pitch) Rx(roll) of `rpy` rad.

    `present` tells a frame the file gives from one it leaves out (the identity, exactly known); `per_session`: it is set up
    anew for each session.
    """

    in_: str
    xyz: Triple = _ZERO
    rpy: Triple = _ZERO
    tolerance: FrameTolerance = FrameTolerance()
    present: bool = False
    per_session: bool = False


@dataclass(frozen=True)
class Frames:
    """The frames at both ends: sensor <- base, and flange <- tool; ``further`` ones of the file's own names."""

    base: FrameSpec = FrameSpec("world")
    tool: FrameSpec = FrameSpec("flange")
    further: Mapping[str, FrameSpec] = field(default_factory=dict)


class FrameToleranceSection(Section):
    xyz: LengthToleranceVector = _ZERO
    """1-sigma of the place; .inf where it is unknown."""
    rpy: AngleToleranceVector = _ZERO
    """1-sigma of roll, pitch and yaw; .inf where they are unknown."""


class FrameSection(Section):
    in_: str | None = Field(default=None, alias="in")
    """Frame that it is given in: `world` (the sensor's frame) for the base, `flange` for the tool, a body for others."""
    xyz: LengthVector = _ZERO
    """Where its origin stands."""
    rpy: AngleVector = _ZERO
    """How it is turned: Rz(yaw) Ry(pitch) Rx(roll)."""
    tolerance: FrameToleranceSection = FrameToleranceSection()
    """How well it is known before any measurement; left out: exactly."""

    def spec(self, default_in: str, per: str | None = None) -> FrameSpec:
        tolerance = FrameTolerance(self.tolerance.xyz, self.tolerance.rpy)
        again = per == "session"
        return FrameSpec(
            self.in_ or default_in, self.xyz, self.rpy, tolerance, present=True, per_session=again
        )


class EndFrameSection(FrameSection):
    per: Literal["session"] | None = None
    """`session`: it is set up anew for each session, within its tolerance; left out: it stays where it is."""


class FurtherFrameSection(FrameSection):
    model_config = ConfigDict(json_schema_extra={"required": ["in"]})  # the reader says so with more words


class FramesSection(Section):
    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, FurtherFrameSection] = Field(init=False)
    """A frame of your own name: a further tip, or where a sensor rides. `in`: a body, `tool`, `base` or `world`."""
    base: EndFrameSection | None = None
    """Where the machine's base stands in the sensor's frame; left out: the identity, exactly known."""
    tool: EndFrameSection | None = None
    """Where the tool frame stands on the flange; left out: the identity, exactly known (a 3ups-up-3r has its own)."""


def read_frames(frames: FramesSection, path: Path) -> Frames:
    left_out, further = Frames(), frames.__pydantic_extra__ or {}
    if frames.base and frames.base.in_ not in (None, left_out.base.in_):
        raise InputError(
            f"{path}: frames.base.in: found {frames.base.in_!r}, expected {left_out.base.in_!r}, the frame of the sensor; "
            "a frame in another one is a further frame with a name of your own"
        )
    for name, frame in further.items():
        if not frame.in_:
            hint = close_matches(name, ("base", "tool"))
            raise InputError(
                f"{path}: frames.{name}: unknown field; {hint}; a further frame needs `in`: the body that carries it"
            )
        if "." in name or name in ("world", "flange", "platform"):
            raise InputError(
                f"{path}: frames: found a frame {name!r}, expected a name without a dot that is no body's"
            )
    return Frames(
        base=frames.base.spec(left_out.base.in_, frames.base.per) if frames.base else left_out.base,
        tool=frames.tool.spec(left_out.tool.in_, frames.tool.per) if frames.tool else left_out.tool,
        further={name: frame.spec("") for name, frame in further.items()},
    )


__all__ = ["FrameSpec", "FrameTolerance", "Frames", "FramesSection", "read_frames"]
