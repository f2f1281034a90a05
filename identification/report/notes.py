"""Remarks beside a diagnosis: rows left out, noise and tolerances that look misstated."""

from __future__ import annotations

from collections.abc import Mapping

from truepose.identification.diagnosis.result import Diagnosis


def diagnosis_notes(found: Diagnosis) -> tuple[str, ...]:
    """What a reader should know besides: rows left out, noise and tolerances that look misstated."""
    recording = found.recording
    said = [
        f"row {recording.source_row[k]} of {recording.files[recording.source_file[k]]} cannot be assembled and was left out"
        for k in found.before.unassembled
    ]
    if not 0.8 < found.noise < 1.25:
        said.append(f"without effects the readings scatter {found.noise:.2g} times the stated sigma")
    return (*recording.notes, *said, *_tolerance_notes(found.inflation))


def _tolerance_notes(inflation: Mapping[str, float]) -> list[str]:
    """Which tolerances look too small; one line where all do alike."""
    values = list(inflation.values())
    if len(values) > 1 and min(values) > 1.5 and max(values) < 1.2 * min(values):
        return [f"without effects, all tolerances look {max(values):.1f} times too small"]
    return [
        f"without effects, {_class_words(label)} tolerances look {value:.1f} times too small"
        for label, value in inflation.items()
        if value > 1.5
    ]


def _class_words(label: str) -> str:
    """``length:leg.a``: the length (leg.a)."""
    kind, _, group = label.partition(":")
    return f"{kind} ({group})" if group else kind
