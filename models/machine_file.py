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

from pydantic import BeforeValidator, ConfigDict, Field, ValidationError, WithJsonSchema

from truepose.errors import InputError
from truepose.files import atomic_write_text
from truepose.models.driver_entry import DriverField, DriverSpec
from truepose.models.effect_entry import EffectSpec, read_effects
from truepose.models.field_errors import input_error
from truepose.models.fields import (
    AngleTolerance,
    AngleToleranceVector,
    AngleVector,
    In,
    LengthTolerance,
    LengthToleranceVector,
    LengthVector,
    Mass,
    MassTolerance,
    Number,
    Section,
    Vector,
    bad_value,
    is_quantity,
    with_texts,
)
from truepose.models.force_section import ForceSection
from truepose.models.recording_section import RecordingSection
from truepose.models.schema_line import SCHEMA_LINE
from truepose.models.spring_section import SpringSection
from truepose.models.tolerances import Tolerances
from truepose.models.units import UnitSystem, parse_unit
from truepose.models.yaml_document import document_text, read_document
from truepose.wording import close_matches

__all__ = [
    "NO_WORSE",
    "SCHEMA",
    "DefaultTolerances",
    "EffectSpec",
    "ExpectedPose",
    "FrameSpec",
    "FrameTolerance",
    "Frames",
    "MachineDocument",
    "MachineFile",
    "MassSpec",
    "Tolerances",
    "checked_machine",
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


@dataclass(frozen=True)
class MassSpec:
    """A mass in kg with its centre `com` (mm) in the frame of the body `in_`, and 1-sigma of both: 0 exactly known."""

    name: str
    kg: float
    com: Triple
    in_: str
    kg_tolerance: float = 0.0
    com_tolerance: Triple = _ZERO

    @property
    def known(self) -> bool:
        """Whether nothing of it is to be estimated."""
        return not any((self.kg_tolerance, *self.com_tolerance))


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
    drivers: tuple[DriverSpec, ...]
    effects: tuple[EffectSpec, ...]
    covariance: Mapping[str, Any] | None
    raw: Mapping[str, Any]
    nominal: Mapping[str, float] = field(default_factory=dict)  # drawing values of a calibrated file: mm, rad
    sessions: tuple[int, ...] = ()  # session numbers seen in its fit
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # as written, in the file's units
    pose_error: ExpectedPose | None = None  # what its fit was worth to the tool; None where nobody judged it
    loads: Mapping[str, SpringSection] = field(default_factory=dict)
    forces: Mapping[str, ForceSection] = field(default_factory=dict)
    recordings: Mapping[str, RecordingSection] = field(default_factory=dict)
    refused: tuple[str, ...] = ()  # why its fit may not be called a calibration

    def override_for(self, parameter: str, unit: str) -> float | None:
        """The tolerance that `tolerances:` states for a parameter, in its `unit`; None if none."""
        return self.tolerances.override_for(parameter, unit)


class _Units(Section):
    length: str = "mm"
    """Unit of every length of the file and, unless a column says its own, of its recordings."""
    angle: str = "deg"
    """Unit of every angle of the file and, unless a column says its own, of its recordings."""
    joint: str | None = None
    """Unit of a hexapod's leg readings, where it is another than `length`: `turn` of a motor, say."""


class _FrameTolerance(Section):
    xyz: LengthToleranceVector = _ZERO
    """1-sigma of the place; .inf where it is unknown."""
    rpy: AngleToleranceVector = _ZERO
    """1-sigma of roll, pitch and yaw; .inf where they are unknown."""


class _Frame(Section):
    in_: str | None = Field(default=None, alias="in")
    """Frame that it is given in: `world` (the sensor's frame) for the base, `flange` for the tool, a body for others."""
    xyz: LengthVector = _ZERO
    """Where its origin stands."""
    rpy: AngleVector = _ZERO
    """How it is turned: Rz(yaw) Ry(pitch) Rx(roll)."""
    tolerance: _FrameTolerance = _FrameTolerance()
    """How well it is known before any measurement; left out: exactly."""

    def spec(self, default_in: str, per: str | None = None) -> FrameSpec:
        tolerance = FrameTolerance(self.tolerance.xyz, self.tolerance.rpy)
        again = per == "session"
        return FrameSpec(
            self.in_ or default_in, self.xyz, self.rpy, tolerance, present=True, per_session=again
        )


class _EndFrame(_Frame):
    per: Literal["session"] | None = None
    """`session`: it is set up anew for each session, within its tolerance; left out: it stays where it is."""


class _FurtherFrame(_Frame):
    model_config = ConfigDict(json_schema_extra={"required": ["in"]})  # the reader says so with more words


class _Frames(Section):
    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, _FurtherFrame] = Field(init=False)
    """A frame of your own name: a further tip, or where a sensor rides. `in`: a body, `tool`, `base` or `world`."""
    base: _EndFrame | None = None
    """Where the machine's base stands in the sensor's frame; left out: the identity, exactly known."""
    tool: _EndFrame | None = None
    """Where the tool frame stands on the flange; left out: the identity, exactly known (a 3ups-up-3r has its own)."""


class _ExpectedPose(Section):
    than: str
    """What it was compared with: `drawing` or `plain calibration`."""
    before: Annotated[Number, In("mm")] = Field(ge=0.0)
    """Rms error of the tool's position with that model, after a rigid refit."""
    after: Annotated[Number, In("mm")] = Field(ge=0.0)
    """The same with this file's model."""
    unit: Literal["mm"] = "mm"
    """Unit of both, whatever `units` says."""
    rows: str
    """On which rows, in words."""


class _Judgement(Section):
    calibrated: bool
    """Whether the fit may be called a calibration."""
    why: tuple[str, ...] = ()
    """Why not, in words."""


class _MassTolerance(Section):
    kg: MassTolerance = 0.0
    """1-sigma of the mass; .inf where it is unknown."""
    com: LengthToleranceVector = _ZERO
    """1-sigma of its centre."""


class _Mass(Section):
    kg: Mass = Field(ge=0.0)
    """Mass. That of the mass called `payload` is replaced by the recording's column `payload`."""
    com: LengthVector = _ZERO
    """Centre of mass in the frame of `in`."""
    in_: str = Field(alias="in")
    """Body that carries it: linkK of a serial arm, `platform`, a body of the graph or URDF, `flange`, `tool` or `base`."""
    tolerance: _MassTolerance = _MassTolerance()
    """How well both are known; left out: exactly. Otherwise `NAME.kg`, `NAME.x` ... are estimated where effects read loads."""


def _typed_mapping(value: object) -> object:
    if not isinstance(value, dict):
        raise bad_value("a mapping with a field 'type'", value)
    if not isinstance(value.get("type"), str):
        raise bad_value("a field 'type' with a text", value.get("type"))
    return value


def _one_or_several(value: object) -> object:
    return value if isinstance(value, list) else [_typed_mapping(value)]


def _numbers(value: object) -> tuple[float | str, ...]:
    """Numbers in the file's units, and texts such as ``20um``, whose unit the parameter decides on."""
    items: list[Any] = value if isinstance(value, list) else [value]
    if not items or not all(_is_tolerance(item) for item in items):
        raise bad_value("a number >= 0 or .inf, or several for a vector", value)
    return tuple(item if isinstance(item, str) else float(item) for item in items)


def _is_tolerance(item: object) -> bool:
    if isinstance(item, str):
        return is_quantity(item) and not item.lstrip().startswith("-")
    return isinstance(item, (int, float)) and not isinstance(item, bool) and item >= 0


def _interval(value: object) -> tuple[float, float]:
    items = value if isinstance(value, list) else []
    numbers = [v for v in items if isinstance(v, (int, float)) and not isinstance(v, bool)]
    if len(items) != 2 or len(numbers) != 2 or not numbers[0] < numbers[1]:
        raise bad_value("[low, high], two numbers with low < high (-.inf and .inf leave a side open)", value)
    return float(numbers[0]), float(numbers[1])


_NOT_NEGATIVE = {"type": "number", "minimum": 0}
_STATED = WithJsonSchema(
    with_texts(
        {"anyOf": [_NOT_NEGATIVE, {"type": "array", "items": _NOT_NEGATIVE, "minItems": 1, "maxItems": 6}]}
    )
)

RawSection = Annotated[dict[str, Any], BeforeValidator(_typed_mapping)]
_Override = Annotated[tuple[float | str, ...], BeforeValidator(_numbers), _STATED]
_Interval = Annotated[tuple[float, float], BeforeValidator(_interval), In("the parameter's")]


class DefaultTolerances(Section):
    """What the section ``tolerances`` says of every parameter that nothing else states a tolerance of."""

    length: LengthTolerance = 0.0
    """1-sigma of every length of the mechanism (all `d` and `r`, all `a` and `b` ...)."""
    angle: AngleTolerance = 0.0
    """1-sigma of every angle and direction of the mechanism (all `alpha`, all `theta`, all `u` ...)."""


class MachineDocument(Section):
    """A machine file as it is written."""

    schema_: Any = Field(alias="schema", json_schema_extra={"const": SCHEMA})
    """Always `truepose/machine/1`: what kind of file this is."""
    name: str = Field(min_length=1)
    """What the machine is called; files and functions of its C have this name."""
    units: _Units = _Units()
    """The units that the file is written in."""
    gravity: Annotated[Vector, In("m/s^2")] | None = None
    """Acceleration of free fall in the base frame, [0, 0, -9.81] where z is up; left out: weights play no part."""
    mechanism: RawSection
    """The machine's geometry as drawn. Its `type` says which keys it has."""
    frames: _Frames = _Frames()
    """Where the machine stands and what it carries."""
    sensor: Annotated[list[RawSection], BeforeValidator(_one_or_several)] = Field(default_factory=list)
    """What measures it: one sensor, or a list whose readings add up. Its `type` says which keys it has."""
    tolerances: dict[str, _Override] = Field(default_factory=dict)
    """1-sigma of the hardware as built, before any measurement."""
    masses: dict[str, _Mass] = Field(default_factory=dict)
    """What has weight, by a name of your own; used together with `gravity`."""
    drivers: tuple[DriverField, ...] = ()
    """What recordings log beyond the joints: names, or mappings with a unit. A declared column may drive any effect."""
    loads: dict[str, SpringSection] = Field(default_factory=dict)
    """Springs, hoses and balancers between two bodies, by a name of your own; their energy counts with that of the masses."""
    forces: dict[str, ForceSection] = Field(default_factory=dict)
    """Forces that columns of the recording hold, by a name of your own: a load beside the weights, wherever they push."""
    recordings: dict[str, RecordingSection] = Field(default_factory=dict)
    """What differs between recordings, by a name of your own: a tool, a payload, a date of their own."""
    effects: list[dict[str, Any]] = Field(default_factory=list)
    """Physics beyond ideal geometry, one entry an effect at its place."""
    covariance: dict[str, Any] | None = None
    """What the fit behind the file knows of its values. Written by truepose."""
    nominal: dict[str, Number] = Field(default_factory=dict)
    """Drawing values (mm, rad) of a calibrated file, by parameter. Written by truepose."""
    sessions: tuple[int, ...] = ()
    """Session numbers that the fit has seen. Written by truepose."""
    bounds: dict[str, _Interval] = Field(default_factory=dict)
    """Between which values parameters may be estimated, `leg1.length: [499, 501]`; kept by `--solver ipopt`."""
    pose_error: _ExpectedPose | None = None
    """What the fit was worth to the tool. Written by truepose."""
    judgement: _Judgement | None = None
    """Whether the fit may be called a calibration, and why not. Written by truepose."""


def read_machine(path: Path | str) -> MachineFile:
    """Read and check a machine file.

    Raises InputError naming file, field, what was found and what was expected.
    """
    return checked_machine(Path(path), read_document(path))


def checked_machine(path: Path, raw: dict[str, Any]) -> MachineFile:
    """The machine of a document that stands, or is to stand, in the file ``path``. Raises InputError as `read_machine`."""
    if raw.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema: found {raw.get('schema')!r}, expected {SCHEMA!r}")
    units = _read_units(raw.get("units", {}), path)
    context = {"units": units}
    stated = raw.get("tolerances")
    defaults = {}
    if isinstance(stated, dict):
        defaults = {key: stated[key] for key in DefaultTolerances.model_fields if key in stated}
    try:
        document = MachineDocument.model_validate(copy.deepcopy(raw), context=context)
    except ValidationError as exc:
        raise input_error(exc, path) from None
    try:
        default = DefaultTolerances.model_validate(defaults, context=context)
    except ValidationError as exc:
        raise input_error(exc, path, "tolerances") from None
    overrides = {key: value for key, value in document.tolerances.items() if key not in defaults}
    return MachineFile(
        path=path,
        name=document.name,
        units=units,
        gravity=document.gravity,
        mechanism=document.mechanism,
        frames=_frames(document.frames, path),
        sensors=tuple(document.sensor),
        tolerances=Tolerances(default.length, default.angle, overrides, units, str(path)),
        masses=tuple(
            MassSpec(name, m.kg, m.com, m.in_, m.tolerance.kg, m.tolerance.com)
            for name, m in document.masses.items()
        ),
        drivers=tuple(driver.spec() for driver in document.drivers),
        effects=read_effects(document.effects, path),
        covariance=document.covariance,
        raw=raw,
        nominal=document.nominal,
        sessions=document.sessions,
        bounds=document.bounds,
        pose_error=_expected_pose(document.pose_error),
        loads=document.loads,
        forces=document.forces,
        recordings=document.recordings,
        refused=_refused(document.judgement),
    )


def _refused(found: _Judgement | None) -> tuple[str, ...]:
    return () if found is None or found.calibrated else found.why or ("its judgement says so",)


def _expected_pose(found: _ExpectedPose | None) -> ExpectedPose | None:
    return None if found is None else ExpectedPose(found.than, found.before, found.after, found.rows)


def write_machine(path: Path | str, document: Mapping[str, Any], comment: str = "") -> None:
    """Write a machine file: whole or not at all, key order kept, floats at full precision.

    Its first line is ``comment``, if there is one; then its schema is named.
    """
    head = f"# {comment}\n" if comment else ""
    atomic_write_text(path, f"{head}{SCHEMA_LINE}\n{document_text(document)}")


def _frames(frames: _Frames, path: Path) -> Frames:
    left_out, further = Frames(), frames.__pydantic_extra__ or {}
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
