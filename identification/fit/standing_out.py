"""Rows whose readings stand out of the rest of a fit: which, by how much, and what would bring them back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.arrays import Array
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import Channel
from truepose.models.units import convert
from truepose.wording import shortened

_GAP, _MOST = 3.0, 0.4
"""How many times the largest misfit of other rows stands out, and the share of rows from which on it is no exception."""
_SAME = 0.05
"""Share by which factors of several rows may differ and be one."""
_UNITS = {25.4: "inch", 1000.0: "m", 10.0: "cm", 304.8: "ft"}
_ROWS_TOLD, _COLUMNS_TOLD = 6, 3
FAR = 4.0
"""Sigmas of misfit, and tolerances of departures, that any fit may leave."""


@dataclass(frozen=True)
class Left:
    """What a fit leaves of all rows that it may use: whitened residuals (n, m), their rms (n,) by row, and their places (n,).

    limit: sigmas that the drawing's tolerances make at most.
    """

    residual: Array
    sizes: Array
    places: NDArray[np.intp]
    limit: float

    @classmethod
    def of(cls, residual: Array, places: NDArray[np.intp], least: float) -> Left:
        """Return what is left of some rows (n, m) at their places; nothing below ``least`` sigmas stands out."""
        return cls(residual, np.sqrt(np.mean(residual**2, axis=1)), places, least)

    @property
    def rms(self) -> float:
        """Whitened rms over all rows, sigmas."""
        return float(np.sqrt(np.mean(self.sizes**2))) if len(self.sizes) else 0.0

    @property
    def far(self) -> NDArray[np.bool_]:
        """(n,) rows that stand out: beyond the limit, and apart from all others, which a long tail of physics is not."""
        order = np.sort(self.sizes)
        apart = np.flatnonzero((order[1:] > self.limit) & (order[1:] > _GAP * order[:-1]))
        return np.asarray(self.sizes >= (order[apart[0] + 1] if len(apart) else np.inf))


def row_words(machine: Machine, recording: Recording, left: Left) -> str:
    """Return which rows stand out of the rest, and by how much; nothing where they are no exception."""
    far = left.far
    if not far.any() or far.mean() > _MOST:
        return ""
    rows = [str(recording.source_row[k]) for k in left.places[far]]
    head = (
        f"row{'s' if len(rows) > 1 else ''} {shortened(rows, _ROWS_TOLD)} ({len(rows)} of {len(left.sizes)})"
    )
    return f"{head}: {_what_is_wrong(machine, recording, left)}"


def column_words(machine: Machine, left: Left) -> str:
    """Return by how much each column is off, the farthest first."""
    off = np.sqrt(np.mean(left.residual**2, axis=0))
    told = []
    for k in np.argsort(-off)[:_COLUMNS_TOLD]:
        channel, unit = machine.channels[k], machine.units.written(machine.channels[k].unit)
        size = convert(float(off[k]) * channel.sigma, channel.unit, unit)
        told.append(f"{channel.name} is off by {size:.3g} {unit} rms ({off[k]:.4g} sigma)")
    return ", ".join(told)


def _what_is_wrong(machine: Machine, recording: Recording, left: Left) -> str:
    far, channels = left.far, machine.channels
    off = np.sqrt(np.mean(left.residual[far] ** 2, axis=0))
    # a column that is wrong pulls the others' residuals a little, through the fit
    own = [k for k, size in enumerate(off) if size > max(left.limit, 0.2 * off.max())]
    every = [_factor(machine, recording, left, k) for k in own]
    factors = {f for f in every if f is not None}
    names = ", ".join(channels[k].name for k in own)
    if None not in every and len(factors) == 1:
        return f"{names} {_times(factors.pop())}"
    steps = [_offset(left, channels[k], k) for k in own]
    if None not in steps:
        written = [machine.units.written(channels[k].unit) for k in own]
        told = [
            f"{channels[k].name} {convert(float(step or 0.0), channels[k].unit, unit):+.4g} {unit}"
            for k, unit, step in zip(own, written, steps, strict=True)
        ]
        return f"off by a constant: {', '.join(told)}"
    sizes = left.sizes[far]
    middle = float(np.median(left.sizes))
    return f"{names} off by {sizes.min():.3g} to {sizes.max():.3g} sigma, where the middle row is off by {middle:.2g}"


def _factor(machine: Machine, recording: Recording, left: Left, k: int) -> float | None:
    """By which factor, of a unit or the other sign, a column's readings are too large in all rows that stand out."""
    channel = machine.channels[k]
    read = recording.observations.get(channel.name)
    if read is None or channel.unit != "mm":
        return None
    rows = left.places[left.far]
    meant = read[rows] + left.residual[left.far, k] * channel.sigma
    ratio = read[rows] / np.where(meant == 0.0, np.nan, meant)
    middle = float(np.nanmedian(ratio))
    if not np.isfinite(middle) or middle == 0.0 or np.nanmax(np.abs(ratio / middle - 1.0)) > _SAME:
        return None
    known = (s for f in _UNITS for s in (f, 1.0 / f, -1.0) if abs(middle / s - 1.0) < _SAME)
    return next(known, None)


def _times(factor: float) -> str:
    if factor == -1.0:
        return "with the other sign"
    times, way = (factor, "large") if factor > 1.0 else (1.0 / factor, "small")
    unit = min(_UNITS, key=lambda f: abs(times / f - 1.0))
    return f"{unit:g} times too {way} (in {_UNITS[unit]}?)"


def _offset(left: Left, channel: Channel, k: int) -> float | None:
    """How much too large a column is in all rows that stand out, mm or rad; None where it differs from row to row."""
    off = -left.residual[left.far, k] * channel.sigma
    middle = float(np.median(off))
    return middle if len(off) > 1 and np.max(np.abs(off - middle)) <= 4.0 * _SAME * abs(middle) else None
