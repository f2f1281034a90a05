"""Springs of a machine file, on the bodies that they are hooked to."""

from __future__ import annotations

from truepose.errors import InputError
from truepose.models.file.machine_file import MachineFile
from truepose.models.file.spring_section import SpringEnd, SpringSection
from truepose.models.machine.machine import Spring, body_of
from truepose.models.machine.mechanism import Mechanism
from truepose.models.machine.parameters import Parameter
from truepose.models.machine.weights import Triple, in_body
from truepose.wording import close_matches

_UNITS = {"force": "N", "stiffness": "N/mm", "free_length": "mm"}


def springs(file: MachineFile, mechanism: Mechanism) -> tuple[Spring, ...]:
    """Checked against the mechanism. Raises InputError for an unknown body, and for two ends on one."""
    out = []
    for name, section in file.loads.items():
        where = f"{file.path}: loads.{name}"
        ends = (
            _end(section.from_, f"{where}.from", file, mechanism),
            _end(section.to, f"{where}.to", file, mechanism),
        )
        if ends[0][0] == ends[1][0]:
            raise InputError(
                f"{where}: found both ends in {ends[0][0]!r}, expected two bodies that move against each other"
            )
        constants = {key: float(getattr(section, key)) for key in _UNITS}
        out.append(Spring(name, ends, constants, _parameters(name, section, constants, file)))
    return tuple(out)


def _end(end: SpringEnd, where: str, file: MachineFile, mechanism: Mechanism) -> tuple[str, Triple]:
    body = end.in_ if end.in_ in file.frames.further else body_of(mechanism, end.in_)
    if body is None:
        hint = close_matches(end.in_, (*mechanism.bodies, "flange", "tool", *file.frames.further))
        raise InputError(f"{where}.in: found {end.in_!r}, expected a body; {hint}")
    return body, in_body(mechanism, body, end.at)


def _parameters(
    name: str, section: SpringSection, constants: dict[str, float], file: MachineFile
) -> tuple[Parameter, ...]:
    """What is not exactly known of a spring: all its constants, or none."""
    stated = {key: float(getattr(section.tolerance, key)) for key in _UNITS}
    if not any(stated.values()):
        return ()
    out = []
    for key, unit in _UNITS.items():
        own = file.override_for(f"{name}.{key}", unit)
        tolerance = stated[key] if own is None else own
        out.append(
            Parameter(f"{name}.{key}", unit, constants[key], tolerance, "spring", ("loads", name, key))
        )
    return tuple(out)
