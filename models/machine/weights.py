"""Masses and gravity of a machine: what its file states, else what the description of its mechanism says (a URDF)."""

from __future__ import annotations

import math

from truepose.errors import InputError
from truepose.models.file.driver import PAYLOAD
from truepose.models.file.machine_file import MachineFile, MassSpec
from truepose.models.machine.machine import Mass, body_of
from truepose.models.machine.mechanism import Mechanism
from truepose.models.machine.parameters import Parameter
from truepose.wording import close_matches

Triple = tuple[float, float, float]


def weights(
    file: MachineFile, mechanism: Mechanism
) -> tuple[tuple[Mass, ...], Triple | None, tuple[str, ...]]:
    """Masses, gravity (m/s^2, base frame) and notes on what did not come from the file.

    What the file states wins: any mass but the payload, or an empty ``masses:``, stands in place of all inertials, and
    ``gravity:`` in place of the description's. Raises InputError for a mass on an unknown body.
    """
    stated = tuple(mass_of(mechanism, mass, file, ("masses", mass.name)) for mass in file.masses)
    own = "masses" in file.raw and (not stated or any(mass.name != PAYLOAD for mass in stated))
    if own or not mechanism.inertials:
        return stated, file.gravity, ()
    read = tuple(
        Mass(f"{i.body}_link" if i.body == PAYLOAD else i.body, i.kg, i.com, i.body)
        for i in mechanism.inertials
    )
    gravity = file.gravity if "gravity" in file.raw else mechanism.gravity
    of_file = (_note(file, read, gravity),) if "file" in file.mechanism else ()
    return (*read, *stated), gravity, (*of_file, *mechanism.notes)


def _note(file: MachineFile, read: tuple[Mass, ...], gravity: Triple | None) -> str:
    total = math.fsum(mass.kg for mass in read)
    source = file.mechanism.get("file", "the mechanism's description")
    text = f"{file.path}: {len(read)} masses, {total:.4g} kg together, were read from {source}"
    if "gravity" in file.raw or gravity is None:
        return text
    values = ", ".join(f"{value + 0.0:.6g}" for value in gravity)
    return f"{text}; gravity [{values}] is that of its root link standing upright: state `gravity:` if it does not"


def mass_of(mechanism: Mechanism, mass: MassSpec, file: MachineFile, field: tuple[str | int, ...]) -> Mass:
    """A mass that the file states in ``field``. Raises InputError for an unknown body."""
    body = mass.in_ if mass.in_ in file.frames.further else body_of(mechanism, mass.in_)
    if body is None:
        hint = close_matches(mass.in_, (*mechanism.bodies, "flange", "tool", *file.frames.further))
        raise InputError(f"{file.path}: {_path(field)}.in: found {mass.in_!r}, expected a body; {hint}")
    com = in_body(mechanism, body, mass.com)
    return Mass(
        mass.name, mass.kg, com, body, () if mass.known else _parameters(mass, com, mechanism, file, field)
    )


def _path(field: tuple[str | int, ...]) -> str:
    return ".".join(str(key) for key in field)


def _parameters(
    mass: MassSpec, com: Triple, mechanism: Mechanism, file: MachineFile, place: tuple[str | int, ...]
) -> tuple[Parameter, ...]:
    """kg, then the centre in the body's frame, mm."""
    if mass.in_ in mechanism.table_frames and any(mass.com_tolerance):
        raise InputError(
            f"{file.path}: {_path(place)}.tolerance.com: found one of a mass on a link of a standard table, expected "
            "the table in the modified convention, whose links have the frames of their joints"
        )

    def parameter(
        name: str, unit: str, value: float, tolerance: float, kind: str, field: tuple[str | int, ...]
    ) -> Parameter:
        stated = file.override_for(f"{mass.name}.{name}", unit)
        known = tolerance if stated is None else stated
        return Parameter(f"{mass.name}.{name}", unit, value, known, kind, (*place, *field))

    centre = (
        parameter(axis, "mm", com[k], mass.com_tolerance[k], "centre", ("com", k))
        for k, axis in enumerate("xyz")
    )
    return (parameter("kg", "kg", mass.kg, mass.kg_tolerance, "mass", ("kg",)), *centre)


def in_body(mechanism: Mechanism, body: str, com: Triple) -> Triple:
    """A centre in the frame that the file means by a body's name, in the body's own frame; mm."""
    if body not in mechanism.table_frames:
        return com
    a, alpha = mechanism.table_frames[body]
    x, y, z = com
    c, s = math.cos(alpha), math.sin(alpha)
    return (a + x, c * y - s * z, s * y + c * z)


__all__ = ["in_body", "mass_of", "weights"]
