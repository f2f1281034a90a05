"""Section 4: residuals against what drives them, and functions that were identified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.report import diagnosis_words as words
from truepose.identification.report.curves import curves
from truepose.identification.report.document import Block, Plot, Section, Text
from truepose.identification.report.drivers import Column, columns, component_groups
from truepose.identification.report.figures import residuals, style
from truepose.models.driver import Driver
from truepose.models.machine import Machine

Array = NDArray[np.float64]
CANDIDATES = 15


def residual_section(diagnosis: Diagnosis) -> Section:
    """Residuals against drivers before and after, and identified functions."""
    fits = [("before (tolerances, no effects)", style.BEFORE, diagnosis.before)]
    if diagnosis.terms:
        fits.append(("after (with effects)", style.AFTER, diagnosis.after))
    blocks = residual_blocks(diagnosis.machine, diagnosis.recording, fits, _telling(diagnosis))
    for finding in diagnosis.findings:
        found = curves(diagnosis, finding)
        if found:
            caption = (
                f"What {words.named(finding)} adds, as identified, over the range that was measured. Ticks"
                " mark readings: between far-apart ticks the curve is the formula's word, not the data's."
            )
            blocks.append(Plot(residuals.curve_plot(found), caption))
    return Section("residuals", "Residuals against what drives them", blocks)


def residual_blocks(
    machine: Machine, recording: Recording, fits: Sequence[tuple[str, str, Estimate]], telling: Sequence[str]
) -> list[Block]:
    """Panels of row sizes against every driver; signed components against the most telling one."""
    if not len(recording) or not any(f.used.any() for _, _, f in fits):
        return [Text("No row was fitted.")]
    drawn = [(name, colour, f.residual, f.used | recording.validation) for name, colour, f in fits]
    drivers = columns(machine, recording, telling)
    thin = (
        f" Of {len(recording):,} rows {residuals.LARGEST:,} are drawn."
        if len(recording) > residuals.LARGEST
        else ""
    )
    caption = (
        "Size of each row's residual (rms of its components in sigma; about 1 is noise alone, dotted)"
        " against every joint, logged driver and the order of rows. A trend or a fan that vanishes"
        f" afterwards was the missing physics. Triangles lie off the scale.{thin}"
    )
    blocks: list[Block] = [Plot(residuals.size_panels(drivers, drawn), caption)]
    column = _first(drivers, telling)
    groups = component_groups(machine.channels)
    caption = (
        f"Signed residual components against {column.name}, the driver that matters most here: any slope,"
        " wave or step is a systematic error that noise would not make. Before and after stand side by side"
        " where readings repeat."
    )
    blocks.append(Plot(residuals.component_panels(column, groups, drawn), caption))
    return blocks


def _telling(diagnosis: Diagnosis) -> list[str]:
    """Drivers by how much they matter: of findings, of the remainder, of the structure test."""
    limbs = {limb.name: limb.reading for limb in diagnosis.machine.mechanism.limbs}
    out = [
        name
        for f in diagnosis.findings
        for name in (*_drivers_of(diagnosis, f), *(limbs.get(p, p) for p in reversed(f.place)))
    ]
    if diagnosis.remainder is not None:
        out.append(diagnosis.remainder.driver)
    return [
        *out,
        diagnosis.alarms["structure"].about if "structure" in diagnosis.alarms else "",
        diagnosis.structure.driver,
    ]


def _drivers_of(diagnosis: Diagnosis, finding: Finding) -> list[str]:
    terms = [t for t in diagnosis.terms if t.effect.slug == finding.effect and t.place == finding.place]
    return [Driver.of(name).now.name for t in terms for name in t.drivers]


def _first(drivers: Sequence[Column], telling: Sequence[str]) -> Column:
    known = {c.name: c for c in drivers}
    return next((known[name] for name in telling if name in known), drivers[0])
