"""Frames of a machine file: base, tool, and further ones of its own names, as parameters and as what carries them."""

from __future__ import annotations

from collections.abc import Iterator

from truepose.errors import InputError
from truepose.models.file.machine_file import MachineFile
from truepose.models.file.sections import FrameSpec, FrameTolerance
from truepose.models.machine.machine import FRAMES, Mount, body_of
from truepose.models.machine.mechanism import AXIS_UNITS, BASE, Mechanism, Parameter
from truepose.models.machine.sensor import TOOL, WORLD
from truepose.wording import close_matches


def frame_parameters(file: MachineFile, mechanism: Mechanism) -> tuple[Parameter, ...]:
    """base.x ... base.rz, tool.x ... tool.rz, then those of the file's further frames; mm, rad."""
    out: list[Parameter] = []
    for frame, spec in _specs(file, mechanism):
        values, tolerances = (*spec.xyz, *spec.rpy), (*spec.tolerance.xyz, *spec.tolerance.rpy)
        for k, (axis, unit) in enumerate(AXIS_UNITS.items()):
            name, field = f"{frame}.{axis}", ("frames", frame, "xyz" if k < 3 else "rpy", k % 3)
            override = file.override_for(name, unit)
            tolerance = tolerances[k] if override is None else override
            out.append(Parameter(name, unit, values[k], tolerance, "frame", field))
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
        body = WORLD if spec.in_ == WORLD else body_of(mechanism, spec.in_)
        if body is None:
            known = (*mechanism.bodies, "flange", TOOL, WORLD)
            hint = close_matches(spec.in_, known)
            raise InputError(f"{where}.in: found {spec.in_!r}, expected a body, {TOOL} or {WORLD}; {hint}")
        if name not in _used(file):
            hint = close_matches(name, FRAMES)
            raise InputError(
                f"{where}: found a frame that no sensor reads (`tip: {name}`), none stands in (`in: {name}`) and no mass, "
                f"spring or force acts in, expected one that does; {hint}"
            )
        if spec.in_ in mechanism.table_frames:
            raise InputError(
                f"{where}.in: found {spec.in_!r} of a standard table, expected flange, or the table in the modified "
                "convention, whose links have the frames of their joints"
            )
        out.append(Mount(name, body))
    return tuple(out)


def _specs(file: MachineFile, mechanism: Mechanism) -> Iterator[tuple[str, FrameSpec]]:
    yield BASE, file.frames.base
    tool = file.frames.tool
    _check_tool(file, mechanism)
    implied = not tool.present and mechanism.tool_length
    yield TOOL, _own_tool(file, mechanism.tool_length) if implied else tool
    yield from file.frames.further.items()


def _check_tool(file: MachineFile, mechanism: Mechanism) -> None:
    """The tool hangs on the flange: its `in` may name that body, or one that does not move against it."""
    said, above = file.frames.tool.in_, {joint.child: joint for joint in mechanism.tree}
    body, fixed = mechanism.flange, {mechanism.flange}
    while body in above and above[body].kind == "fixed":
        body = above[body].parent
        fixed.add(body)
    if said not in ("flange", *mechanism.table_frames) and body_of(mechanism, said) not in fixed:
        raise InputError(
            f"{file.path}: frames.tool.in: found {said!r}, expected flange, which is {mechanism.flange!r}; a frame of "
            "your own name may stand in any body (a sensor reads it with `tip`)"
        )


def _own_tool(file: MachineFile, length: float) -> FrameSpec:
    """The tool frame that a mechanism's form implies: as well known as its other lengths and angles."""
    tolerance = FrameTolerance((file.tolerances.length,) * 3, (file.tolerances.angle,) * 3)
    return FrameSpec("flange", (0.0, 0.0, length), tolerance=tolerance)


def _used(file: MachineFile) -> set[object]:
    read = {
        sensor.get(key)
        for sensor in file.sensors
        for key in ("tip", "in")
        if isinstance(sensor.get(key), str)
    }
    hooked: tuple[str, ...] = tuple(
        end.in_ for spring in file.loads.values() for end in (spring.from_, spring.to)
    )
    hooked = (*hooked, *(each.payload.in_ for each in file.recordings.values() if each.payload))
    pushed = (frame for force in file.forces.values() for frame in (force.in_, force.axes))
    return {*read, *hooked, *pushed, *(mass.in_ for mass in file.masses)}
