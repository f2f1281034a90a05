"""What improved.yaml holds, and what a machine file says of the tool's position, in plain sentences."""

from __future__ import annotations

from truepose.errors import InputError
from truepose.identification.diagnosis.result import WHOLE, Applied
from truepose.identification.report.numbers import known, measure
from truepose.models.file.sections import ExpectedPose
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
    """Whether the tool's position was judged, and what improved.yaml leaves out for its sake, with the reason."""
    if applied is None:
        return []
    out = []
    if applied.pose is None:
        out.append(
            "Whether the tool's pose gains is not judged: no sensor reads its position, or not in enough rows."
        )
    whole, pose = applied.whole_pose, applied.pose
    nothing_else = whole == pose and applied.whole_ratio == applied.ratio
    if applied.model == WHOLE or nothing_else or not (whole or known(applied.whole_ratio)):
        return out
    if whole is not None and whole.model > whole.plain:
        worse = f"the tool would be worse: {measure(whole.model, 'mm')}, {measure(whole.plain, 'mm')} with plain calibration"
    else:
        worse = "held-out readings or the tool get worse, or geometry leaves its tolerances"
    return [*out, f"improved.yaml holds {_HOLDS[applied.model]}. With all that was found {worse}."]


def rows_words(applied: Applied) -> str:
    """On which rows the tool was judged."""
    return _ROWS.get(applied.held_out, applied.held_out)


def expected_pose(applied: Applied | None) -> ExpectedPose | None:
    """What improved.yaml says of itself; None where the tool's position was not judged."""
    if applied is None or applied.pose is None:
        return None
    before = applied.baselines.get("drawing", applied.pose.plain)
    return ExpectedPose(
        than="plain calibration", before=before, after=applied.pose.model, rows=rows_words(applied)
    )


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
