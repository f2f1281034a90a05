"""What a result did to the error, and what improved.yaml and machine files hold and say of the tool's position."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from truepose.errors import InputError
from truepose.identification.diagnosis.result import WHOLE, Applied, Diagnosis
from truepose.identification.fit.summary import FitSummary, rms_by_kind
from truepose.identification.report.phrases import NONE, finer, known, measure, significant, unit_symbol
from truepose.models.file.sections import ExpectedPose
from truepose.models.machine.machine import Machine
from truepose.shown.document import Gain

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


HELD_OUT, FITTED = "on held-out rows", "on the fitted rows"
_BASELINES = {
    "free": "with the ordinary fit",
    "ordinary": "with the ordinary fit",
    "before": "held to the drawing",
    "drawing": "held to the drawing",
}


def diagnosis_gains(diagnosis: Diagnosis) -> list[Gain]:
    """Of a diagnosis: the better plain calibration and the model found, on held-out rows where there are any."""
    fits = {name: diagnosis.fits[name] for name in ("free", "before", "after")}
    held = all(fit.validation_rms is not None for fit in fits.values())
    rms = {name: (fit.validation_rms if held else fit.rms) or {} for name, fit in fits.items()}
    before = {name: rms[name] for name in ("free", "before")} if diagnosis.terms else {}
    return [*_applied_gain(diagnosis), *_reading_gains(diagnosis.nominal, before, rms["after"], held)]


def fit_gains(machine: Machine, summary: FitSummary, pose: ExpectedPose | None) -> list[Gain]:
    """Of a fit alone, after what it is worth to the tool, where that was judged."""
    held = summary.validation_rms is not None
    rms = (summary.validation_rms if held else summary.rms) or {}
    tool = [] if pose is None else [pose_gain({pose.than: pose.before}, pose.after, pose.rows)]
    return [*tool, *_reading_gains(machine, {}, rms, held)]


def _reading_gains(
    machine: Machine, before: Mapping[str, Mapping[str, float]], after: Mapping[str, float], held: bool
) -> list[Gain]:
    """Return the gain of each kind of reading: the rms of fits ``before``, by name, and ``after``."""
    floors, units, where = stated_noise(machine), machine.residual_units, HELD_OUT if held else FITTED
    return [
        _gain(f"{k} error, rms", {n: rms[k] for n, rms in before.items()}, v, units[k], where, floors[k])
        for k, v in after.items()
    ]


def stated_noise(machine: Machine) -> dict[str, float]:
    """What the stated sigmas make of each kind's norm, in its unit: root of the summed squares of a point."""
    return rms_by_kind(np.ones((1, len(machine.channels))), machine.channels)


def _applied_gain(diagnosis: Diagnosis) -> list[Gain]:
    applied = diagnosis.applied
    if applied is None or applied.pose is None or applied.model == "plain":
        return []
    before = {name: applied.baselines[name] for name in ("ordinary", "drawing") if name in applied.baselines}
    plain = {"plain calibration": applied.pose.plain}
    return [pose_gain(before or plain, applied.pose.model, rows_words(applied))]


def pose_gain(before: Mapping[str, float], after: float, rows: str) -> Gain:
    """The error of the tool's position by what was before and by the file."""
    return _gain("tool position error, rms", before, after, "mm", f"on {rows}, after a rigid refit", None)


def _gain(
    kind: str, before: Mapping[str, float], after: float, unit: str, where: str, floor: float | None
) -> Gain:
    """One kind; the smallest of ``before`` (by name) stands before, all of them in the note where there are several."""
    was = min((v for v in before.values() if known(v)), default=math.nan)
    sizes = [abs(v) for v in (was, after) if math.isfinite(v)]
    factor, name = sensor_unit(max([*sizes, *before.values()], default=0.0), unit)
    largest = max([*sizes, floor or 0.0]) or 1.0

    def told(value: float) -> str:
        return f"{significant(value * factor)} {unit_symbol(name)}".rstrip() if known(value) else NONE

    each = [f"{told(v)} {_BASELINES.get(k, f'with {k}')}" for k, v in before.items()]
    shares = tuple(v / largest if v is not None and math.isfinite(v) else 0.0 for v in (was, after, floor))
    alone = "" if floor is None else f"the instrument alone: {told(floor)}"
    first = told(was) if before else ""
    return Gain(kind, first, told(after), where, alone, shares, ", ".join(each))  # type: ignore[arg-type]


def sensor_unit(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which figures are told together: mm from 0.1 mm on."""
    if not math.isfinite(size) or not size or (unit == "mm" and size >= 0.1):
        return 1.0, unit
    return finer(size, unit)
