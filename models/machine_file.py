"""The machine file: reading, checking and writing its YAML.

`read_machine` checks everything that does not depend on the kind of mechanism, sensor or effect, and
turns it into internal units (mm, rad, kg). The sections `mechanism` and `sensor` stay as written: their
`type` picks who reads them, with `Section` models and `input_error`. `write_machine` writes a changed
copy of `MachineFile.raw`.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BeforeValidator, Field, ValidationError

from truepose.errors import InputError
from truepose.files import atomic_write_text
from truepose.models.effect_entry import EffectSpec, read_effects
from truepose.models.field_errors import input_error
from truepose.models.fields import (
    AngleTolerance,
    AngleToleranceVector,
    AngleVector,
    LengthTolerance,
    LengthToleranceVector,
    LengthVector,
    Number,
    Section,
    Vector,
    bad_value,
)
from truepose.models.tolerances import Tolerances
from truepose.models.units import UnitSystem, parse_unit
from truepose.models.yaml_document import document_text, read_document

__all__ = [
    "NO_WORSE",
    "SCHEMA",
    "EffectSpec",
    "ExpectedPose",
    "FrameSpec",
    "FrameTolerance",
    "Frames",
    "MachineFile",
    "MassSpec",
    "Tolerances",
    "input_error",
    "read_machine",
    "write_machine",
]

SCHEMA: Final = "truepose/machine/1"
NO_WORSE: Final = 1.02
"""Most that an error may be of the one that it is compared with for a model to be applied: no more than chance makes."""
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

    `present` tells a frame the file gives from one it leaves out (the identity, exactly known).
    """

    in_: str
    xyz: Triple = _ZERO
    rpy: Triple = _ZERO
    tolerance: FrameTolerance = FrameTolerance()
    present: bool = False


@dataclass(frozen=True)
class Frames:
    """The frames at both ends: sensor <- base, and flange <- tool."""

    base: FrameSpec = FrameSpec("world")
    tool: FrameSpec = FrameSpec("flange")


@dataclass(frozen=True)
class MassSpec:
    """A mass in kg with its centre `com` (mm) in the frame of the body `in_`."""

    name: str
    kg: float
    com: Triple
    in_: str


@dataclass(frozen=True)
class ExpectedPose:
    """Rms error of the tool's position, mm, after a rigid refit: ``before`` of the model that ``than`` names (``drawing`` or
    ``plain calibration``), ``after`` of this file's, on ``rows`` (in words)."""

    than: str
    before: float
    after: float
    rows: str

    @property
    def worse(self) -> bool:
        """Whether the file's model leaves the tool worse than the other, by more than chance makes."""
        return self.after > NO_WORSE * self.before


@dataclass(frozen=True)
class MachineFile:
    """A checked machine file in internal units; `mechanism` and `sensors` as written."""

    path: Path
    name: str
    units: UnitSystem
    gravity: Triple | None  # m/s^2, base frame
    mechanism: Mapping[str, Any]
    frames: Frames
    sensors: tuple[Mapping[str, Any], ...]
    tolerances: Tolerances
    masses: tuple[MassSpec, ...]
    drivers: tuple[str, ...]
    effects: tuple[EffectSpec, ...]
    covariance: Mapping[str, Any] | None
    raw: Mapping[str, Any]
    nominal: Mapping[str, float] = field(default_factory=dict)  # drawing values of a calibrated file: mm, rad
    sessions: tuple[int, ...] = ()  # session numbers seen in its fit
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # as written, in the file's units
    pose_error: ExpectedPose | None = None  # what its fit was worth to the tool; None where nobody judged it
    refused: tuple[str, ...] = ()  # why its fit may not be called a calibration

    def override_for(self, parameter: str, unit: str) -> float | None:
        """The tolerance that `tolerances:` states for a parameter, in its `unit`; None if none."""
        return self.tolerances.override_for(parameter, unit)


class _Units(Section):
    length: str = "mm"
    angle: str = "deg"
    joint: str | None = None


class _FrameTolerance(Section):
    xyz: LengthToleranceVector = _ZERO
    rpy: AngleToleranceVector = _ZERO


class _Frame(Section):
    in_: str | None = Field(default=None, alias="in")
    xyz: LengthVector = _ZERO
    rpy: AngleVector = _ZERO
    tolerance: _FrameTolerance = _FrameTolerance()

    def spec(self, default_in: str) -> FrameSpec:
        tolerance = FrameTolerance(self.tolerance.xyz, self.tolerance.rpy)
        return FrameSpec(self.in_ or default_in, self.xyz, self.rpy, tolerance, present=True)


class _Frames(Section):
    base: _Frame | None = None
    tool: _Frame | None = None


class _ExpectedPose(Section):
    than: str
    before: Number = Field(ge=0.0)
    after: Number = Field(ge=0.0)
    unit: Literal["mm"] = "mm"
    rows: str


class _Judgement(Section):
    calibrated: bool
    why: tuple[str, ...] = ()


class _Mass(Section):
    kg: Number = Field(ge=0.0)
    com: LengthVector = _ZERO
    in_: str = Field(alias="in")


def _typed_mapping(value: object) -> object:
    if not isinstance(value, dict):
        raise bad_value("a mapping with a field 'type'", value)
    if not isinstance(value.get("type"), str):
        raise bad_value("a field 'type' with a text", value.get("type"))
    return value


def _one_or_several(value: object) -> object:
    return value if isinstance(value, list) else [_typed_mapping(value)]


def _numbers(value: object) -> tuple[float, ...]:
    items: list[Any] = value if isinstance(value, list) else [value]
    plain = all(isinstance(item, (int, float)) and not isinstance(item, bool) for item in items)
    if not items or not plain or not all(item >= 0 for item in items):
        raise bad_value("a number >= 0 or .inf, or several for a vector", value)
    return tuple(float(item) for item in items)


def _interval(value: object) -> tuple[float, float]:
    items = value if isinstance(value, list) else []
    numbers = [v for v in items if isinstance(v, (int, float)) and not isinstance(v, bool)]
    if len(items) != 2 or len(numbers) != 2 or not numbers[0] < numbers[1]:
        raise bad_value("[low, high], two numbers with low < high (-.inf and .inf leave a side open)", value)
    return float(numbers[0]), float(numbers[1])


RawSection = Annotated[dict[str, Any], BeforeValidator(_typed_mapping)]
_Override = Annotated[tuple[float, ...], BeforeValidator(_numbers)]
_Interval = Annotated[tuple[float, float], BeforeValidator(_interval)]


class _Defaults(Section):
    length: LengthTolerance = 0.0
    angle: AngleTolerance = 0.0


class _Document(Section):
    schema_: Any = Field(alias="schema")
    name: str = Field(min_length=1)
    units: _Units = _Units()
    gravity: Vector | None = None
    mechanism: RawSection
    frames: _Frames = _Frames()
    sensor: Annotated[list[RawSection], BeforeValidator(_one_or_several)] = Field(default_factory=list)
    tolerances: dict[str, _Override] = Field(default_factory=dict)
    masses: dict[str, _Mass] = Field(default_factory=dict)
    drivers: tuple[str, ...] = ()
    effects: list[dict[str, Any]] = Field(default_factory=list)
    covariance: dict[str, Any] | None = None
    nominal: dict[str, Number] = Field(default_factory=dict)
    sessions: tuple[int, ...] = ()
    bounds: dict[str, _Interval] = Field(default_factory=dict)
    pose_error: _ExpectedPose | None = None
    judgement: _Judgement | None = None


def read_machine(path: Path | str) -> MachineFile:
    """Read and check a machine file.

    Raises InputError naming file, field, what was found and what was expected.
    """
    path = Path(path)
    raw = read_document(path)
    if raw.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema: found {raw.get('schema')!r}, expected {SCHEMA!r}")
    units = _read_units(raw.get("units", {}), path)
    context = {"units": units}
    stated = raw.get("tolerances")
    defaults = {}
    if isinstance(stated, dict):
        defaults = {key: stated[key] for key in _Defaults.model_fields if key in stated}
    try:
        document = _Document.model_validate(copy.deepcopy(raw), context=context)
    except ValidationError as exc:
        raise input_error(exc, path) from None
    try:
        default = _Defaults.model_validate(defaults, context=context)
    except ValidationError as exc:
        raise input_error(exc, path, "tolerances") from None
    overrides = {key: value for key, value in document.tolerances.items() if key not in defaults}
    return MachineFile(
        path=path,
        name=document.name,
        units=units,
        gravity=document.gravity,
        mechanism=document.mechanism,
        frames=_frames(document.frames),
        sensors=tuple(document.sensor),
        tolerances=Tolerances(default.length, default.angle, overrides, units, str(path)),
        masses=tuple(MassSpec(name, m.kg, m.com, m.in_) for name, m in document.masses.items()),
        drivers=document.drivers,
        effects=read_effects(document.effects, path),
        covariance=document.covariance,
        raw=raw,
        nominal=document.nominal,
        sessions=document.sessions,
        bounds=document.bounds,
        pose_error=_expected_pose(document.pose_error),
        refused=_refused(document.judgement),
    )


def _refused(found: _Judgement | None) -> tuple[str, ...]:
    return () if found is None or found.calibrated else found.why or ("its judgement says so",)


def _expected_pose(found: _ExpectedPose | None) -> ExpectedPose | None:
    return None if found is None else ExpectedPose(found.than, found.before, found.after, found.rows)


def write_machine(path: Path | str, document: Mapping[str, Any], comment: str = "") -> None:
    """Write a machine file: whole or not at all, key order kept, floats at full precision; ``comment`` is its first line."""
    head = f"# {comment}\n" if comment else ""
    atomic_write_text(path, head + document_text(document))


def _frames(frames: _Frames) -> Frames:
    left_out = Frames()
    return Frames(
        base=frames.base.spec(left_out.base.in_) if frames.base else left_out.base,
        tool=frames.tool.spec(left_out.tool.in_) if frames.tool else left_out.tool,
    )


def _read_units(section: object, path: Path) -> UnitSystem:
    try:
        units = _Units.model_validate(section)
    except ValidationError as exc:
        raise input_error(exc, path, "units") from None
    where = f"{path}: units"
    length = parse_unit(units.length, "length", f"{where}.length")
    angle = parse_unit(units.angle, "angle", f"{where}.angle")
    if units.joint is None:
        return UnitSystem(length, angle)
    return UnitSystem(length, angle, parse_unit(units.joint, "reading", f"{where}.joint"))
