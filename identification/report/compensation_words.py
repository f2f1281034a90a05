"""What corrected commands change and reach, and what inverse kinematics reached: documents, and JSON."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from truepose.arrays import Array
from truepose.identification.compensation.compensate import Compensation
from truepose.identification.compensation.inverse import Inverse, Reach
from truepose.shown.document import Document, Table, Text
from truepose.shown.result import document, frame


def compensation_json(found: Compensation) -> dict[str, object]:
    """Rows, largest pose errors as the calibrated model predicts them, largest change of each command."""

    def largest(twists: Array) -> dict[str, object]:
        norms = [np.linalg.norm(twists[:, part], axis=1) for part in (slice(0, 3), slice(3, 6))]
        return {
            "position": {"value": float(np.max(norms[0])), "unit": "mm"},
            "rotation": {"value": float(np.max(norms[1])), "unit": "rad"},
        }

    change = np.max(np.abs(found.command - found.nominal), axis=0)
    partial = {} if found.task.is_whole else {"not_asked": largest(found.not_asked)}
    return {
        "rows": len(found.command),
        "task": list(found.task.components),
        "eased": int(np.sum(found.eased)),
        "largest_error": {"before": largest(found.before), "after": largest(found.after), **partial},
        "largest_correction": dict(zip(found.readings, change.tolist(), strict=True)),
    }


@document.register
def _(found: Compensation) -> Document:
    change = np.abs(found.command - found.nominal).max(axis=0, initial=0.0)
    rows = [[name, f"{value:.4g}"] for name, value in zip(found.readings, change, strict=True)]
    return Document(
        "Compensation",
        f"Compensation of {len(found.command)} rows",
        summary=[
            *([Text(error_sentence(found))] if len(found.command) else []),
            Table(["joint", "largest correction (mm, rad)"], rows),
        ],
        notes=found.notes,
        more="to_frame() has every row",
    )


def compensation_lines(found: Compensation, output: Path) -> list[str]:
    """What was written, and the largest pose error with and without it."""
    done = f"{output}: {len(found.command)} rows"
    return [done, f"  {error_sentence(found)}"]


def error_sentence(found: Compensation) -> str:
    """The largest pose error with the path's commands and with the corrected ones."""

    def words(twists: Array) -> str:
        position = np.max(np.linalg.norm(twists[:, :3], axis=1))
        rotation = np.degrees(np.max(np.linalg.norm(twists[:, 3:], axis=1)))
        return f"{position:.4g} mm, {rotation:.4g} deg"

    said = (
        f"largest pose error, as the calibrated model has it: {words(found.before)} with the path's commands, "
        f"{words(found.after)} with these"
    )
    if found.task.is_whole:
        return said
    said = f"{said}, counting {found.task.words}; of the rest of the pose {words(found.not_asked)} are left"
    eased = int(np.sum(found.eased))
    rows = f"{eased} row{'s' * (eased != 1)} next to a singular pose"
    return (
        f"{said}; of {rows}, where a joint would swing, the position is met and turns nearly"
        if eased
        else said
    )


@document.register
def _(found: Inverse) -> Document:
    ends = Counter(Reach(int(status)).name.lower().replace("_", " ") for status in found.status)
    told = ", ".join(f"{count} {name}" for name, count in ends.items()) or "none"
    left = [f"{np.max(v, initial=0.0):.4g}" for v in (found.position, found.rotation)]
    return Document(
        "Inverse kinematics",
        f"Inverse kinematics of {len(found.q)} poses: {told}",
        summary=[
            Text(f"left to the pose at most: {left[0]} mm, {left[1]} rad; joints in mm and rad"),
            Table.of(frame(found)),
        ],
        more="to_frame() has all poses",
    )
