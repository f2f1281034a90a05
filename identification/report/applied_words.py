"""What improved.yaml holds, and what it is worth to the tool, in plain sentences."""

from __future__ import annotations

from truepose.errors import InputError
from truepose.identification.diagnosis.result import WHOLE, Applied, PoseError
from truepose.identification.report.numbers import known, measure, significant
from truepose.models.file.machine_file import ExpectedPose
from truepose.models.machine.machine import Machine

_HOLDS = {
    WHOLE: "all that was found",
    "robot": "all that was found of the robot, and nothing that its sensor may or may not do",
    "names": "effects with a name alone",
    "forms": "forms without a name alone",
    "sure-names": "effects whose place and driver are sure alone",
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
        out.append(
            "Whether the tool's pose gains is not judged: no sensor reads its position, or not in enough rows."
        )
    elif applied.model != "plain":
        model = measure(applied.pose.model, "mm")
        out.append(
            f"Error of the tool's position, {where}: {_baselines(applied)}, {model} with improved.yaml."
        )
    if applied.model != WHOLE and (applied.whole_pose or known(applied.whole_ratio)):
        out += _left_out(applied, where)
    return out


def rows_words(applied: Applied) -> str:
    """On which rows the tool was judged."""
    return _ROWS.get(applied.held_out, applied.held_out)


def expected_pose(applied: Applied | None) -> ExpectedPose | None:
    """What improved.yaml says of itself; None where the tool's position was not judged."""
    if applied is None or applied.pose is None:
        return None
    rows = _ROWS.get(applied.held_out, applied.held_out)
    before = applied.baselines.get("drawing", applied.pose.plain)
    return ExpectedPose("plain calibration", before, applied.pose.model, rows)


def expected_words(machine: Machine) -> str:
    """What a machine file says of the tool's position before it is applied; raises nothing."""
    if machine.file is None or not machine.file.nominal:
        return "expected error of the tool's position: not known, the file was not calibrated"
    told = machine.file.pose_error
    if told is None:
        return "expected error of the tool's position: not judged, no sensor read it in enough rows"
    return (
        f"expected error of the tool's position ({told.rows}, after a rigid refit): {measure(told.before, 'mm')} with"
        f" {told.than}, {measure(told.after, 'mm')} with this file"
    )


def pose_json(machine: Machine) -> dict[str, object] | None:
    """The same as data; None where the file does not say it."""
    told = machine.file.pose_error if machine.file else None
    if told is None:
        return None
    return {"than": told.than, "before": told.before, "after": told.after, "unit": "mm", "rows": told.rows}


def check_applicable(machine: Machine) -> None:
    """Raises InputError for a file that is no calibration, or would leave the tool worse than plain calibration."""
    if machine.file is not None and machine.file.refused:
        raise InputError(
            f"{machine.file.path}: NOT CALIBRATED: {'; '.join(machine.file.refused)}; find the mistake with truepose"
            " check; --anyway applies the file all the same"
        )
    told = machine.file.pose_error if machine.file else None
    if told is not None and told.worse:
        raise InputError(
            f"{machine.name}: pose_error: found {told.after:.4g} mm with this file, expected no more than the"
            f" {told.before:.4g} mm with {told.than}; --anyway applies it all the same"
        )


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
    whole, pose = applied.whole_pose, applied.pose
    if applied.model != "plain" and whole is not None and pose is not None and whole.model > pose.model:
        return [f"Held out, that is {measure(whole.model, 'mm')} with all that was found: {held}."]
    return [
        f"With all that was found geometry leaves its tolerances, or predicts held-out rows less well: {held}."
    ]


def _baselines(applied: Applied) -> str:
    """Return the error with the ordinary fit and with the one held to the drawing, where both were tried."""
    if applied.pose is not None and not applied.baselines:
        return f"{measure(applied.pose.plain, 'mm')} with plain calibration"
    ordinary, drawing = (measure(applied.baselines[name], "mm") for name in ("ordinary", "drawing"))
    return f"{ordinary} with the ordinary fit, {drawing} held to the drawing"


def _pose(error: PoseError) -> str:
    return f"{measure(error.plain, 'mm')} with plain calibration, {measure(error.model, 'mm')}"
