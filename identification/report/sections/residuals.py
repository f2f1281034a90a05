"""Residuals against what drives them, and how they are distributed."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.arrays import Index
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.recording.recording import Recording
from truepose.identification.report.document import Block, Charts, Fold, Section, Text
from truepose.identification.report.drivers import Column, columns, component_groups
from truepose.identification.report.figures import residuals
from truepose.identification.report.figures.residuals import Drawn
from truepose.models.file.driver import Driver
from truepose.models.machine.machine import Machine


def residual_section(diagnosis: Diagnosis, rows: Index) -> Section:
    """Signed residuals against drivers before and after, their sizes, and their distribution."""
    fits = diagnosis_fits(diagnosis)
    telling = _telling(diagnosis)
    blocks = residual_blocks(diagnosis.nominal, diagnosis.recording, fits, telling, rows)
    return Section("residuals", "Residuals", blocks)


def diagnosis_fits(diagnosis: Diagnosis) -> list[Drawn]:
    """The fit before, and the one after where an effect was added."""
    validation, before, after = diagnosis.recording.validation, diagnosis.before, diagnosis.after
    fits = [Drawn("before", "before", before.residual, before.used | validation)]
    if diagnosis.terms:
        fits.append(Drawn("after", "after", after.residual, after.used | validation))
    return fits


def residual_blocks(
    machine: Machine, recording: Recording, fits: Sequence[Drawn], telling: Sequence[str], rows: Index
) -> list[Block]:
    """Signed components against the most telling driver, then every other; sizes; histogram and normal plot."""
    if not len(recording) or not any(f.counts.any() for f in fits):
        return [Text("No row was fitted.")]
    drivers = columns(machine, recording, telling)
    first = _first(drivers, telling)
    groups = component_groups(machine.channels)
    thin = f" Of {len(recording):,} rows {len(rows):,} are drawn." if len(rows) < len(recording) else ""
    caption = (
        f"Signed residuals, in stated sigmas, against {first.name}, the driver that matters most here. A slope, a wave or a"
        f" step is a systematic error that noise would not make.{thin} Click a point: it is ringed in every chart."
    )
    blocks: list[Block] = [Charts(residuals.component_panels(first, groups, fits, rows), caption)]
    others = [column for column in drivers if column is not first]
    panels = [chart for c in others for chart in residuals.component_panels(c, groups, fits, rows)]
    if panels:
        also = "The same against every other joint, every logged driver and the order of rows."
        blocks.append(Fold("Signed residuals against every other driver", [Charts(panels, also)]))
    size = (
        "Size of each row's residual: the rms of its components, in stated sigmas. About 1 (dashed) is noise alone. A trend or"
        " a fan that is gone afterwards was the missing physics."
    )
    blocks.append(Fold("Sizes of residuals", [Charts(residuals.size_panels(drivers, fits, rows), size)]))
    shape = (
        "How residuals are distributed, beside the normal curve of the stated sigma. Wider bars mean more noise than stated;"
        " bent ends of the normal plot are outliers."
    )
    return [*blocks, Charts(residuals.distribution(fits), shape)]


def series_of(machine: Machine, recording: Recording, fits: int) -> int:
    """In how many series each row is drawn."""
    drivers = columns(machine, recording)
    channels = sum(map(len, component_groups(machine.channels).values()))
    return fits * len(drivers) * (channels + 1)


def _telling(diagnosis: Diagnosis) -> list[str]:
    """Drivers by how much they matter: of findings, of the remainder, of the structure test."""
    limbs = {limb.name: limb.reading for limb in diagnosis.nominal.mechanism.limbs}
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
        diagnosis.structure.about,
    ]


def _drivers_of(diagnosis: Diagnosis, finding: Finding) -> list[str]:
    terms = [t for t in diagnosis.terms if t.effect.slug == finding.effect and t.place == finding.place]
    return [Driver.of(name).now.name for t in terms for name in t.drivers]


def _first(drivers: Sequence[Column], telling: Sequence[str]) -> Column:
    known = {c.name: c for c in drivers}
    return next((known[name] for name in telling if name in known), drivers[0])
