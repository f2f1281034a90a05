"""What was corrected in a robot program, what was not, and how large it is: lines for a terminal, notes, and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.programs.correct import Corrected, Correction
from truepose.models.machine.machine import Machine

_LISTED = 5
"""Lines that a note names; ``--json`` names all."""


@dataclass(frozen=True)
class Limit:
    """Corrections that are larger than this are pointed out: mm and deg."""

    position: float = 5.0
    rotation: float = 1.0


def correction_lines(found: Correction, title: str, source: Path, output: Path) -> list[str]:
    """What was written, the sizes of corrections and errors, and each line where a target is not corrected."""
    count, whole = len(found.done), len(found.done) + len(found.left)
    out = [f"{output}: {count} target{'s' * (count != 1)} corrected, {title}"]
    if found.done:
        change, before, after = (_norms(found.done, name) for name in ("change", "before", "after"))
        out.append(
            f"  correction: median {_size(np.median(change, axis=0))}, largest {_size(change.max(axis=0))}"
        )
        out.append(
            f"  largest pose error, as the calibrated model has it: {_size(before.max(axis=0))} with the program as it was, "
            f"{_size(after.max(axis=0))} with this one, rounding of its numbers included"
        )
    if whole > count:
        places = "1 place is" if whole - count == 1 else f"{whole - count} places are"
        out.append(f"  {places} not corrected, or not wholly:")
        out += [f"    {source}:{left.line}: {left.what}: {left.why}" for left in found.left]
    return out


def correction_notes(found: Correction, machine: Machine, limit: Limit) -> list[str]:
    """What was taken for granted, and what a person should look at."""
    out = []
    beyond = _beyond(found, limit)
    if beyond:
        named = [f"line {one.target.line} ({one.target.name}, {_size(_norm(one.change))})" for one in beyond]
        out.append(
            f"corrections of more than {limit.position:g} mm or {limit.rotation:g} deg: {_listed(named)}"
        )
    turned = [f"line {one.target.line} ({one.target.name})" for one in found.done if one.reconfigured]
    if turned:
        out.append(
            f"axes pass a border, so that numbers of the configuration changed with them: {_listed(turned)}"
        )
    copied = [
        f"line {one.target.line} ({one.target.name})" for one in found.done if one.target.copies is not None
    ]
    if copied:
        out.append(
            "motions that got a pose of their own, because what they name is a frame as well, goes by several frames or is "
            f"worked out: {_listed(copied)}"
        )
    out += _taken_for_granted(found)
    if not (machine.file and machine.file.nominal):
        out.append("the machine file has no `nominal:`; its own constants are taken for the controller's")
    return out


def _taken_for_granted(found: Correction) -> list[str]:
    """What neither the program nor an option tells: frames, drivers, from where."""
    out = []
    bare, toolless = found.unnamed
    if bare:
        out.append(f"poses that name no base ({bare}) stand in the robot's own; --base tells another")
    if toolless:
        out.append(
            f"poses that name no tool ({toolless}) are the machine file's tool's; --tool tells another"
        )
    if found.assumed:
        out.append(
            f"taken for the machine file's tool: {', '.join(found.assumed)}; --frame NAME=... gives another"
        )
    if found.drivers:
        told = ", ".join(f"{name} = {value:g}" for name, value in found.drivers.items())
        out.append(f"at all targets: {told}; --at NAME=VALUE gives others")
    return out


def correction_json(found: Correction, limit: Limit) -> dict[str, object]:
    """The same as data; every target that was left has its line."""
    sizes: dict[str, object] = {}
    if found.done:
        change, before, after = (_norms(found.done, name) for name in ("change", "before", "after"))
        sizes = {
            "correction": {"median": _json(np.median(change, axis=0)), "largest": _json(change.max(axis=0))},
            "largest_error": {"before": _json(before.max(axis=0)), "after": _json(after.max(axis=0))},
        }
    return {
        "targets": len(found.done),
        **sizes,
        "left": [{"line": one.line, "what": one.what, "why": one.why} for one in found.left],
        "beyond_limit": [
            {"line": one.target.line, "target": one.target.name, **_json(_norm(one.change))}
            for one in _beyond(found, limit)
        ],
        "reconfigured": [one.target.line for one in found.done if one.reconfigured],
        "copied": [one.target.line for one in found.done if one.target.copies is not None],
        "assumed_tools": list(found.assumed),
        "without_base": found.unnamed[0],
        "without_tool": found.unnamed[1],
        "drivers": dict(found.drivers),
    }


def _norm(twist: Array) -> Array:
    return np.array([np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])])


def _norms(done: Sequence[Corrected], name: str) -> Array:
    """(n, 2) sizes of twists, mm and rad."""
    return np.array([_norm(getattr(one, name)) for one in done])


def _beyond(found: Correction, limit: Limit) -> list[Corrected]:
    most = np.array([limit.position, np.radians(limit.rotation)])
    return [one for one in found.done if (_norm(one.change) > most).any()]


def _size(norm: Array) -> str:
    return f"{norm[0]:.3g} mm, {np.degrees(norm[1]):.3g} deg"


def _json(norm: Array) -> dict[str, object]:
    return {
        "position": {"value": float(norm[0]), "unit": "mm"},
        "rotation": {"value": float(norm[1]), "unit": "rad"},
    }


def _listed(items: list[str]) -> str:
    more = [f"and {len(items) - _LISTED} more"] if len(items) > _LISTED else []
    return ", ".join([*items[:_LISTED], *more])
