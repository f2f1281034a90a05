"""``export``: a calibrated machine as a file of another format, with what that format cannot hold said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from truepose.errors import InputError
from truepose.files import atomic_write_text
from truepose.models.export.held import SAMPLES, Held, Loss, held, loss
from truepose.models.export.tree import tree_of
from truepose.models.export.ur_kinematics import ur_kinematics_text
from truepose.models.export.urdf import urdf_text
from truepose.models.machine import Machine

Format = Literal["urdf", "ur-kinematics"]
FORMATS: tuple[Format, ...] = ("urdf", "ur-kinematics")
_SUFFIXES: Mapping[str, Format] = {".urdf": "urdf", ".yaml": "ur-kinematics", ".yml": "ur-kinematics"}
_LISTED = 5
"""Effects that a note names; the file names all."""
_TITLES: Mapping[Format, str] = {"urdf": "URDF", "ur-kinematics": "ur-kinematics"}


@dataclass(frozen=True)
class Exported:
    """A text in a format and what it lacks.

    ``left_out`` is the largest change of the tool's position (mm) by each effect that the format cannot hold, ``lost``
    that by all of them; ``frozen`` are the drivers' values at which other effects are held, by effect.
    """

    format: Format
    text: str
    left_out: Mapping[str, float] = field(default_factory=dict)
    lost: float = 0.0
    frozen: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def export(machine: Machine, path: Path | str, format: str | None = None) -> Exported:
    """Write ``machine`` to ``path`` as ``urdf`` or ``ur-kinematics``, by the path's suffix where ``format`` is None.

    Constants, and effects that are constants, are held exactly; what else is left out is in the result, in ``notes``
    and, in full, in a comment of the file. The same machine gives the same bytes.

    Raises InputError for an unknown format, the machine's own file, a machine with loops or passive joints, and for
    ``ur-kinematics`` where the machine is no chain of six revolute joints.
    """
    chosen = format_of(path, format)
    if machine.file is not None and Path(path).resolve() == machine.file.path.resolve():
        raise InputError(f"{path}: found the machine file itself, expected another file to write")
    done = render(machine, chosen)
    atomic_write_text(path, done.text)
    return done


def format_of(path: Path | str, format: str | None) -> Format:
    """The format that is named, or that a path's suffix means. Raises InputError where there is none."""
    if format is None:
        found: Format | None = _SUFFIXES.get(Path(path).suffix.lower())
        if found is None:
            expected = f"{', '.join(_SUFFIXES)}, or --format {'|'.join(FORMATS)}"
            raise InputError(f"{path}: found the suffix {Path(path).suffix!r}, expected {expected}")
        return found
    for known in FORMATS:
        if format == known:
            return known
    raise InputError(f"format: found {format!r}, expected {' or '.join(FORMATS)}")


def render(machine: Machine, format: Format) -> Exported:
    """The text of a machine in a format, and what it lacks. Raises InputError as ``export`` does."""
    holding = held(machine)
    tree = tree_of(machine, holding.values, _TITLES[format])
    missing = loss(machine, tree, holding.left) if holding.left else Loss({}, 0.0)
    title = _TITLES[format]
    lines = _lines(holding, missing, title, len(machine.effects))
    text = urdf_text(machine, tree, lines) if format == "urdf" else ur_kinematics_text(tree, lines)
    notes = _lines(holding, missing, title, _LISTED)
    return Exported(format, text, missing.each, missing.together, holding.frozen, notes)


def _lines(holding: Held, missing: Loss, title: str, most: int) -> tuple[str, ...]:
    """What is left out, largest first, and what is held at its drivers' defaults; so many effects are named."""
    out = []
    if missing.each:
        sizes = sorted(missing.each.items(), key=lambda item: -item[1])
        listed = _listed([f"{label} ({size:.3g} mm)" for label, size in sizes], most)
        out.append(
            f"{title} cannot hold, and leaves out: {listed}; together up to {missing.together:.3g} mm at the tool "
            f"({SAMPLES} poses, drivers at their defaults)"
        )
    if holding.frozen:
        named = [
            f"{label} ({', '.join(f'{name} = {value:g}' for name, value in drivers.items())})"
            for label, drivers in holding.frozen.items()
        ]
        out.append(f"{title} holds only at these values of their drivers: {_listed(named, most)}")
    return tuple(out)


def _listed(items: list[str], most: int) -> str:
    more = [f"and {len(items) - most} more"] if len(items) > most else []
    return ", ".join(items[:most] + more)
