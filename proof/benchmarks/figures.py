"""Line and bar charts of the studies as SVG files, for the pages in ``docs/``: the same bytes from the same numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

Array = NDArray[np.float64]
_STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "truepose",
    "font.family": "sans-serif",
    "font.sans-serif": ["Helvetica", "Arial", "DejaVu Sans"],
    "font.size": 8.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "lines.linewidth": 1.1,
    "lines.markersize": 4.0,
    "legend.framealpha": 0.7,
}
_LINE, _MARKER = {"line", "both"}, {"points", "both"}


@dataclass(frozen=True)
class Series:
    """One curve: abscissae and ordinates (n,), a name for the legend, ``error`` (n,) half-lengths of bars."""

    name: str
    x: Sequence[float] | Array
    y: Sequence[float] | Array
    style: Literal["line", "points", "both", "none"] = "line"
    error: Sequence[float] | Array | None = None


def write_chart(
    path: Path, title: str, x_label: str, y_label: str, series: Sequence[Series], *, log_y: bool = False
) -> None:
    """Draw the series on common linear axes (ordinates logarithmic on request) and write the SVG."""
    with mpl.rc_context(_STYLE):
        figure, axes = _figure(title, x_label, y_label)
        for one in series:
            line, marker = "-" if one.style in _LINE else "", "o" if one.style in _MARKER else ""
            axes.errorbar(one.x, one.y, yerr=one.error, linestyle=line, marker=marker, label=one.name)
        if log_y:
            axes.set_yscale("log")
        if any(one.name for one in series):
            axes.legend()
        _write(path, figure)


def write_bars(
    path: Path, title: str, y_label: str, groups: Sequence[str], series: Sequence[tuple[str, Sequence[float]]]
) -> None:
    """Draw grouped bars and write the SVG: ``series`` holds a name and one value a group."""
    with mpl.rc_context(_STYLE):
        figure, axes = _figure(title, "", y_label)
        wide = 0.8 / len(series)
        for k, (name, values) in enumerate(series):
            left = np.arange(len(groups)) - 0.4 + k * wide
            axes.bar(left, values, 0.95 * wide, align="edge", label=name)
        axes.set_xticks(range(len(groups)), groups)
        axes.grid(visible=False, axis="x")
        figure.legend(loc="outside right upper")
        _write(path, figure)


def _figure(title: str, x_label: str, y_label: str) -> tuple[Any, Any]:
    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    axes = figure.add_subplot(title=title, xlabel=x_label, ylabel=y_label)
    return figure, axes


def _write(path: Path, figure: Any) -> None:
    """Without a date."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})


__all__ = ["Series", "write_bars", "write_chart"]
