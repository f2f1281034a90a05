"""Residuals against what drives them, and how they are distributed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from truepose.arrays import Array, Index, Mask
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.report.drivers import Column, columns, component_groups, order_column
from truepose.models.file.driver import Driver
from truepose.models.machine.machine import Machine
from truepose.shown.chart import Axis, Chart, Layer, Level, Line, Marks, Shape, Tone
from truepose.shown.document import Block, Charts, Fold, Section, Text

MOVES = 30_000
"""Most points of all panels together: a page stays below a megabyte."""
FEWEST = 150
"""Rows that are drawn in any case, where there are as many."""
QUANTILES = 300
_SHAPES: dict[Tone, Shape] = {"before": "stroke", "after": "dot"}


@dataclass(frozen=True)
class Drawn:
    """A fit as residuals: its name, tone, residual (n, m) whitened, and rows (n,) that set the scale."""

    name: str
    tone: Tone
    residual: Array
    counts: Mask

    @classmethod
    def of(cls, fit: Estimate, recording: Recording, name: str, tone: Tone) -> Drawn:
        """Of a fit, whose fitted rows and rows held out set the scale."""
        return cls(name, tone, fit.residual, fit.used | recording.validation)


def diagnosis_fits(diagnosis: Diagnosis) -> list[Drawn]:
    """The fit before, and the one after where an effect was added."""
    fits = [Drawn.of(diagnosis.before, diagnosis.recording, "before", "before")]
    return (
        [*fits, Drawn.of(diagnosis.after, diagnosis.recording, "after", "after")] if diagnosis.terms else fits
    )


def picked(machine: Machine, recording: Recording, fits: int) -> Index:
    """Rows that are drawn, evenly spread, where each is drawn in every chart of so many fits."""
    channels = sum(map(len, component_groups(machine.channels).values()))
    rows, most = (
        len(recording),
        max(FEWEST, MOVES // max(fits * len(columns(machine, recording)) * channels, 1)),
    )
    return np.arange(rows) if rows <= most else np.unique(np.linspace(0, rows - 1, most).astype(np.intp))


def residual_section(
    machine: Machine, recording: Recording, fits: Sequence[Drawn], telling: Sequence[str], rows: Index
) -> Section:
    """Signed components against the most telling driver, then every other; sizes over time; the normal plot."""
    if not len(recording) or not any(f.counts.any() for f in fits):
        return Section("residuals", "Residuals", [Text("No row was fitted.")])
    drivers = columns(machine, recording, telling)
    known = {c.name: c for c in drivers}
    first = next((known[name] for name in telling if name in known), drivers[0])
    groups = component_groups(machine.channels)
    thin = f" Of {len(recording):,} rows {len(rows):,} are drawn." if len(rows) < len(recording) else ""
    caption = (
        f"Signed residuals, in stated sigmas, against {first.name}, the driver that matters most here. A slope, a wave or a"
        f" step is a systematic error that noise would not make.{thin} Click a point: it is ringed in every chart."
    )
    blocks: list[Block] = [Charts(component_panels(first, groups, fits, rows), caption)]
    panels = [c for one in drivers if one is not first for c in component_panels(one, groups, fits, rows)]
    if panels:
        also = "The same against every other joint, every logged driver and the order of rows."
        blocks.append(Fold("Signed residuals against every other driver", [Charts(panels, also)]))
    shape = (
        "Left: size of each row's residual; 1 (dashed) is noise as stated. Right: on the dashed line residuals are normal with"
        " the stated sigma; steeper is noisier, bent ends are outliers."
    )
    return Section(
        "residuals",
        "Residuals",
        [*blocks, Charts([size_chart(recording, fits, rows), normal_plot(fits)], shape)],
    )


def telling_drivers(diagnosis: Diagnosis) -> list[str]:
    """Drivers by how much they matter: of findings, of the remainder, of the structure test."""
    limbs = {limb.name: limb.reading for limb in diagnosis.nominal.mechanism.limbs}
    out: list[str] = []
    for f in diagnosis.findings:
        terms = [t for t in diagnosis.terms if t.effect.slug == f.effect and t.place == f.place]
        out += [Driver.of(name).now.name for t in terms for name in t.drivers]
        out += [limbs.get(p, p) for p in reversed(f.place)]
    if diagnosis.remainder is not None:
        out.append(diagnosis.remainder.driver)
    before = diagnosis.alarms["structure"].about if "structure" in diagnosis.alarms else ""
    return [*out, before, diagnosis.structure.about]


def row_sizes(residual: Array) -> Array:
    """(n,) rms of each row's whitened components; NaN where a row has none."""
    finite = np.isfinite(residual) & (residual != 0.0)  # a row that refers to itself reads nothing
    total = np.sum(np.where(finite, residual, 0.0) ** 2, axis=1)
    count = finite.sum(axis=1)
    return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


def size_chart(recording: Recording, fits: Sequence[Drawn], rows: Index) -> Chart:
    """The rms of each row's residual in sigma, in the order of rows; rows off the scale stand at its top edge."""
    sizes = [row_sizes(fit.residual) for fit in fits]
    counted = [s[fit.counts & np.isfinite(s)] for s, fit in zip(sizes, fits, strict=True)]
    top = 1.08 * max(float(np.max(s, initial=1.0)) for s in counted)
    column = order_column(recording)
    layers: list[Layer] = [
        Marks(column.values[rows], size[rows], fit.tone, fit.name, _SHAPES[fit.tone], by_row=True)
        for size, fit in zip(sizes, fits, strict=True)
    ]
    layers.append(Level(1.0, "y", "noise as stated"))
    return Chart("", Axis(column.title), Axis("row's residual, rms [σ]", 0.0, top), layers)


def component_panels(
    column: Column, groups: Mapping[str, Sequence[int]], fits: Sequence[Drawn], rows: Index
) -> list[Chart]:
    """Signed components against one driver, a panel an axis."""
    reach = max(_reach(fit.residual[fit.counts]) for fit in fits)
    dodge = 0.022 * float(np.ptp(column.values)) if len(np.unique(column.values)) <= 20 else 0.0
    out = []
    for name, channels in groups.items():
        layers: list[Layer] = [Level(0.0, "y", dashed=False)]
        for k, fit in enumerate(fits):
            x = column.values[rows] + (k - 0.5 * (len(fits) - 1)) * dodge
            shape = _SHAPES[fit.tone]
            layers += [
                Marks(x, fit.residual[rows, c], fit.tone, fit.name, shape, by_row=True) for c in channels
            ]
        out.append(Chart(name, Axis(column.title), Axis("residual [σ]", -reach, reach), layers))
    return out


def normal_plot(fits: Sequence[Drawn]) -> Chart:
    """Quantiles of all residuals against those of the normal distribution."""
    reach, ends = 4.0, np.array([-3.5, 3.5])
    layers: list[Layer] = [Line(ends, ends, "ink", "normal, as stated", dashed=True)]
    for fit in fits:
        own = fit.residual[fit.counts]
        values = np.sort(own[np.isfinite(own) & (own != 0.0)])  # a reading that was lost is none
        if values.size:
            share = (np.arange(values.size) + 0.5) / values.size
            at = np.unique(np.linspace(0, values.size - 1, min(QUANTILES, values.size)).astype(np.intp))
            layers.append(Marks(ndtri(share[at]), values[at], fit.tone, fit.name, _SHAPES[fit.tone]))
            reach = max(reach, min(1.05 * float(np.max(np.abs(values))), 12.0))
    return Chart(
        "normal plot", Axis("normal quantile [σ]", -3.6, 3.6), Axis("residual [σ]", -reach, reach), layers
    )


def _reach(residual: Array) -> float:
    values = np.abs(residual[np.isfinite(residual)])
    return max(3.5, 1.05 * float(np.max(values, initial=0.0)))
