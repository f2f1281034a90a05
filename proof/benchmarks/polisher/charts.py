"""The figures of docs/machines/polisher.md."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from figures import Series, write_bars, write_chart

from . import layers, montecarlo, path, ranks
from .montecarlo import Size

SHOWN = 70
ETA_SIZES = (0.01, 0.03, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
BARS = ("OLS", "LE, eq. (14)", "ridge", "PCR", "MAP", "MAP, all 150, exact")


def draw(folder: Path, found: Sequence[layers.Found], runs: int) -> list[Path]:
    """All figures: ``found`` are the robots of the layers' table, ``runs`` the noise draws of the Monte-Carlo one."""
    figures = {
        "polisher_singular_values.svg": _singular_values,
        "polisher_eta.svg": lambda file: _eta(file, runs),
        "polisher_layers.svg": lambda file: _layers(file, found),
        "polisher_path.svg": _path,
    }
    for name, figure in figures.items():
        figure(folder / name)
    return [folder / name for name in figures]


def _singular_values(file: Path) -> None:
    series = []
    for name, turned in ranks.TURNED.items():
        s = ranks.singular_values(turned)
        series.append(Series(name, np.arange(1.0, SHOWN + 1), s[:SHOWN] / s[0], "both"))
    title = "Singular values of H (98 nodes; mm and deg): 51 or 54 are not zero"
    write_chart(file, title, "number", "parts of the largest", series, log_y=True)


def _eta(file: Path, runs: int) -> None:
    series = []
    for seed in (1, 2, 3):
        values = []
        for size in ETA_SIZES:
            y = montecarlo.draws(Size(size, size), seed, runs)
            ols, liu = (
                montecarlo.Spread.of(scheme, y) for scheme in montecarlo.schemes(Size(size, size))[:2]
            )
            values.append(montecarlo.eta(liu, ols)[0])
        series.append(Series(f"robot {seed}", ETA_SIZES, values, "both"))
    ends = (ETA_SIZES[0], ETA_SIZES[-1])
    series.append(Series("the paper's 63.9 %", ends, (63.9, 63.9)))
    write_chart(
        file,
        "Liu against least squares, eqs. (14), (17), (18)",
        "source errors, 1 sigma, mm and deg",
        "eta, %",
        series,
    )


def _layers(file: Path, found: Sequence[layers.Found]) -> None:
    series = [(name, [layers.average(found, name, where)[0][1] for where in layers.FIELDS]) for name in BARS]
    groups = ["calibration layer", "test layer", "test layer, tilted 5 deg"]
    write_bars(file, "Mean position error of P after compensation", "um", groups, series)


def _path(file: Path) -> None:
    series = []
    for name in ("encoders (coarse)", "OLS, eq. (16)", "LE, eq. (14), eq. (16)", "MAP, all 150, exact"):
        size = 1e3 * np.linalg.norm(path.followed().errors[name][:, :3], axis=1)
        series.append(Series(name, np.arange(float(len(size))), size))
    write_chart(file, "Raster over a lens: position error of P", "point", "um", series, log_y=True)
