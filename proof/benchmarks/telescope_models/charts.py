"""Figures 9 and 15 to 18 of the report, and how far columns of the Jacobian stand out, as SVG files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from telescope_simulator import nominal_machine

from figures import Series, write_bars, write_chart
from truepose.models.machine.assembly import SHAPE, flexure_gain

from .campaign import Array
from .fits import PLATFORMS, Outcome

Mask = NDArray[np.bool_]
LENGTH = 30.0
MAGNIFIED = 20.0
SHOWN = 1e-3
"""sigmas a tolerance; less is not drawn."""
NAMES = {
    "spherical": "6-PUS",
    "linear": "Jacobian",
    "beam": "beam theory",
    "stiffness": "stiffness",
    "elastic": "elastic",
}


def parasitic_shift(folder: Path) -> Array:
    """Fig. 9: the tip of a flexure bent by up to 1 deg, along and across it; returns (n, 4) um along: ball joint,
    eq. 12, exact arc, and what the beam model has."""
    d = np.radians(np.linspace(1e-3, 1.0, 60))
    across = 1e3 * LENGTH * (1 - np.cos(d)) / d
    ball = LENGTH / 2 * (1 - np.cos(d))
    printed = LENGTH * ((d * np.sqrt(1 + d**2) + np.arcsinh(d)) / (2 * d) - 1)
    arc = LENGTH * (1 - np.sin(d) / d)
    grown = np.array(
        [float(ca.evalf(flexure_gain(ca.SX(LENGTH), ca.SX(SHAPE), ca.SX(np.cos(v))))) for v in d]
    )
    model = LENGTH / 2 - (LENGTH / 2 + grown) * np.cos(d)
    rows = 1e3 * np.column_stack([ball, printed, arc, model])
    names = ("ball joint in the middle", "eq. 12", "exact arc", "model: beta = 1/4")
    curves = [
        Series(
            name,
            across[:: 6 if k == 3 else 1],
            rows[:: 6 if k == 3 else 1, k],
            "points" if k == 3 else "line",
        )
        for k, name in enumerate(names)
    ]
    write_chart(
        folder / "telescope_parasitic_shift.svg",
        "Tip of a 30 mm flexure bent by 0 to 1 deg",
        "across (um)",
        "shortening (um)",
        curves,
    )
    return rows


def errors(folder: Path, outcomes: Sequence[Outcome], calibration: NDArray[np.bool_]) -> None:
    """Figs. 15 to 17: mean and largest errors on the forty poses and on the six, a figure a platform and kind."""
    for kind, unit in (("position", "um"), ("orientation", "urad")):
        for platform in PLATFORMS:
            here = [o for o in outcomes if o.platform == platform]
            series = []
            for label, rows in (("forty", calibration), ("six", ~calibration)):
                values = [o.position[rows] if kind == "position" else o.orientation[rows] for o in here]
                series += [
                    (f"mean, {label}", [float(np.mean(v)) for v in values]),
                    (f"max, {label}", [float(np.max(v)) for v in values]),
                ]
            write_bars(
                folder / f"telescope_{kind}_{platform}.svg",
                f"{kind.capitalize()} errors, platform {platform}",
                f"{kind} error ({unit})",
                [NAMES[o.model] for o in here],
                series,
            )


def deviations(folder: Path, outcomes: Sequence[Outcome]) -> None:
    """Fig. 18: a (outer circle) and b (inner) of the 6-PUS from above, distances from the drawing magnified."""
    drawn = nominal_machine()
    series = []
    for platform in PLATFORMS:
        one = next(o for o in outcomes if o.model == "spherical" and o.platform == platform)
        points = []
        for point in "ab":
            for k in range(1, 7):
                nominal = drawn.vector(f"leg{k}", (f"{point}.x", f"{point}.y"))
                moved = np.array([one.deviation.get(f"leg{k}.{point}.{axis}", 0.0) for axis in "xy"])
                points.append(nominal + MAGNIFIED * moved)
        x, y = np.array(points).T
        series.append(Series(f"platform {platform}", x, y, "points"))
    nominal = np.vstack([drawn.legs((f"{p}.x", f"{p}.y")) for p in "ab"])
    series.append(Series("drawing", nominal[:, 0], nominal[:, 1], "points"))
    write_chart(
        folder / "telescope_deviations.svg",
        f"a and b from above, distances from the drawing x {MAGNIFIED:g}",
        "x (mm)",
        "y (mm)",
        series,
    )


def columns(folder: Path, found: Mapping[str, Array]) -> None:
    """What is new in each column as the program takes it: the cliff behind the sixth parameter of a leg."""
    series = [
        Series(NAMES[model], np.arange(1.0, len(shown) + 1.0), shown, "both")
        for model, shown in ((model, values[values > SHOWN]) for model, values in found.items())
    ]
    write_chart(
        folder / "telescope_columns.svg",
        "New in each parameter as it is taken",
        "parameters taken",
        "sigmas a tolerance",
        series,
        log_y=True,
    )
