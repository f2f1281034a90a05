"""Bundled demonstrations only: the known truth beside what was found. Nothing else reads it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.report import diagnosis_words as words
from truepose.identification.report.document import Block, Charts, Section, Table, Text
from truepose.identification.report.figures import truth as figures
from truepose.identification.report.formulas import coupling_matrix
from truepose.identification.report.numbers import measure, significant
from truepose.models.machine.mechanism import vector_of
from truepose.shown.chart import Tone
from truepose.wording import joined

DETERMINED = 0.5


def truth_section(diagnosis: Diagnosis, truth: Mapping[str, Any]) -> Section:
    """What the simulated machine really had, beside what was found."""
    blocks: list[Block] = [_verdict(diagnosis, truth)]
    blocks += _parameters(diagnosis, truth.get("parameters"))
    blocks += _matrix(diagnosis, truth)
    return Section("truth", "Truth against what was found", blocks)


def true_effects(truth: Mapping[str, Any]) -> list[tuple[str, tuple[str, ...]]]:
    """Effects and places of the truth, from ``effect`` or ``effects``."""
    stated = truth.get("effects") or ([truth["effect"]] if truth.get("effect") else [])
    return [
        (str(e.get("effect", "")), tuple(str(p) for p in e.get("place", ())))
        for e in stated
        if isinstance(e, Mapping)
    ]


def _verdict(diagnosis: Diagnosis, truth: Mapping[str, Any]) -> Text:
    real = true_effects(truth)
    found = {(f.effect, f.place) for f in diagnosis.findings}
    extra = [
        f"{slug} {words.place_words(place)}" for slug, place in sorted(found) if (slug, place) not in real
    ]
    lead = "This recording was simulated, so the truth is known (the diagnosis never saw it)."
    if not real:
        named = f"named all the same: {joined(extra)}" if extra else "none was named"
        return Text(
            f"{lead} No physics was left out of the machine file; {named}.", "warn" if extra else "good"
        )
    said = joined([f"{words.effect_title(slug)} {words.place_words(place)}".strip() for slug, place in real])
    missed = [slug for slug, place in real if (slug, place) not in found]
    outcome = "all of it was found" if not missed else f"not found under that name: {joined(missed)}"
    more = f"; found beyond it: {joined(extra)}" if extra else "; nothing else was named"
    return Text(
        f"{lead} Left out of the machine file: {said}; {outcome}{more}.",
        "good" if not missed and not extra else "warn",
    )


def _parameters(diagnosis: Diagnosis, stated: object) -> list[Block]:
    if not isinstance(stated, Mapping):
        return []
    machine = diagnosis.nominal
    rows = [k for k, p in enumerate(machine.parameters) if p.name in stated and 0 < p.tolerance < np.inf]
    if not rows:
        return []
    tolerance = np.array([machine.parameters[k].tolerance for k in rows])
    nominal = np.array([machine.parameters[k].nominal for k in rows])
    true = (
        np.array([float(stated[machine.parameters[k].name]["value"]) for k in rows]) - nominal
    ) / tolerance
    fits = _fits(diagnosis)
    reference = fits[-1][3]
    sure = reference.std[rows] / tolerance < DETERMINED
    blocks: list[Block] = [_errors(fits, rows, true, sure)]
    if sure.any():
        drawn = [
            (name, tone, fit.in_tolerances[rows][sure]) for _, name, tone, fit in fits if name != "free fit"
        ]
        caption = (
            f"The {int(sure.sum())} parameters that the readings determine to better than half a tolerance:"
            " on the line the estimate is the truth. Without the effect they bend away to imitate it; with"
            " it they should lie on the line."
        )
        blocks.append(Charts([figures.departures(true[sure], drawn)], caption))
    return blocks


def _fits(diagnosis: Diagnosis) -> list[tuple[str, str, Tone, Estimate]]:
    fits: list[tuple[str, str, Tone, Estimate]] = [
        ("free", "free fit", "free", diagnosis.free),
        ("before", "tolerances, no effects", "before", diagnosis.before),
    ]
    return [*fits, ("after", "with effects", "after", diagnosis.after)] if diagnosis.terms else fits


def _errors(
    fits: Sequence[tuple[str, str, Tone, Estimate]], rows: Sequence[int], true: Array, sure: Mask
) -> Table:
    lines = []
    for title, mask in (
        (f"well determined ({int(sure.sum())})", sure),
        (f"all ({len(sure)})", np.ones(len(sure), dtype=bool)),
    ):
        if mask.any():
            errors = [_rms((fit.in_tolerances[list(rows)] - true)[mask]) for *_, fit in fits]
            lines.append(
                [
                    f"rms error of parameters, {title}",
                    significant(_rms(true[mask])),
                    *(significant(e) for e in errors),
                ]
            )
    caption = (
        "Error of the estimated parameters against the truth, in tolerances. Well determined: posterior"
        " 1-sigma below half a tolerance in the last fit. The drawing's column is the error of not"
        " calibrating at all."
    )
    return Table(["", "drawing", *(name for _, name, _, _ in fits)], lines, caption)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _matrix(diagnosis: Diagnosis, truth: Mapping[str, Any]) -> list[Block]:
    """True leg-end displacements, and the matrix of the bending platform beside the estimated one."""
    stated, size = truth.get("K"), truth.get("leg_end_displacement_max")
    true = np.array(stated["value"], dtype=float) if isinstance(stated, Mapping) else np.zeros((0, 0))
    found = next(
        (
            m
            for f in diagnosis.findings
            if (m := coupling_matrix(diagnosis, f)) is not None and m[1].shape == true.shape
        ),
        None,
    )
    blocks: list[Block] = []
    if isinstance(size, Mapping):
        blocks.append(_displacements(diagnosis, size, None if found is None else found[1]))
    if found is not None:
        readings = diagnosis.nominal.mechanism.readings
        caption = (
            "How far each leg's end moves along the platform's normal as each actuator travels by one, in"
            " thousandths. Entries that tolerances of the legs can imitate are the least certain (amplitudes"
            " and their uncertainty stand with the finding)."
        )
        names = list(map(vector_of, found[0]))
        blocks.append(Charts(figures.matrices(true, found[1], names, readings), caption))
    return blocks


def _displacements(diagnosis: Diagnosis, size: Mapping[str, Any], matrix: Array | None) -> Table:
    unit = str(size.get("unit", "um"))
    millimetres = {"um": 1e-3, "mm": 1.0, "nm": 1e-6}.get(unit, 1.0)
    head, rows = (
        ["", "truth"],
        [
            [
                "largest displacement of a leg's end",
                measure(float(size.get("norm", np.nan)) * millimetres, "mm"),
            ]
        ],
    )
    xyz = size.get("xyz")
    if isinstance(xyz, Sequence) and len(xyz) == 3:
        rows += [
            [f"its largest along {axis}", measure(float(v) * millimetres, "mm")]
            for axis, v in zip("xyz", xyz, strict=True)
        ]
    if matrix is not None:
        head.append("as identified (along z)")
        largest = float(np.max(np.abs(diagnosis.recording.q @ matrix.T), initial=0.0))
        last = len(rows) - 1
        rows = [[*row, measure(largest, "mm") if k == last else ""] for k, row in enumerate(rows)]
    return Table(head, rows, "How much the physics that was left out moves the machine.")
