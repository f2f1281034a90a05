"""The figures of docs/machines/nanopositioner.md: Figures 9 to 15 of the paper recomputed, and the study.

Irradiance is Airy's function of the true cavity at 1560 nm; the paper gives neither reflectivities nor where on
a fringe its motions start, so both are chosen here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from figures import Series, write_chart
from truepose.models.sensors.irradiance import irradiance

from .drift import Day
from .recordings import WAVELENGTH
from .study import TARGET_ANGLE, Line
from .trajectories import Trace

Array = NDArray[np.float64]
REFLECTIVITIES = (0.036, 0.95)
"""A bare fibre's end and a metal mirror."""
CREST, FLANK = WAVELENGTH / 4, WAVELENGTH / 8
"""um that the cavity is longer than at a resonance when the motion starts: most light, or half of it."""
SIGNAL = "irradiance, parts of the light"


def signal(trace: Trace, start: float = CREST) -> Array:
    """(n,) irradiance along a motion that starts ``start`` um from a resonance."""
    return np.asarray(irradiance(start + trace.change, WAVELENGTH, REFLECTIVITIES))


def rotation_chart(path: Path, before: Trace) -> None:
    """Figure 9."""
    title = "Rotation q6 before calibration (Fig. 9)"
    write_chart(path, title, "q6, deg", SIGNAL, [Series("", before.along, signal(before))])


def circle_chart(path: Path, title: str, traces: Sequence[tuple[str, Trace]]) -> None:
    """Figures 10, 12 and 14: one curve for each state of the calibration."""
    curves = [Series(f"{name}: {_swing(t)}", t.along, signal(t)) for name, t in traces]
    write_chart(path, title, "place on the circle, deg", SIGNAL, curves)


def turn_charts(light: Path, joints: Path, turned: Trace) -> None:
    """Figure 11: irradiance and joints while the mirror turns about the reflection point."""
    along = np.abs(turned.along)
    title = "Rotation about Z_f through the reflection point (Fig. 11)"
    write_chart(light, title, "rotation, deg", SIGNAL, [Series("", along, signal(turned))])
    names = ("q1, um", "q2, um", "q3, um", "q4, 0.01 deg", "q5, 0.01 deg")
    scale = np.array([1e3, 1e3, 1e3, *(2 * [100 * 180 / np.pi])])
    curves = [Series(name, along, scale[k] * turned.q[:, k]) for k, name in enumerate(names)]
    write_chart(joints, "Joints that hold the reflection point (Fig. 11)", "rotation, deg", "reading", curves)


def error_chart(path: Path, traces: Sequence[tuple[float, Trace]]) -> None:
    """Figure 15: translations after adding an error to beta_et, started on a fringe's flank."""
    curves = [Series(f"{error:.3f} deg: {_swing(t)}", t.along, signal(t, FLANK)) for error, t in traces]
    title = "Translation along Y_f with an error of beta_et (Fig. 15)"
    write_chart(path, title, "travel, um", SIGNAL, curves)


def hours_chart(path: Path, traces: Sequence[tuple[float, Trace]]) -> None:
    """Figure 13: the swing of the cavity on the circle, hour by hour."""
    swings = [1e3 * trace.swing for _, trace in traces]
    title = "Circle without recalibration (Fig. 13)"
    write_chart(
        path, title, "hours", "cavity's swing, nm", [Series("", [h for h, _ in traces], swings, "both")]
    )


def days_chart(path: Path, days: Sequence[Day]) -> None:
    """What is left day by day, for each way to keep the constants up."""
    names = {"kept": "all kept", "extrinsic": "extrinsics again", "both": "all again"}
    at = [day.table.day for day in days]
    curves = [
        Series(name, at, [day.scores[way].length for day in days], "both") for way, name in names.items()
    ]
    title = "Error of dL on fresh motions"
    write_chart(path, title, "days after the first calibration", "rms, nm", curves, log_y=True)


def study_chart(path: Path, lines: Sequence[Line]) -> None:
    """Error of the normal's change against noise, a curve for each number of readings a motion."""
    curves = []
    for points in sorted({line.points for line in lines}):
        own = [line for line in lines if line.points == points]
        noise, error = [1e3 * line.sigma for line in own], [line.median.normal for line in own]
        curves.append(Series(f"{points} readings a motion", noise, error, "both"))
    widest = max(1e3 * line.sigma for line in lines)
    curves.append(Series("paper's estimate", [0.0, widest], [TARGET_ANGLE, TARGET_ANGLE]))
    title = "Error of the mirror normal's change on fresh motions"
    write_chart(path, title, "noise of a reading, nm", "rms, deg", curves, log_y=True)


def _swing(trace: Trace) -> str:
    """The cavity's swing in words."""
    swing = 1e3 * trace.swing
    return f"{swing:.0f} nm" if swing >= 10 else f"{swing:.1f} nm"
