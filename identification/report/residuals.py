"""Residuals against what drives them, and their size in the order of rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.report.curves import Column, columns, component_groups, order_column, terms_of
from truepose.identification.report.scene import thinned
from truepose.models.file.driver import Driver
from truepose.models.machine.machine import Machine
from truepose.shown.chart import Axis, Chart, Layer, Level, Marks
from truepose.shown.document import Block, Charts, Fold, Section, Text

MOVES = 30_000
"""Most points of all panels together: a page stays below a megabyte."""
FEWEST = 150
"""Rows that are drawn in any case, where there are as many."""


def picked(machine: Machine, recording: Recording, fits: int) -> Index:
    """Return the rows that are drawn, evenly spread, where each is drawn in every chart of so many fits."""
    channels = sum(map(len, component_groups(machine.channels).values()))
    points = max(fits * len(columns(machine, recording)) * channels, 1)
    return thinned(np.arange(len(recording)), max(FEWEST, MOVES // points))


def residual_section(
    machine: Machine,
    recording: Recording,
    fits: Mapping[str, Estimate],
    telling: Sequence[str],
    rows: Index,
) -> Section:
    """Draw signed components against the most telling driver, then every other, and sizes over time.

    fits: one or two, by the names ``before``, ``after`` or ``calibrated``.
    """
    if not len(recording) or not any(_counts(fit, recording).any() for fit in fits.values()):
        return Section("residuals", "Residuals", [Text("No row was fitted.")])
    drivers = columns(machine, recording, telling)
    known = {c.name: c for c in drivers}
    first = next((known[name] for name in telling if name in known), drivers[0])
    panels = {one.name: _component_panels(one, machine, recording, fits, rows) for one in drivers}
    thin = f" Of {len(recording):,} rows {len(rows):,} are drawn." if len(rows) < len(recording) else ""
    caption = (
        f"Signed residuals, in stated sigmas, against {first.name}, the driver that matters most here. A slope, a wave or a"
        f" step is a systematic error that noise would not make.{thin} Click a point: it is ringed in every chart."
    )
    blocks: list[Block] = [Charts(panels.pop(first.name), caption)]
    if panels:
        also = "The same against every other joint, every logged driver and the order of rows."
        others = Charts([panel for own in panels.values() for panel in own], also)
        blocks.append(Fold("Signed residuals against every other driver", [others]))
    said = "Size of each row's residual; 1 (dashed) is noise as stated."
    return Section("residuals", "Residuals", [*blocks, Charts([_size_chart(recording, fits, rows)], said)])


def telling_drivers(diagnosis: Diagnosis) -> list[str]:
    """Return drivers by how much they matter: of findings, of the remainder, of the structure test."""
    limbs = {limb.name: limb.reading for limb in diagnosis.nominal.mechanism.limbs}
    out: list[str] = []
    for f in diagnosis.findings:
        out += [Driver.of(name).now.name for t in terms_of(diagnosis, f) for name in t.drivers]
        out += [limbs.get(p, p) for p in reversed(f.place)]
    if diagnosis.remainder is not None:
        out.append(diagnosis.remainder.driver)
    before = diagnosis.alarms["structure"].about if "structure" in diagnosis.alarms else ""
    return [*out, before, diagnosis.structure.about]


def _counts(fit: Estimate, recording: Recording) -> Mask:
    """Return the rows (n,) that set the scale: fitted ones and those held out."""
    return np.asarray(fit.used | recording.validation)


def row_sizes(residual: Array) -> Array:
    """Return (n,) the rms of each row's whitened components; NaN where a row has none."""
    finite = np.isfinite(residual) & (residual != 0.0)  # a row that refers to itself reads nothing
    total = np.sum(np.where(finite, residual, 0.0) ** 2, axis=1)
    count = finite.sum(axis=1)
    return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


def _size_chart(recording: Recording, fits: Mapping[str, Estimate], rows: Index) -> Chart:
    """Draw the rms of each row's residual in the order of rows; rows off the scale stand at its top edge."""
    column, layers, top = order_column(recording), list[Layer](), 1.0
    for name, fit in fits.items():
        sizes = row_sizes(fit.residual)
        counted = sizes[_counts(fit, recording) & np.isfinite(sizes)]
        top = max(top, float(np.max(counted, initial=1.0)))
        layers.append(_marks(column.values[rows], sizes[rows], name))
    layers.append(Level(1.0, "y", "noise as stated"))
    return Chart("", Axis(column.title), Axis("row's residual, rms [σ]", 0.0, 1.08 * top), layers)


def _component_panels(
    column: Column, machine: Machine, recording: Recording, fits: Mapping[str, Estimate], rows: Index
) -> list[Chart]:
    """Draw signed components against one driver, a panel an axis."""
    counted = [np.abs(fit.residual[_counts(fit, recording)]) for fit in fits.values()]
    reach = max(3.5, *(1.05 * float(np.nanmax(values, initial=0.0)) for values in counted))
    dodge = 0.022 * float(np.ptp(column.values)) if len(np.unique(column.values)) <= 20 else 0.0
    out = []
    for axis, channels in component_groups(machine.channels).items():
        layers: list[Layer] = [Level(0.0, "y", dashed=False)]
        for k, (name, fit) in enumerate(fits.items()):
            x = column.values[rows] + (k - 0.5 * (len(fits) - 1)) * dodge
            layers += [_marks(x, fit.residual[rows, c], name) for c in channels]
        out.append(Chart(axis, Axis(column.title), Axis("residual [σ]", -reach, reach), layers))
    return out


def _marks(x: Array, y: Array, name: str) -> Marks:
    """Return a mark a row; of the fit before, strokes, of any other dots."""
    if name == "before":
        return Marks(x, y, "before", name, "stroke", by_row=True)
    return Marks(x, y, "after", name, by_row=True)
