"""What was corrected in a robot program, what was not, and how large it is: lines for a terminal, notes, and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
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
    """Say what was written, the sizes of corrections and errors, and each line where a target is not corrected."""
    count, left = len(found.done), len(found.left)
    out = [f"{output}: {count} target{'s' * (count != 1)} corrected, {title}"]
    if found.done:
        change, before, after = _sizes(found)
        out += [
            f"  correction: median {_size(np.median(change, axis=0))}, largest {_size(change.max(axis=0))}",
            f"  largest pose error, as the calibrated model has it: {_size(before.max(axis=0))} with the program as it was, "
            f"{_size(after.max(axis=0))} with this one, rounding of its numbers included",
        ]
    if left:
        places = "1 place is" if left == 1 else f"{left} places are"
        out.append(f"  {places} not corrected, or not wholly:")
        out += [f"    {source}:{one.line}: {one.what}: {one.why}" for one in found.left]
    return out


def correction_notes(found: Correction, machine: Machine, limit: Limit) -> list[str]:
    """Say what was taken for granted, and what a person should look at."""
    beyond = f"corrections of more than {limit.position:g} mm or {limit.rotation:g} deg: "
    bare, toolless = found.unnamed
    at = ", ".join(f"{name} = {value:g}" for name, value in found.drivers.items())
    turned = _listed([one for one in found.done if one.reconfigured])
    copied = _listed([one for one in found.done if one.target.copies is not None])
    why = "what they name is a frame as well, goes by several frames or is worked out"
    notes = {
        beyond: _listed(_beyond(found, limit)),
        "axes pass a border, so that numbers of the configuration changed with them: ": turned,
        f"motions that got a pose of their own, because {why}: ": copied,
        "poses that name no base stand in the robot's own (--base tells another): ": bare,
        "poses that name no tool are the machine file's tool's (--tool tells another): ": toolless,
        "taken for the machine file's tool (--frame NAME=... gives another): ": ", ".join(found.assumed),
        "at all targets (--at NAME=VALUE gives others): ": at,
    }
    out = [*found.notes, *(f"{head}{what}" for head, what in notes.items() if what)]
    if not (machine.file and machine.file.nominal):
        out.append("the machine file has no `nominal:`; its own constants are taken for the controller's")
    return out


def correction_json(found: Correction, limit: Limit) -> dict[str, object]:
    """Return the same as data; every target that was left has its line."""
    sizes: dict[str, object] = {}
    if found.done:
        change, before, after = _sizes(found)
        sizes = {
            "correction": {"median": _json(np.median(change, axis=0)), "largest": _json(change.max(axis=0))},
            "largest_error": {"before": _json(before.max(axis=0)), "after": _json(after.max(axis=0))},
        }
    return {
        "targets": len(found.done),
        **sizes,
        "left": [asdict(one) for one in found.left],
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


def _sizes(found: Correction) -> list[Array]:
    """Return the sizes (n, 2), mm and rad, of changes, and of errors before and after."""
    twists = ([one.change, one.before, one.after] for one in found.done)
    return list(np.array([[_norm(twist) for twist in three] for three in twists]).swapaxes(0, 1))


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


def _listed(done: Sequence[Corrected]) -> str:
    """Name the first of some targets."""
    items = [
        f"line {one.target.line} ({one.target.name}, {_size(_norm(one.change))})" for one in done[:_LISTED]
    ]
    return ", ".join([*items, *([f"and {len(done) - _LISTED} more"] if len(done) > _LISTED else [])])
