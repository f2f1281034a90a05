"""Sections of a machine file: what its fields are, how they are checked, and what is made of them."""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from truepose.errors import InputError
from truepose.models.file.driver import DriverKind
from truepose.models.file.fields import (
    AngleTolerance,
    AngleToleranceVector,
    AngleVector,
    Force,
    ForceTolerance,
    In,
    Length,
    LengthTolerance,
    LengthToleranceVector,
    LengthVector,
    Mass,
    MassTolerance,
    Number,
    Section,
    Stiffness,
    StiffnessTolerance,
    as_number,
    bad_value,
    input_error,
    is_quantity,
    quantity,
    with_texts,
)
from truepose.models.file.limits import LARGEST
from truepose.models.task import COMPONENTS, Task
from truepose.models.units import UnitSystem, compatible, convert, parse_unit
from truepose.wording import close_matches


class DriverEntry(Section):
    """A driver with its unit: ``{name: tilt.column, unit: deg}``."""

    name: str = Field(min_length=1)
    """Name of the recording's column."""
    unit: str | None = None
    """Unit of the column where its header names none: N*m, A, deg, bar ..."""
    drives: DriverKind | None = None
    """In which way it makes an error vary; left out: as its unit says (N, N*m, A, kg, bar: `load`; degC, W: `temperature`)."""
    of: str | None = None
    """Joint whose drive it tells of (N*m, A; N of a slide): the column then stands for `torque.JOINT` or `current.JOINT`."""


def _named_driver(value: object) -> object:
    return {"name": value} if isinstance(value, str) else value


DriverField = Annotated[DriverEntry, BeforeValidator(_named_driver, json_schema_input_type=str | DriverEntry)]


NO_WORSE: Final = 1.02
"""Most that an error may be of the one that it is compared with for a model to be applied: no more than chance makes."""


class ExpectedPose(Section):
    """Rms error of the tool's position, in what counts of it (``judged_axes``), after a rigid refit: ``before`` of the model
    that ``than`` names, ``after`` of this file's."""

    than: str
    """What it was compared with: `drawing` or `plain calibration`."""
    before: Annotated[Number, In("mm")] = Field(ge=0.0)
    """Rms error of the tool's position, in what a stated task counts of it, with that model, after a rigid refit."""
    after: Annotated[Number, In("mm")] = Field(ge=0.0)
    """The same with this file's model."""
    unit: Literal["mm"] = "mm"
    """Unit of both, whatever `units` says."""
    rows: str
    """On which rows, in words."""

    @property
    def worse(self) -> bool:
        """Whether the file's model leaves the tool worse than the other, by more than chance makes."""
        return self.after > NO_WORSE * self.before


class JudgementSection(Section):
    calibrated: bool
    """Whether the fit may be called a calibration."""
    why: tuple[str, ...] = ()
    """Why not, in words."""

    @property
    def refusal(self) -> tuple[str, ...]:
        """Why it may not be called one; empty where it may."""
        return () if self.calibrated else self.why or ("its judgement says so",)


FORCE, WRENCH = 3, 6
"""How many columns a force alone has, and one with its moment."""


class ForceSection(Section):
    """A measured force, with or without a moment."""

    columns: tuple[str, ...]
    """Columns of the recording: the force along x, y, z (N) and, where six are named, the moment about them (N*m)."""
    in_: str = Field(default="tool", alias="in")
    """What it pushes at: `tool`, a further frame (that of the force sensor), or a body as for masses."""
    at: LengthVector = (0.0, 0.0, 0.0)
    """The point that it pushes at, in that frame; moments are about it."""
    axes: str | None = None
    """Frame along whose axes the columns are given: `base`, `tool`, a further frame or a body; left out: that of `in`."""
    sign: Literal[1, -1] = 1
    """1: the columns hold what pushes at the machine; -1: what the machine pushes with."""

    @field_validator("columns")
    @classmethod
    def _three_or_six(cls, columns: tuple[str, ...]) -> tuple[str, ...]:
        if len(columns) not in (FORCE, WRENCH) or len(set(columns)) != len(columns) or not all(columns):
            raise bad_value(
                "3 names of columns (force) or 6 (force, then moment), all different", list(columns)
            )
        return columns


_ZERO = (0.0, 0.0, 0.0)
Triple = tuple[float, float, float]


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


class EndFrameSection(FrameSection):
    per: Literal["session"] | None = None
    """`session`: it is set up anew for each session, within its tolerance; left out: it stays where it is."""


class FurtherFrameSection(FrameSection):
    model_config = ConfigDict(json_schema_extra={"required": ["in"]})  # the reader says so with more words


class FramesSection(Section):
    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, FurtherFrameSection] = Field(init=False)
    """A frame of your own name: a further tip, or where a sensor rides. `in`: a body, `tool`, `base` or `world`."""
    base: EndFrameSection = EndFrameSection()
    """Where the machine's base stands in the sensor's frame; left out: the identity, exactly known."""
    tool: EndFrameSection = EndFrameSection()
    """Where the tool frame stands on the flange; left out: the identity, exactly known (a 3ups-up-3r has its own)."""

    @property
    def further(self) -> Mapping[str, FurtherFrameSection]:
        """Frames of the file's own names."""
        return self.__pydantic_extra__

    def is_stated(self, frame: str) -> bool:
        """Return True if the file gives the frame ``base`` or ``tool`` itself."""
        return frame in self.model_fields_set


def check_frames(frames: FramesSection, path: Path) -> None:
    """Refuse a base that is carried, and further frames without a carrier or a name of their own."""
    if frames.base.in_ not in (None, "world"):
        raise InputError(
            f"{path}: frames.base.in: found {frames.base.in_!r}, expected 'world', the frame of the sensor; "
            "a frame in another one is a further frame with a name of your own"
        )
    for name, frame in frames.further.items():
        if not frame.in_:
            hint = close_matches(name, ("base", "tool"))
            raise InputError(
                f"{path}: frames.{name}: unknown field; {hint}; a further frame needs `in`: the body that carries it"
            )
        if "." in name or name in ("world", "flange", "platform"):
            raise InputError(
                f"{path}: frames: found a frame {name!r}, expected a name without a dot that is no body's"
            )


class MassToleranceSection(Section):
    kg: MassTolerance = 0.0
    """1-sigma of the mass; .inf where it is unknown."""
    com: LengthToleranceVector = _ZERO
    """1-sigma of its centre."""


class MassSection(Section):
    kg: Mass = Field(ge=0.0)
    """Mass. That of the mass called `payload` is replaced by the recording's column `payload`."""
    com: LengthVector = _ZERO
    """Centre of mass in the frame of `in`."""
    in_: str = Field(alias="in")
    """Body that carries it: linkK of a serial arm, `platform`, a body of the graph or URDF, `flange`, `tool` or `base`."""
    tolerance: MassToleranceSection = MassToleranceSection()
    """How well both are known; left out: exactly. Otherwise `NAME.kg`, `NAME.x` ... are estimated where effects read loads."""

    @property
    def is_known(self) -> bool:
        """Whether nothing of it is to be estimated."""
        return not any((self.tolerance.kg, *self.tolerance.com))


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


class OwnPayload(MassSection):
    """What is carried in place of the mass called ``payload``."""

    kg: Mass = Field(ge=0.0)
    """Mass."""
    in_: str = Field(default="tool", alias="in")
    """Body that carries it, as for masses."""
    tolerance: MassToleranceSection = MassToleranceSection()
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


class SpringEnd(Section):
    """Where a spring is hooked in."""

    in_: str = Field(alias="in")
    """Body that it is hooked to: as for masses, `base` for what stands still."""
    at: LengthVector = (0.0, 0.0, 0.0)
    """The point in the body's frame."""


class SpringTolerance(Section):
    """How well a spring is known."""

    stiffness: StiffnessTolerance = 0.0
    """1-sigma of the stiffness."""
    free_length: LengthTolerance = 0.0
    """1-sigma of the free length."""
    force: ForceTolerance = 0.0
    """1-sigma of the force."""


class SpringSection(Section):
    """A spring, or a balancer of constant force: it pulls its ends together."""

    from_: SpringEnd = Field(alias="from")
    """One end."""
    to: SpringEnd
    """The other end."""
    stiffness: Stiffness = Field(default=0.0, ge=0.0)
    """Force for each millimetre that it is longer than `free_length`; 0: a balancer."""
    free_length: Length = Field(default=0.0, ge=0.0)
    """Distance of its ends at which a spring pulls at nothing but `force`."""
    force: Force = 0.0
    """Constant force that pulls the ends together; below 0 it pushes them apart (a gas spring)."""
    tolerance: SpringTolerance = SpringTolerance()
    """How well they are known; left out: exactly. Otherwise `NAME.stiffness` ... are estimated where effects read loads."""

    @model_validator(mode="after")
    def _pulls(self) -> SpringSection:
        tolerance = self.tolerance
        if not any((self.stiffness, self.force, tolerance.stiffness, tolerance.force)):
            raise bad_value("stiffness or force", 0.0)
        return self


def _task(value: object) -> Task:
    expected = f"a list of components, any of {', '.join(COMPONENTS)}"
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise bad_value(expected, value)
    try:
        return Task.of(value)
    except ValueError as exc:
        raise bad_value(str(exc), value) from None


TaskField = Annotated[
    Task,
    BeforeValidator(_task),
    WithJsonSchema(
        {"type": "array", "items": {"enum": list(COMPONENTS)}, "minItems": 1, "uniqueItems": True}
    ),
]


def _numbers(value: object) -> tuple[float | str, ...]:
    """Numbers in the file's units, and texts such as ``20um``, whose unit the parameter decides on."""
    items: list[Any] = value if isinstance(value, list) else [value]
    if not items or not all(_is_tolerance(item) for item in items):
        raise bad_value(f"a number >= 0 or .inf, at most {LARGEST:g}, or several for a vector", value)
    return tuple(item if isinstance(item, str) else float(item) for item in items)


def _is_tolerance(item: object) -> bool:
    if isinstance(item, str):
        return is_quantity(item) and not item.lstrip().startswith("-")
    number = as_number(item)
    return number is not None and (number == math.inf or 0.0 <= number <= LARGEST)


def _interval(value: object) -> tuple[float, float]:
    items = value if isinstance(value, list) else []
    numbers = [number for number in map(as_number, items) if number is not None]
    if len(items) != 2 or len(numbers) != 2 or not numbers[0] < numbers[1]:
        raise bad_value("[low, high], two numbers with low < high (-.inf and .inf leave a side open)", value)
    return numbers[0], numbers[1]


_NOT_NEGATIVE = {"type": "number", "minimum": 0}
_STATED = WithJsonSchema(
    with_texts(
        {"anyOf": [_NOT_NEGATIVE, {"type": "array", "items": _NOT_NEGATIVE, "minItems": 1, "maxItems": 6}]}
    )
)
Override = Annotated[tuple[float | str, ...], BeforeValidator(_numbers), _STATED]
Interval = Annotated[tuple[float, float], BeforeValidator(_interval), In("the parameter's")]


class DefaultTolerances(Section):
    """What the section ``tolerances`` says of every parameter that nothing else states a tolerance of."""

    length: LengthTolerance = 0.0
    """1-sigma of every length of the mechanism (all `d` and `r`, all `a` and `b` ...)."""
    angle: AngleTolerance = 0.0
    """1-sigma of every angle and direction of the mechanism (all `alpha`, all `theta`, all `u` ...)."""


_AXES, _TURNS, _DIRECTION = ("x", "y", "z"), ("rx", "ry", "rz"), "u"


@dataclass(frozen=True)
class Tolerances:
    """Default 1-sigma tolerances and overrides.

    `length` mm, `angle` rad, 0.0 where the file has none. `overrides` are as written, in the file's units, or as texts
    with their own (`20um`): one number for a name, or numbers for a vector, keyed by a parameter (`leg3.a.x`), by what it
    is a component of (`leg3.a`, `tool`, `tool.xyz`, `tool.rpy`), or by the end of its name (`gain`, `a`,
    `u.x`), which then holds for every element. The more specific key wins.
    """

    length: float = 0.0
    angle: float = 0.0
    overrides: Mapping[str, tuple[float | str, ...]] = field(default_factory=dict)
    units: UnitSystem = field(default_factory=UnitSystem)
    file: str = ""

    def override_for(self, parameter: str, unit: str) -> float | None:
        """The tolerance the file states for this very parameter, in the parameter's unit; None if none.

        A component of a direction (`leg1.u.x`) takes an angle: rad, whatever `unit` says.
        """
        for key, place in _keys(parameter):
            values = self.overrides.get(key)
            if values is None:
                continue
            value = _pick(values, place)
            if value is None:
                expected = "1 number" if place is None else "3 numbers"
                raise InputError(f"{self.file}: tolerances.{key}: expected {expected}, found {list(values)}")
            return self._convert(value, parameter, unit, key)
        return None

    def check(self, parameters: Iterable[str]) -> None:
        """Raise InputError when an override fits none of these parameters."""
        names = list(parameters)
        meant = {key for name in names for key, _ in _keys(name)}
        for key in self.overrides:
            if key not in meant:
                hint = close_matches(key, meant)
                raise InputError(f"{self.file}: tolerances.{key}: no such parameter; {hint}")

    def _convert(self, value: float | str, parameter: str, unit: str, key: str) -> float:
        where = f"{self.file}: tolerances.{key}"
        if isinstance(value, str):
            own = "rad" if _is_direction(parameter) else unit
            stated = quantity(value, own)
            if stated is None:
                raise InputError(
                    f"{where}: found {value!r}, expected a number with a unit convertible to {own}"
                )
            return stated
        if _is_direction(parameter):
            return convert(value, self.units.angle, "rad", where)
        dimensions = ("length", "angle", "gain")
        for dimension in dimensions:
            if unit == self.units.internal(dimension):
                return convert(value, self.units.of(dimension), unit, where)
        for dimension in dimensions:
            if compatible(self.units.of(dimension), unit):
                return convert(value, self.units.of(dimension), unit, where)
        return convert(value, self.units.written(unit), unit, where)


def _is_direction(parameter: str) -> bool:
    parts = parameter.split(".")
    return len(parts) > 1 and parts[-2] == _DIRECTION and parts[-1] in _AXES


def _keys(parameter: str) -> list[tuple[str, int | None]]:
    """Keys that cover a parameter, most specific first, with its place in a vector (None: a number)."""
    parts = parameter.split(".")
    stem, last = ".".join(parts[:-1]), parts[-1]
    keys: list[tuple[str, int | None]] = [(parameter, None)]
    if stem and last in _AXES:
        keys += [(f"{stem}.xyz", _AXES.index(last)), (stem, _AXES.index(last))]
    elif stem and last in _TURNS:
        keys += [(f"{stem}.rpy", _TURNS.index(last)), (stem, 3 + _TURNS.index(last))]
    for first in range(1, len(parts)):
        keys.append((".".join(parts[first:]), None))
        if first < len(parts) - 1 and last in _AXES:
            keys.append((".".join(parts[first:-1]), _AXES.index(last)))
    return keys


def _pick(values: tuple[float | str, ...], place: int | None) -> float | str | None:
    if place is None:
        return values[0] if len(values) == 1 else None
    if len(values) == 1 and place < 3:
        return values[0]
    if place < len(values) and len(values) in {3, 6}:
        return values[place]
    return None


class UnitsSection(Section):
    length: str = "mm"
    """Unit of every length of the file and, unless a column says its own, of its recordings."""
    angle: str = "deg"
    """Unit of every angle of the file and, unless a column says its own, of its recordings."""
    joint: str | None = None
    """Unit of a hexapod's leg readings, where it is another than `length`: `turn` of a motor, say."""


def read_units(section: object, path: Path) -> UnitSystem:
    try:
        units = UnitsSection.model_validate(section)
    except ValidationError as exc:
        raise input_error(exc, path, "units") from None
    where = f"{path}: units"
    length = parse_unit(units.length, "length", f"{where}.length")
    angle = parse_unit(units.angle, "angle", f"{where}.angle")
    if units.joint is None:
        return UnitSystem(length, angle)
    return UnitSystem(length, angle, parse_unit(units.joint, "reading", f"{where}.joint"))
