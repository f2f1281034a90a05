"""The pictures of ``how-it-works.md``, from runs of ``examples/worked_example.py`` and one drawing.

python -m docs.how_it_works_pictures
"""

from __future__ import annotations

import importlib
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from numpy.typing import NDArray

import truepose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.models.machine.machine import Machine

example: Any = importlib.import_module("examples.worked_example")
FOLDER = Path(__file__).resolve().parent / "figures"
Array = NDArray[np.float64]
INK, SOFT, PLAIN, FOUND, OTHER = "#7d7d7d", "#9a9a9a", "#D55E00", "#0072B2", "#2e9e73"
"""Colours that show on white and on dark paper."""
STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "truepose",
    "font.family": "sans-serif",
    "font.sans-serif": ["Helvetica", "Arial", "DejaVu Sans"],
    "font.size": 9.5,
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK),
    **dict.fromkeys(("axes.spines.top", "axes.spines.right", "legend.frameon"), False),
    **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor"), "none"),
}
SWEEP = np.linspace(-60.0, 60.0, 121)
NEAR, WIDE = 15.0, 60.0


@dataclass(frozen=True)
class Runs:
    """The worked example's machine, its recordings of rows near the middle and further out, and what was found."""

    machine: Machine
    near: pd.DataFrame
    new: pd.DataFrame
    first: Diagnosis
    second: Diagnosis


def runs(folder: Path) -> Runs:
    """The same rows as the example's."""
    rng = np.random.default_rng(1)
    near, wide = (
        example.measure(60, NEAR, "calibration", rng),
        example.measure(20, WIDE, "calibration", rng),
    )
    new = example.measure(20, WIDE, "validation", rng)
    path = folder / "machine.yaml"
    path.write_text(example.MACHINE, encoding="utf-8")
    machine = truepose.load_machine(path)
    first, second = (
        truepose.diagnose(machine, truepose.load_recording(machine, pd.concat(rows)))
        for rows in ([near, new], [near, wide, new])
    )
    return Runs(machine, near, new, first, second)


def predicted(result: Diagnosis, which: str, rows: pd.DataFrame, folder: Path) -> Array:
    """(n, 3) what a diagnosis' fit ``before`` or ``after`` says that the tracker reads, mm."""
    path = folder / f"{which}.yaml"
    truepose.write_calibrated(path, getattr(result, which), result.recording)
    machine = truepose.load_machine(path)
    return np.asarray(truepose.predict(machine, rows)[["x", "y", "z"]], dtype=float)


def along(swing: Array, error: Array) -> Array:
    """(n,) the part of an error (n, 3) along the tip's circle, um."""
    turn = np.radians(swing) + np.pi / 6
    return 1e3 * (error[:, 1] * np.cos(turn) - error[:, 0] * np.sin(turn))


def bias(found: Runs, folder: Path) -> Figure:
    """Residuals of plain calibration where it was fitted and beyond, and the length that it needed."""
    figure = Figure(figsize=(7.6, 3.3), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2.4, 1.0))
    sweep = pd.DataFrame({"lift": np.zeros(len(SWEEP)), "swing": SWEEP})
    for result, which, colour, name in (
        (found.first, "before", PLAIN, "plain calibration"),
        (found.second, "after", FOUND, "improved model, 20 rows more"),
    ):
        error = predicted(result, which, sweep, folder) - example.seen(0.0 * SWEEP, SWEEP)
        left.plot(SWEEP, -along(SWEEP, error), color=colour, label=name)
    for rows, face, name in ((found.near, PLAIN, "fitted rows"), (found.new, "none", "new rows, not fitted")):
        swing = rows["swing"].to_numpy()
        error = rows[["x", "y", "z"]].to_numpy() - predicted(
            found.first, "before", rows[["lift", "swing"]], folder
        )
        left.plot(swing, along(swing, error), "o", ms=4, mec=PLAIN, mfc=face, ls="none", label=name)
    left.axvspan(-NEAR, NEAR, color=SOFT, alpha=0.18, lw=0)
    left.set(xlabel="swing, deg", ylabel="error along the circle, µm", title="The fitted rows look good")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8.5)
    _length(right, found)
    return figure


def _length(axes: Axes, found: Runs) -> None:
    x = np.linspace(499.3, 501.2, 400)
    table = found.first.before.to_frame().set_index("parameter")
    fitted, sigma_fitted = (float(table[column].to_dict()["tool.x"]) for column in ("value", "std"))
    for mean, sigma, colour, name in (
        (500.0, 0.1, SOFT, "drawing"),
        (fitted, sigma_fitted, PLAIN, "plain\ncalibration"),
    ):
        axes.fill_between(x, np.exp(-0.5 * ((x - mean) / sigma) ** 2), color=colour, alpha=0.45, lw=0)
        axes.text(mean, 1.04, name, ha="center", va="bottom", color=INK, fontsize=8.5)
    axes.axvline(example.LENGTH, color=FOUND, lw=1.5, ymax=0.72)
    axes.text(example.LENGTH - 0.22, 0.8, "truth", ha="right", color=FOUND, fontsize=8.5)
    axes.set(ylim=(0, 1.4), yticks=[], xlabel="length of the arm, mm", title="The length pays for it")
    axes.spines["left"].set_visible(False)


def signatures(machine: Machine) -> Figure:
    """What effects do to the tip, and what the geometry cannot take up: over little travel, and over much."""
    named = {
        "scale error": "actuator-scale@swing:s=1e-3",
        "eccentric encoder disc": "encoder-eccentricity@swing:a=1e-3",
        "gear error, 12 a turn": "transmission-error@swing:order=12,a=2e-4",
    }
    figure = Figure(figsize=(7.6, 2.7), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    for axes, (title, effect) in zip(panels, named.items(), strict=True):
        moved = displaced(machine, effect)
        axes.plot(SWEEP, along(SWEEP, moved), color=INK, lw=1.3, label="effect")
        for widest, colour in ((WIDE, FOUND), (NEAR, PLAIN)):
            inside = np.abs(SWEEP) <= widest
            left = along(SWEEP[inside], remaining(SWEEP[inside], moved[inside]))
            axes.plot(
                SWEEP[inside], left, color=colour, lw=2.2, label=f"left over, rows within {widest:.0f} deg"
            )
        axes.set(title=title, xlabel="swing, deg")
    panels[0].set_ylabel("along the circle, µm")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8.5)
    return figure


def displaced(machine: Machine, effect: str) -> Array:
    """(n, 3) how an effect moves the tip along the sweep, mm."""
    rows = {"lift": 0.0 * SWEEP, "swing": SWEEP}
    added = truepose.parse_effect(effect, machine)
    with_it, without = (truepose.simulate(machine, rows, extra, seed=None) for extra in ([added], []))
    turn = np.pi / 6  # the drawn machine stands in the tracker's axes; the real one is turned
    c, s = np.cos(turn), np.sin(turn)
    moved = (with_it - without)[["x", "y", "z"]].to_numpy()
    return np.asarray(moved @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


def remaining(swing: Array, moved: Array) -> Array:
    """(n, 3) what is left of a movement of the tip after base and arm length have adapted to it as well as they can."""
    turn = np.radians(swing) + np.pi / 6
    flat = np.zeros_like(turn)
    radial = np.column_stack([np.cos(turn), np.sin(turn), flat])
    round_about = np.column_stack([-np.sin(turn), np.cos(turn), flat])
    x, y = (np.tile(axis, (len(turn), 1)) for axis in np.eye(3)[:2])
    columns = np.stack([radial, round_about, x, y], axis=-1).reshape(-1, 4)
    best, *_ = np.linalg.lstsq(columns, moved.ravel(), rcond=None)
    taken_up: Array = (columns @ best).reshape(-1, 3)
    return moved - taken_up


def levels(found: Runs) -> Figure:
    """How sure place, driver and law are, and what the model is worth on new rows, of either recording."""
    figure = Figure(figsize=(7.6, 2.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    at = np.arange(4)[::-1]
    names = [
        "something is at the swing",
        "its own position drives it",
        "scale error",
        "eccentric encoder disc",
    ]
    for k, (result, colour, name) in enumerate(
        ((found.first, PLAIN, "rows within 15 deg"), (found.second, FOUND, "and 20 within 60 deg"))
    ):
        (finding,) = result.findings
        alike = {e.effect: e.probability for e in finding.equivalents}
        sure = [
            finding.levels.place,
            finding.levels.driver,
            finding.probability,
            alike.get("encoder-eccentricity", 0.0),
        ]
        left.barh(at + 0.2 - 0.4 * k, sure, 0.36, color=colour, label=name)
        assert result.applied and result.applied.pose
        errors = [1e3 * result.applied.pose.plain, 1e3 * result.applied.pose.model]
        bars = right.bar(np.arange(2) - 0.2 + 0.4 * k, errors, 0.36, color=colour)
        right.bar_label(bars, fmt="%.0f", fontsize=8.5, color=INK, padding=4)
    left.set(yticks=at, yticklabels=names, xlabel="probability", xlim=(0, 1.02))
    noise = 1e3 * example.NOISE * np.sqrt(2)  # of the plane that the arm moves in
    right.axhline(noise, color=INK, lw=1.0, ls="--")
    right.text(1.01, noise, "noise", transform=right.get_yaxis_transform(), va="center", fontsize=8.5)
    right.set(
        xticks=[0, 1], xticklabels=["plain calibration", "improved model"], ylabel="error on new rows, µm"
    )
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8.5)
    return figure


STEPS = (
    ("Machine file,\nrecording", "drawing and\nreadings"),
    ("Fit under\ntolerances", "the geometry\nas a prior"),
    ("Signatures", "every effect\nat every place"),
    ("Posterior\nover sets", "spike and slab,\nsampled"),
    ("Findings", "place, driver,\nlaw, rivals"),
    ("Proof", "rows that were\nnot fitted"),
    ("Applied", "average model:\nfile, report, C"),
)


def flow() -> Figure:
    """The steps from the two files to what is applied."""
    wide, width = 560.0, 80.0
    figure = Figure(figsize=(wide / 72, 92 / 72))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, wide), ylim=(0, 92))
    axes.set_axis_off()
    for k, (title, detail) in enumerate(STEPS):
        left = k * width + 7
        shape = "round,pad=0,rounding_size=5"
        axes.add_patch(FancyBboxPatch((left, 50), 66, 36, boxstyle=shape, fc="none", ec=FOUND, lw=1.3))
        axes.text(left + 33, 68, title, ha="center", va="center", fontweight="bold", fontsize=8)
        axes.text(left + 33, 43, detail, ha="center", va="top", fontsize=7.3)
        if k:
            style = {"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", (left - 1, 68), (left - 13, 68), arrowprops=style)
    return figure


def draw(folder: Path) -> None:
    """Write all pictures into a folder."""
    with tempfile.TemporaryDirectory() as name, mpl.rc_context(STYLE):
        found = runs(Path(name))
        pictures = {
            "flow": flow(),
            "bias": bias(found, Path(name)),
            "signatures": signatures(found.machine),
            "levels": levels(found),
        }
        for title, figure in pictures.items():
            path = folder / f"how_{title}.svg"
            figure.savefig(path, format="svg", metadata={"Date": None}, transparent=True)


if __name__ == "__main__":
    draw(FOLDER)
