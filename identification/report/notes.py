"""Remarks beside results: rows left out, what a plan does not vary, noise and tolerances that look misstated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from truepose.identification.diagnosis.null_fits import outlying_rows
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.repeatability import revisits
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.identifiability.observability import Note
from truepose.identification.recording.load import tried
from truepose.identification.recording.recording import Recording
from truepose.identification.report.phrases import measure
from truepose.wording import joined

_SAID = {
    "unassembled": "{}: the mechanism cannot be assembled there; the row was left out",
    "crossing": "{}: counts from a row of another session; its reading was left out",
    "validation": "{}: every row is for validation; it was left out",
    "own class": "{} has a class of its own: plan for it apart",
    "nameless": "{} may also stand in for something without a name, which no plan can foresee",
    "payload": "the machine file has no mass called payload: it is taken to hang at the tool frame's origin; state "
    "`payload: {{kg: 0, com: [0, 0, 0], in: tool}}` under masses before the diagnosis of what was measured",
    "strokes": "{}: every move counts as a long one; strokes that shrink are not planned",
    "creep": "{}: the time since the last move is not planned",
    "motions": "{}: the motion that leads to a row is not planned",
    "unread": "{!r} is offered but no explanation reads it: it is not varied",
}


def worded(notes: Iterable[Note | str]) -> list[str]:
    """Notes in words; those of a recording are in words already."""
    return [note if isinstance(note, str) else _SAID[note.kind].format(note.about) for note in notes]


def diagnosis_notes(found: Diagnosis) -> tuple[str, ...]:
    """What a reader should know besides: rows left out, noise and tolerances that look misstated."""
    recording = found.recording
    said = [
        f"row {recording.source_row[k]} of {recording.files[recording.source_file[k]]} cannot be assembled and was left out"
        for k in found.before.unassembled
    ]
    if found.stopped:
        said.append("the search was stopped: what it had found by then is named, and chains are short")
    if not 0.8 < found.noise < 1.25:
        said.append(f"without effects the readings scatter {found.noise:.2g} times the stated sigma")
    return (
        *recording.notes,
        *found.prior_notes,
        *driver_notes(found),
        *said,
        *tolerance_notes(found.inflation),
        *held_out_notes(found.after, recording),
        *repeat_notes(found.after, recording),
    )


def held_out_notes(fit: Estimate, recording: Recording) -> list[str]:
    """What a model leaves of the rows held out without those that no model explains: a fit leaves such rows out."""
    wild = outlying_rows(fit, recording, recording.validation)
    others = recording.validation & ~wild & np.isfinite(fit.residual).all(axis=1)
    if not wild.any():
        return []
    left = rms_by_kind(fit.residual[others], fit.nominal.channels, fit.lost_among(others))
    units = fit.nominal.residual_units
    said = joined(f"{measure(value, units[kind])} ({kind})" for kind, value in left.items())
    return [
        f"as far off as rows that a fit leaves out: {int(wild.sum())} of the {int(recording.validation.sum())} rows held out;"
        f" the others are off by {said}"
    ]


def repeat_notes(fit: Estimate, recording: Recording) -> list[str]:
    """How far readings repeat where the arm came back, beside what the model leaves there."""
    seen = revisits(fit, recording)
    if seen is None:
        return []
    units = fit.nominal.residual_units

    def told(values: Mapping[str, float]) -> str:
        return joined(f"{measure(value, units[kind])} ({kind})" for kind, value in values.items())

    within = {"turn": "rad", "slide": "mm"}
    apart = joined(measure(value, within[name]) for name, value in seen.apart.items())
    return [
        f"where the machine came back to the same joints ({seen.pairs} pairs of rows, within {apart}), a row repeats to"
        f" {told(seen.scatter)}, and no model of joints and loads leaves less; this one leaves {told(seen.left)}"
    ]


def driver_notes(found: Diagnosis) -> list[str]:
    """Which columns were tried as drivers, and which could be."""
    names, untried = tried(found.nominal), found.recording.untried
    said = []
    if names:
        price = f": each has 1/{len(names)} of the prior of a driver" if len(names) > 1 else ""
        said.append(f"tried as drivers: {joined(list(names))}{price}")
    if untried:
        said.append(f"no driver: {joined(list(untried))}; --try-columns tries them, `drivers:` declares them")
    return said


def tolerance_notes(inflation: Mapping[PartClass, float]) -> list[str]:
    """Which tolerances look too small; one line where all do alike."""
    values = list(inflation.values())
    if len(values) > 1 and min(values) > 1.5 and max(values) < 1.2 * min(values):
        return [f"without effects, all tolerances look {max(values):.1f} times too small"]
    return [
        f"without effects, {_class_words(one)} tolerances look {value:.1f} times too small"
        for one, value in inflation.items()
        if value > 1.5
    ]


def _class_words(one: PartClass) -> str:
    return f"{one.kind} ({one.parts})" if one.parts else one.kind
