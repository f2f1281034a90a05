"""The machine file: reading, checking and writing its YAML.

`read_machine` checks everything that does not depend on the kind of mechanism, sensor or effect, and
turns it into internal units (mm, rad, kg). The sections `mechanism` and `sensor` stay as written: their
`type` picks who reads them, with `Section` models and `input_error`. `write_machine` writes a changed
copy of `MachineFile.raw`.
"""

from __future__ import annotations

import copy
import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, WithJsonSchema

from truepose.errors import InputError
from truepose.files import atomic_write_text
from truepose.models.file.effect_entry import EffectSpec, read_effects
from truepose.models.file.fields import In, Number, Section, Vector, bad_value, input_error
from truepose.models.file.limits import LEAST_GRAVITY, NAMED, PARTS
from truepose.models.file.names import EXPECTED, NAMED_SO, SCHEMA_LINE, check_document, nearest_name
from truepose.models.file.sections import (
    DefaultTolerances,
    DriverEntry,
    DriverField,
    ExpectedPose,
    ForceSection,
    FramesSection,
    Interval,
    JudgementSection,
    MassSection,
    Override,
    RecordingSection,
    SpringSection,
    TaskField,
    Tolerances,
    UnitsSection,
    check_frames,
    read_units,
)
from truepose.models.file.yaml_document import document_text, read_document
from truepose.models.task import Task
from truepose.models.units import UnitSystem

SCHEMA: Final = "truepose/machine/1"
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class MachineFile:
    """A checked machine file in internal units; `mechanism` and `sensors` as written."""

    path: Path
    name: str
    units: UnitSystem
    gravity: Triple | None  # m/s^2, base frame
    mechanism: Mapping[str, Any]
    frames: FramesSection
    sensors: tuple[Mapping[str, Any], ...]
    tolerances: Tolerances
    masses: Mapping[str, MassSection]
    drivers: tuple[DriverEntry, ...]
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
    task: Task | None = None  # components of the pose to be met; None where the file states none
    digest: str = ""  # SHA-256 of the file that was read; empty for a document in memory

    def override_for(self, parameter: str, unit: str) -> float | None:
        """The tolerance that `tolerances:` states for a parameter, in its `unit`; None if none."""
        return self.tolerances.override_for(parameter, unit)


_AS_DOCUMENTED: Final = (
    "name", "gravity", "mechanism", "frames", "masses", "drivers", "covariance", "nominal", "sessions", "bounds",
    "pose_error", "loads", "forces", "recordings", "task",
)  # fmt: skip
"""Fields that a machine file has as its document states them."""


def _typed_mapping(value: object) -> object:
    if not isinstance(value, dict):
        raise bad_value("a mapping with a field 'type'", value)
    if not isinstance(value.get("type"), str):
        raise bad_value("a field 'type' with a text", value.get("type"))
    return value


def _one_or_several(value: object) -> object:
    return value if isinstance(value, list) else [_typed_mapping(value)]


RawSection = Annotated[dict[str, Any], BeforeValidator(_typed_mapping)]


def _named(name: str) -> str:
    if nearest_name(name) != name:
        raise bad_value(f"{EXPECTED}: {nearest_name(name)}", name)
    return name


class MachineDocument(Section):
    """A machine file as it is written."""

    schema_: Any = Field(alias="schema", json_schema_extra={"const": SCHEMA})
    """Always `truepose/machine/1`: what kind of file this is."""
    name: Annotated[str, AfterValidator(_named), WithJsonSchema({"type": "string", "pattern": NAMED_SO})]
    """What the machine is called; files and functions of its C have this name."""
    units: UnitsSection = UnitsSection()
    """The units that the file is written in."""
    gravity: Annotated[Vector, In("m/s^2")] | None = None
    """Acceleration of free fall in the base frame, [0, 0, -9.81] where z is up; left out: weights play no part."""
    mechanism: RawSection
    """The machine's geometry as drawn. Its `type` says which keys it has."""
    frames: FramesSection = FramesSection()
    """Where the machine stands and what it carries."""
    sensor: Annotated[list[RawSection], BeforeValidator(_one_or_several)] = Field(default_factory=list)
    """What measures it: one sensor, or a list whose readings add up. Its `type` says which keys it has."""
    tolerances: dict[str, Override] = Field(default_factory=dict)
    """1-sigma of the hardware as built, before any measurement."""
    masses: dict[str, MassSection] = Field(default_factory=dict)
    """What has weight, by a name of your own; used together with `gravity`."""
    task: TaskField | None = None
    """Components of the tool's pose that have to be met, such as `[x, y, z, axis]`; left out: all that the joints can hold."""
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
    bounds: dict[str, Interval] = Field(default_factory=dict)
    """Between which values parameters may be estimated, `leg1.length: [499, 501]`; kept by `--solver ipopt`."""
    pose_error: ExpectedPose | None = None
    """What the fit was worth to the tool. Written by truepose."""
    judgement: JudgementSection | None = None
    """Whether the fit may be called a calibration, and why not. Written by truepose."""


def read_machine(path: Path | str) -> MachineFile:
    """Read and check a machine file.

    Raises InputError naming file, field, what was found and what was expected.
    """
    file = checked_machine(Path(path), read_document(path))
    return replace(file, digest=hashlib.sha256(Path(path).read_bytes()).hexdigest())


def checked_machine(path: Path, raw: dict[str, Any]) -> MachineFile:
    """The machine of a document that stands, or is to stand, in the file ``path``. Raises InputError as `read_machine`."""
    if raw.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema: found {raw.get('schema')!r}, expected {SCHEMA!r}")
    _check_sizes(raw, path)
    check_document(raw, str(path))
    units = read_units(raw.get("units", {}), path)
    try:
        document = MachineDocument.model_validate(copy.deepcopy(raw), context={"units": units})
    except ValidationError as exc:
        raise input_error(exc, path) from None
    _check_gravity(document.gravity, path)
    check_frames(document.frames, path)
    same = {name: getattr(document, name) for name in _AS_DOCUMENTED}
    return MachineFile(
        path=path,
        units=units,
        sensors=tuple(document.sensor),
        tolerances=_tolerances(raw.get("tolerances"), document.tolerances, units, path),
        effects=read_effects(document.effects, path),
        raw=raw,
        refused=document.judgement.refusal if document.judgement else (),
        **same,
    )


def _check_gravity(gravity: Triple | None, path: Path) -> None:
    """Refuse what is no free fall and has a direction all the same."""
    if gravity is not None and 0.0 < math.hypot(*gravity) < LEAST_GRAVITY:
        raise InputError(
            f"{path}: gravity: found {list(gravity)}, expected [0, 0, 0] or an acceleration of at least {LEAST_GRAVITY:g} m/s^2"
        )


def _check_sizes(raw: Mapping[str, Any], path: Path) -> None:
    """Refuse what has more parts than a machine: its equations would take hours."""
    parts = [(PARTS, "mechanism", raw.get("mechanism")), *((NAMED, name, raw[name]) for name in raw)]
    for most, section, held in parts:
        inner = held.items() if isinstance(held, dict) else ()
        lists = [(section, held), *((f"{section}.{key}", value) for key, value in inner)]
        for where, value in lists:
            if isinstance(value, (list, dict)) and len(value) > most:
                raise InputError(f"{path}: {where}: found {len(value):,} entries, expected at most {most:,}")


def _tolerances(
    stated: object, named: Mapping[str, tuple[float | str, ...]], units: UnitSystem, path: Path
) -> Tolerances:
    """Those of lengths and angles, which are read from what is ``stated``, and of what is ``named`` beside them."""
    defaults = {}
    if isinstance(stated, dict):
        defaults = {key: stated[key] for key in DefaultTolerances.model_fields if key in stated}
    try:
        default = DefaultTolerances.model_validate(defaults, context={"units": units})
    except ValidationError as exc:
        raise input_error(exc, path, "tolerances") from None
    overrides = {key: value for key, value in named.items() if key not in defaults}
    return Tolerances(default.length, default.angle, overrides, units, str(path))


def write_machine(path: Path | str, document: Mapping[str, Any]) -> None:
    """Write a machine file: whole or not at all."""
    atomic_write_text(path, machine_text(document))


def machine_text(document: Mapping[str, Any], comment: str = "") -> str:
    """Return the text of a machine file: key order kept, floats at full precision.

    Its first line is ``comment``, if there is one; then its schema is named.
    """
    head = f"# {comment}\n" if comment else ""
    return f"{head}{SCHEMA_LINE}\n{document_text(document)}"
