"""What improved.yaml holds, and what it is worth to the tool, in plain sentences."""

from __future__ import annotations

from truepose.identification.diagnosis.result import WHOLE, Applied, PoseError
from truepose.identification.report.numbers import known, measure, significant

_HOLDS = {
    WHOLE: "all that was found",
    "without-sensor-forms": "all that was found but what the sensor is said to do without a name",
    "names": "effects with a name alone",
    "sure-names": "effects whose law is sure alone",
    "plain": "plain calibration",
}
_ROWS = {"role": "the validation rows", "blocks": "rows held out in turn", "none": "the fitted rows"}


def applied_words(applied: Applied | None) -> list[str]:
    """How far the tool is from where plain calibration and improved.yaml have it, and what was left out for its sake."""
    if applied is None:
        return []
    where = f"on {_ROWS.get(applied.held_out, applied.held_out)}, after a rigid refit"
    out = []
    if applied.pose is None:
        out.append("Whether the tool's pose gains is not judged: no sensor reads its position.")
    elif applied.model != "plain":
        out.append(f"The tool's position, {where}: {_pose(applied.pose)} with improved.yaml.")
    if applied.model != WHOLE and (applied.whole_pose or known(applied.whole_ratio)):
        out += _left_out(applied, where)
    return out


def _left_out(applied: Applied, where: str) -> list[str]:
    if applied.whole_pose == applied.pose and applied.whole_ratio == applied.ratio:
        return []  # nothing else was found
    held = f"improved.yaml holds {_HOLDS[applied.model]}"
    if applied.whole_pose is not None and applied.whole_pose.model > applied.whole_pose.plain:
        return [
            f"With all that was found the tool would be worse ({where}: {_pose(applied.whole_pose)}): {held}."
        ]
    if applied.whole_ratio > 1.0:
        return [
            f"With all that was found, readings that were not fitted get worse (rms {significant(applied.whole_ratio)}"
            f" of plain calibration's): {held}."
        ]
    return [f"All that was found moves constants out of their tolerances: {held}."]


def _pose(error: PoseError) -> str:
    return f"{measure(error.plain, 'mm')} with plain calibration, {measure(error.model, 'mm')}"


__all__ = ["applied_words"]
