"""Frames of a machine file: base, tool, and further ones of its own names, as parameters and as what carries them."""

from __future__ import annotations

from itertools import takewhile

from truepose.errors import InputError
from truepose.models.file.machine_file import MachineFile
from truepose.models.file.sections import FrameSection, FrameToleranceSection
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.machine import FRAMES, Mount, body_of
from truepose.models.machine.mechanism import BASE, Mechanism, Parameter
from truepose.models.machine.sensor import TOOL, WORLD
from truepose.wording import close_matches


def frame_parameters(file: MachineFile, mechanism: Mechanism) -> tuple[Parameter, ...]:
    """base.x ... base.rz, tool.x ... tool.rz, then those of the file's further frames; mm, rad."""
    _check_tool(file, mechanism)
    frames = {BASE: file.frames.base, TOOL: _tool(file, mechanism.tool_length), **file.frames.further}
    out: list[Parameter] = []
    for frame, section in frames.items():
        context, stated = BuildContext(file, ("frames", frame)), section.tolerance
        known = (*stated.xyz, *stated.rpy)
        out += context.vector(frame, (*section.xyz, *section.rpy), (), "frame", known)
    return tuple(out)


def mounts(file: MachineFile, mechanism: Mechanism) -> tuple[Mount, ...]:
    """What carries each further frame. Raises InputError for an unknown body, and for a name that is another's."""
    taken = {*mechanism.bodies, *(joint.name for joint in mechanism.joints)}
    out = []
    for name, spec in file.frames.further.items():
        where = f"{file.path}: frames.{name}"
        if name in taken:
            raise InputError(
                f"{where}: found the name of a body or joint, expected a name of the frame's own"
            )
        carrier = str(spec.in_)
        body = WORLD if carrier == WORLD else body_of(mechanism, carrier)
        if body is None:
            hint = close_matches(carrier, (*mechanism.bodies, "flange", TOOL, WORLD))
            raise InputError(f"{where}.in: found {carrier!r}, expected a body, {TOOL} or {WORLD}; {hint}")
        if name not in _used(file):
            hint = close_matches(name, FRAMES)
            raise InputError(
                f"{where}: found a frame that no sensor reads (`tip: {name}`), none stands in (`in: {name}`) and no mass, "
                f"spring or force acts in, expected one that does; {hint}"
            )
        if carrier in mechanism.table_frames:
            raise InputError(
                f"{where}.in: found {carrier!r} of a standard table, expected flange, or the table in the modified "
                "convention, whose links have the frames of their joints"
            )
        out.append(Mount(name, body))
    return tuple(out)


def _check_tool(file: MachineFile, mechanism: Mechanism) -> None:
    """The tool hangs on the flange: its `in` may name that body, or one that does not move against it."""
    said, way = file.frames.tool.in_ or "flange", mechanism.way(mechanism.flange)
    still = takewhile(lambda joint: joint.kind == "fixed", reversed(way))
    fixed = {mechanism.flange, *(joint.parent for joint in still)}
    if said not in ("flange", *mechanism.table_frames) and body_of(mechanism, said) not in fixed:
        raise InputError(
            f"{file.path}: frames.tool.in: found {said!r}, expected flange, which is {mechanism.flange!r}; a frame of "
            "your own name may stand in any body (a sensor reads it with `tip`)"
        )


def _tool(file: MachineFile, length: float) -> FrameSection:
    """The tool frame of the file, or the one that a mechanism's form implies: as well known as its lengths and angles."""
    if file.frames.is_stated(TOOL) or not length:
        return file.frames.tool
    known = FrameToleranceSection.model_construct(
        xyz=(file.tolerances.length,) * 3, rpy=(file.tolerances.angle,) * 3
    )
    return FrameSection.model_construct(xyz=(0.0, 0.0, length), tolerance=known)


def _used(file: MachineFile) -> set[object]:
    """Names of frames that something reads, stands in, hangs on or pushes at."""
    read = (sensor.get(key) for sensor in file.sensors for key in ("tip", "in"))
    payloads = (each.payload for each in file.recordings.values() if each.payload)
    return {
        *(name for name in read if isinstance(name, str)),
        *(end.in_ for spring in file.loads.values() for end in (spring.from_, spring.to)),
        *(payload.in_ for payload in payloads),
        *(frame for force in file.forces.values() for frame in (force.in_, force.axes)),
        *(mass.in_ for mass in file.masses.values()),
    }
