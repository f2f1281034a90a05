"""What a builder is: a function from its section of the machine file to a Mechanism.

To add one, write a file in ``truepose.models.builders`` (or a plugin) with a function registered by
``@builders.add("my-type")``; it parses its own section and returns bodies, joints and parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from pydantic import ValidationError

from truepose.models.file.fields import Section, input_error
from truepose.models.file.machine_file import MachineFile
from truepose.models.machine.mechanism import AXES, AXIS_UNITS, Mechanism, Parameter
from truepose.models.registry import Registry

S = TypeVar("S", bound=Section)


@dataclass(frozen=True)
class BuildContext:
    """The machine file around a section, and the section's field path in it; sensors know the mechanism that they read."""

    file: MachineFile
    path: tuple[str | int, ...]
    mechanism: Mechanism | None = None

    @property
    def field(self) -> str:
        """The section's path as a user writes it: ``sensor[1]``."""
        return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in self.path).lstrip(".")

    @property
    def where(self) -> str:
        """File and field, to open a message with."""
        return f"{self.file.path}: {self.field}"

    def parse(self, kind: type[S], section: Mapping[str, Any]) -> S:
        """Validate a section into internal units; InputError names file and field."""
        try:
            return kind.model_validate(dict(section), context={"units": self.file.units})
        except ValidationError as exc:
            raise input_error(exc, self.file.path, self.field) from None

    def parameter(
        self,
        name: str,
        unit: str,
        nominal: float,
        field: tuple[str | int, ...],
        part: str | None = None,
        default: float | None = None,
    ) -> Parameter:
        """A parameter with the tolerance its file gives it.

        The file's override wins, then ``default``, then the file's tolerance for lengths or angles.
        ``field`` is where the value stands in the section; ``part`` defaults to length or angle: tolerances
        that were stated together.
        """
        tolerance = self.file.override_for(name, unit)
        if tolerance is None:
            tolerance = default
        if tolerance is None:
            tolerance = self.file.tolerances.length if unit == "mm" else self.file.tolerances.angle
        part = part or ("length" if unit == "mm" else "angle")
        return Parameter(name, unit, float(nominal), float(tolerance), part, (*self.path, *field))

    def vector(
        self,
        name: str,
        values: Sequence[float],
        field: tuple[str | int, ...],
        part: str | None = None,
        defaults: Sequence[float | None] | None = None,
    ) -> tuple[Parameter, ...]:
        """Return the parameters NAME.x, NAME.y and NAME.z of a point (3,), mm, or all six of a frame (6,), mm and rad.

        ``field`` is that of a point, or of the frame that holds ``xyz`` and ``rpy``; the rest is as in ``parameter``.
        """
        parts: list[tuple[str | int, ...]] = [(half, k) for half in ("xyz", "rpy") for k in range(3)]
        places = parts if len(values) == len(AXES) else [(k,) for k in range(3)]
        known: Sequence[float | None] = defaults or [None] * len(values)
        rows = zip(AXIS_UNITS.items(), values, places, known, strict=False)
        return tuple(
            self.parameter(f"{name}.{axis}", unit, value, (*field, *place), part, default)
            for (axis, unit), value, place, default in rows
        )


Builder = Callable[[Mapping[str, Any], BuildContext], Mechanism]
builders: Registry[Builder] = Registry("mechanism type", "truepose.models.builders")
