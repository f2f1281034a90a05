"""What a result did to the error, by kind of reading and of the tool's position: before and after in the sensor's unit."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.summary import FitSummary, rms_by_kind
from truepose.identification.report.applied_words import rows_words
from truepose.identification.report.numbers import NONE, finer, known, significant, unit_symbol
from truepose.models.file.sections import ExpectedPose
from truepose.models.machine.machine import Machine
from truepose.shown.document import Gain

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
    floors, units = stated_noise(diagnosis.nominal), diagnosis.nominal.residual_units
    return [
        *_applied_gain(diagnosis),
        *(
            _gain(
                f"{kind} error, rms",
                {name: rms[name][kind] for name in ("free", "before")} if diagnosis.terms else {},
                after,
                units[kind],
                HELD_OUT if held else FITTED,
                floors[kind],
            )
            for kind, after in rms["after"].items()
        ),
    ]


def fit_gains(machine: Machine, summary: FitSummary, pose: ExpectedPose | None) -> list[Gain]:
    """Of a fit alone, after what it is worth to the tool, where that was judged."""
    held = summary.validation_rms is not None
    rms = (summary.validation_rms if held else summary.rms) or {}
    floors, units = stated_noise(machine), machine.residual_units
    where = HELD_OUT if held else FITTED
    tool = [] if pose is None else [pose_gain({pose.than: pose.before}, pose.after, pose.rows)]
    return [*tool, *(_gain(f"{k} error, rms", {}, v, units[k], where, floors[k]) for k, v in rms.items())]


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
