"""``export``: a calibrated machine as a file of another format, with what that format cannot hold said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from truepose.errors import InputError
from truepose.files import atomic_write_text
from truepose.models.given import MachineLike, as_machine
from truepose.models.leaves.export.held import SAMPLES, Held, Loss, closed_loss, held, held_tools, loss
from truepose.models.leaves.export.iso230 import isg_text, iso230_text
from truepose.models.leaves.export.mjcf import mjcf_text
from truepose.models.leaves.export.mjcf_loops import mjcf_loops_text
from truepose.models.leaves.export.read_back import check_export
from truepose.models.leaves.export.standing import standing
from truepose.models.leaves.export.tree import tree_of
from truepose.models.leaves.export.ur_kinematics import ur_kinematics_text
from truepose.models.leaves.export.urdf import urdf_text
from truepose.models.leaves.export.volumetric import CHECKED, Table, table_of
from truepose.models.leaves.export.xacro import xacro_text
from truepose.models.machine.kinematics import driver_default
from truepose.models.machine.machine import Machine

Format = Literal["urdf", "xacro", "mjcf", "ur-kinematics", "iso230", "isg-csv"]
_SUFFIXES: Mapping[str, Format] = {
    ".urdf": "urdf",
    ".xacro": "xacro",
    ".xml": "mjcf",
    ".yaml": "ur-kinematics",
    ".yml": "ur-kinematics",
    ".csv": "iso230",
}
_LISTED = 5
"""Effects that a note names; the file names all."""
_ALL = 1_000_000
_TITLES: Mapping[Format, str] = {
    "urdf": "URDF",
    "xacro": "xacro",
    "mjcf": "MJCF",
    "ur-kinematics": "ur-kinematics",
    "iso230": "the volumetric table",
    "isg-csv": "the volumetric table",
}
FORMATS: tuple[Format, ...] = tuple(_TITLES)
_TABLES = ("iso230", "isg-csv")
_KEPT = 1e-6
"""mm; what a table loses of an effect less than this it holds."""
_CLOSED = 1e-6
"""mm; loops that lack less than this close."""


@dataclass(frozen=True)
class Exported:
    """A text in a format and what it lacks.

    ``left_out`` is the largest change of the tool's position (mm) by each effect that the format cannot hold, ``lost``
    that by all of them; ``frozen`` are the drivers' values at which other effects, and tools of recordings, are held.
    """

    format: Format
    text: str
    left_out: Mapping[str, float] = field(default_factory=dict)
    lost: float = 0.0
    frozen: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def export(machine: MachineLike, path: Path | str, format: str | None = None) -> Exported:
    """Write ``machine`` to ``path`` in one of ``FORMATS``, by the path's suffix where ``format`` is None.

    In descriptions of links (``urdf``, ``xacro``, ``mjcf``, ``ur-kinematics``) constants, and effects that are constants, are
    held exactly; in volumetric tables (``iso230``, ``isg-csv``) all that each axis does by itself. What else is left out is in
    the result, in ``notes`` and, in full, in a comment of the file. The same machine gives the same bytes.

    Raises InputError for an unknown format, the machine's own file, a machine with loops or passive joints, for
    ``ur-kinematics`` where the machine is no chain of six revolute joints, and for a table where it has no linear axis. Raises
    ReadBackError, and writes nothing, where the text would not be read as the machine.
    """
    machine = as_machine(machine)
    chosen = format_of(path, format)
    if machine.file is not None and Path(path).resolve() == machine.file.path.resolve():
        raise InputError(f"{path}: found the machine file itself, expected another file to write")
    done = render(machine, chosen)
    check_export(done.text, machine, chosen, str(path))
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
    if format in _TABLES:
        return _tabled(machine, format)
    holding = held(machine)
    if format == "mjcf" and (machine.mechanism.rods or machine.mechanism.closing):
        return _looped(machine, holding)
    tree = tree_of(machine, holding.values, _TITLES[format])
    missing = loss(machine, tree, holding.left) if holding.left else Loss({}, 0.0)
    title = _TITLES[format]
    lines = _lines(holding, missing, title, _ALL)
    if format == "ur-kinematics":
        text = ur_kinematics_text(tree, lines)
    else:
        text = {"urdf": urdf_text, "xacro": xacro_text, "mjcf": mjcf_text}[format](machine, tree, lines)
    notes = _lines(holding, missing, title, _LISTED)
    return Exported(format, text, missing.each, missing.together, holding.frozen, notes)


def _looped(machine: Machine, holding: Held) -> Exported:
    """A machine with closed loops as MJCF."""
    at = standing(machine, holding.values, _TITLES["mjcf"])
    missing = closed_loss(machine, holding.left) if holding.left else Loss({}, 0.0)
    strained = [
        f"loops are strained: at home {at.gap:.3g} mm are left, which MuJoCo's constraints share out in their own way"
    ] * (at.gap > _CLOSED)
    lines = (*strained, *_lines(holding, missing, _TITLES["mjcf"], _ALL))
    text = mjcf_loops_text(machine, at, lines)
    notes = (*strained, *_lines(holding, missing, _TITLES["mjcf"], _LISTED))
    return Exported("mjcf", text, missing.each, missing.together, holding.frozen, notes)


def _tabled(machine: Machine, format: Format) -> Exported:
    """A volumetric table; it holds effects of one axis by itself, between positions as straight lines."""
    table = table_of(machine)
    left = {label: size for label, size in table.each.items() if size > _KEPT}
    frozen = held_tools(machine) | {
        placed.label: {name: driver_default(machine, name) for name in placed.drivers}
        for placed in machine.effects
        if placed.drivers
    }
    write = iso230_text if format == "iso230" else isg_text
    title = _TITLES[format]
    text = write(machine.name, table, _table_lines(table, left, frozen, title, _ALL))
    notes = _table_lines(table, left, frozen, title, _LISTED)
    return Exported(format, text, left, table.lost[0], frozen, notes)


def _table_lines(
    table: Table, left: Mapping[str, float], frozen: Mapping[str, Mapping[str, float]], title: str, most: int
) -> tuple[str, ...]:
    sizes = sorted(left.items(), key=lambda item: -item[1])
    listed = _listed([f"{label} ({size:.3g} mm)" for label, size in sizes], most)
    out = [
        f"{title} leaves up to {table.lost[0]:.3g} mm and {table.lost[1] * 1e6:.3g} urad at the tool, of "
        f"{table.uncompensated[0]:.3g} mm and {table.uncompensated[1] * 1e6:.3g} urad ({CHECKED} places)"
        + (f"; it cannot wholly hold: {listed}" if left else "")
    ]
    return (*out, *_frozen_lines(frozen, title, most))


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
    return (*out, *_frozen_lines(holding.frozen, title, most))


def _frozen_lines(frozen: Mapping[str, Mapping[str, float]], title: str, most: int) -> list[str]:
    named = [
        f"{label} ({', '.join(f'{name} = {value:.12g}' for name, value in drivers.items())})"
        for label, drivers in frozen.items()
    ]
    return [f"{title} holds only at these values of their drivers: {_listed(named, most)}"] if named else []


def _listed(items: list[str], most: int) -> str:
    more = [f"and {len(items) - most} more"] if len(items) > most else []
    return ", ".join(items[:most] + more)
