"""The pictures of ``reference/machine-file.md``: the frames of a machine and its tracker, and a joint's modified DH constants.

python docs/frames_picture.py
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, FancyArrowPatch
from numpy.typing import NDArray

FOLDER = Path(__file__).resolve().parent / "figures"
FRAMES, CONSTANTS = FOLDER / "frames.svg", FOLDER / "modified_dh.svg"
Array = NDArray[np.float64]
X, Y, Z, INK, SOFT = "#c2452d", "#3b8a3e", "#2f5fb3", "#222222", "#8a8a8a"
AXES = (X, Y, Z)
UP, ACROSS = np.array([0.0, 1.0]), np.array([1.0, 0.0])
_STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "truepose",
    "font.family": "sans-serif",
    "font.sans-serif": ["Helvetica", "Arial", "DejaVu Sans"],
    "font.size": 9.0,
}
_SIZE = 72.0  # points an inch: one unit of the drawings is one point


@dataclass(frozen=True)
class Triad:
    """A frame in the plane of the paper: its origin, and where the tips of x, y and z go from there."""

    at: tuple[float, float]
    tips: tuple[tuple[float, float], ...]

    def draw(self, axes: Axes, name: str, place: tuple[float, float], *, letters: bool = True) -> None:
        """Three arrows, and the frame's name at a place beside its origin."""
        for letter, colour, (dx, dy) in zip("xyz", AXES, self.tips, strict=False):
            end = (self.at[0] + dx, self.at[1] + dy)
            arrow(axes, self.at, end, colour, width=1.8)
            if letters:
                away = np.hypot(dx, dy)
                spot = (end[0] + 7 * dx / away, end[1] + 7 * dy / away)
                axes.text(*spot, letter, color=colour, ha="center", va="center", fontsize=8)
        axes.plot(*self.at, "o", color=INK, markersize=3.5, zorder=6)
        axes.text(
            self.at[0] + place[0], self.at[1] + place[1], name, ha="center", va="center", fontweight="bold"
        )


def arrow(
    axes: Axes,
    start: Sequence[float],
    end: Sequence[float],
    colour: str,
    *,
    width: float = 1.2,
    style: str = "-|>",
    bend: float = 0.0,
    dashed: bool = False,
) -> None:
    """An arrow of the drawing."""
    axes.add_patch(
        FancyArrowPatch(
            (start[0], start[1]),
            (end[0], end[1]),
            arrowstyle=style,
            mutation_scale=9,
            color=colour,
            linewidth=width,
            shrinkA=0,
            shrinkB=0,
            connectionstyle=f"arc3,rad={bend}",
            linestyle="--" if dashed else "-",
            zorder=5,
        )
    )


def paper(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure of so many points, y upwards, without anything around it."""
    figure = Figure(figsize=(width / _SIZE, height / _SIZE))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, width), ylim=(0, height), aspect="equal")
    axes.set_axis_off()
    return figure, axes


def frames() -> Figure:
    """A serial arm on its base, a tracker, a target on the tool, and the frames between them."""
    figure, axes = paper(620, 400)
    base, tool, world = (330.0, 62.0), (508.0, 214.0), (82.0, 120.0)
    joints = [(330.0, 62.0), (330.0, 150.0), (372.0, 300.0), (470.0, 318.0), (500.0, 262.0)]
    _ground(axes)
    _arm(axes, joints)
    _tracker(axes, world)
    _target(axes, world, tool)
    up, side = ((34.0, 0.0), (15.0, 17.0), (0.0, 36.0)), ((30.0, 8.0), (14.0, 18.0), (-8.0, 30.0))
    Triad(world, up).draw(axes, "world", (-34.0, -12.0))
    Triad(base, up).draw(axes, "base", (-28.0, -8.0))
    for k, (joint, place) in enumerate(
        zip(joints[1:4], ((-28.0, 10.0), (-26.0, 10.0), (10.0, 40.0)), strict=True), start=1
    ):
        Triad(joint, tuple((0.75 * dx, 0.75 * dy) for dx, dy in side)).draw(
            axes, f"link{k}", place, letters=False
        )
    Triad(joints[4], ((26.0, 14.0), (20.0, -12.0), (6.0, -30.0))).draw(
        axes, "flange", (46.0, 22.0), letters=False
    )
    Triad(tool, ((30.0, 16.0), (26.0, -16.0), (6.0, -36.0))).draw(axes, "tool", (-18.0, -16.0))
    _transforms(axes, world, base, joints[4], tool)
    return figure


def _ground(axes: Axes) -> None:
    axes.plot([40, 600], [40, 40], color=SOFT, linewidth=1.0)
    for start in range(46, 600, 14):
        axes.plot([start, start - 7], [40, 32], color=SOFT, linewidth=0.6)
    arrow(axes, (582.0, 130.0), (582.0, 84.0), INK, width=1.6)
    axes.text(576, 108, "gravity\n(in the base frame)", ha="right", va="center")


def _arm(axes: Axes, joints: Sequence[tuple[float, float]]) -> None:
    x, y = zip(*joints, strict=True)
    axes.plot(x, y, color="#d9dde4", linewidth=17, solid_capstyle="round", solid_joinstyle="round", zorder=1)
    axes.plot(x[1:4], y[1:4], "o", color="white", markeredgecolor=SOFT, markersize=11, zorder=2)
    axes.fill([306, 354, 346, 314], [40, 40, 62, 62], color="#c3c9d3", zorder=1)
    axes.plot([joints[4][0], 508], [joints[4][1], 224], color="#b9a36b", linewidth=6, zorder=1)


def _tracker(axes: Axes, world: tuple[float, float]) -> None:
    x, y = world
    axes.plot([x, x - 22], [y - 12, 40], color=SOFT, linewidth=2)
    axes.plot([x, x + 22], [y - 12, 40], color=SOFT, linewidth=2)
    axes.add_patch(mpl.patches.Circle(world, 15, facecolor="#e9ecf1", edgecolor=SOFT, zorder=1))
    axes.text(x, y - 96, "tracker: its frame is the world", ha="center", va="top")


def _target(axes: Axes, world: tuple[float, float], tool: tuple[float, float]) -> None:
    target = (tool[0] + 34.0, tool[1] - 30.0)
    axes.plot([tool[0], target[0]], [tool[1], target[1]], color="#b9a36b", linewidth=4, zorder=1)
    axes.plot(*target, "o", color="#f4d35e", markeredgecolor=INK, markersize=11, zorder=6)
    axes.text(target[0] + 12, target[1] - 14, "target P1\n(points, in the tool frame)", ha="center", va="top")
    axes.plot([world[0], target[0]], [world[1], target[1]], color=X, linewidth=0.9, linestyle=":", zorder=0)
    axes.text(228, 160, "what the sensor reads", color=X, rotation=7.5, ha="center", va="center")


def _transforms(axes: Axes, *places: tuple[float, float]) -> None:
    world, base, flange, tool = places
    arrow(axes, (world[0] + 14, world[1] - 22), (base[0] - 12, base[1] + 6), INK, bend=0.12, dashed=True)
    axes.text(204, 56, "frames.base", ha="center", va="center", family="monospace")
    arrow(axes, (base[0] + 16, base[1] + 30), (flange[0] - 12, flange[1] - 8), INK, bend=0.18, dashed=True)
    axes.text(438, 236, "mechanism,\nmoved by q", ha="right", va="center", family="monospace")
    arrow(axes, (flange[0] + 16, flange[1] - 4), (tool[0] + 12, tool[1] + 10), INK, bend=-0.7, dashed=True)
    axes.text(590, 250, "frames.tool", ha="right", va="center", family="monospace")
    axes.text(
        310,
        384,
        "sensor sees:  world_T_base  ·  base_T_flange(q)  ·  flange_T_tool",
        ha="center",
        va="center",
    )


def constants() -> Figure:
    """From the axis before to this one: beta about y, alpha about x, d along x, theta about z, r along z."""
    figure, axes = paper(560, 330)
    before, foot, top = np.array([110.0, 96.0]), np.array([330.0, 96.0]), np.array([384.0, 222.0])
    along = (top - foot) / np.linalg.norm(top - foot)
    _line(axes, before - 48 * UP, before + 176 * UP)
    _line(axes, foot - 52 * along, top + 86 * along)
    axes.plot([before[0], foot[0]], [before[1], foot[1]], color=SOFT, linewidth=1.0, linestyle="--")
    Triad((110.0, 96.0), ((44.0, 0.0), (20.0, 24.0), (0.0, 52.0))).draw(axes, "frame i-1", (-42.0, -10.0))
    tip = 52 * along
    Triad((float(top[0]), float(top[1])), ((40.0, -24.0), (26.0, 20.0), (float(tip[0]), float(tip[1])))).draw(
        axes, "frame i", (-36.0, 6.0)
    )
    _measures(axes, before, foot, top, along)
    axes.text(110, 290, "axis of joint i-1", ha="center", va="center")
    axes.text(446, 312, "axis of joint i", ha="center", va="center")
    axes.text(
        280,
        14,
        "T(i-1, i) = RotY(beta) RotX(alpha) TransX(d) RotZ(theta) TransZ(r)",
        ha="center",
        family="monospace",
    )
    return figure


def _line(axes: Axes, start: Array, end: Array) -> None:
    axes.plot([start[0], end[0]], [start[1], end[1]], color=SOFT, linewidth=1.0, linestyle="-.")


def _measures(axes: Axes, before: Array, foot: Array, top: Array, along: Array) -> None:
    arrow(axes, before - 26 * UP, foot - 26 * UP, INK, style="<|-|>")
    axes.text(220, 58, "d, along x", ha="center", va="center", fontweight="bold")
    side = 20 * np.array([along[1], -along[0]])
    arrow(axes, foot + side, top + side, INK, style="<|-|>")
    middle = (foot + top) / 2 + 1.6 * side
    axes.text(
        middle[0] + 2, middle[1] - 4, "r, along z\n(a slide's reading adds)", va="center", fontweight="bold"
    )
    axes.plot([foot[0], foot[0]], [foot[1], foot[1] + 110], color=SOFT, linewidth=0.8, linestyle=":")
    turn = float(np.degrees(np.arctan2(along[1], along[0])))
    axes.add_patch(
        Arc((float(foot[0]), float(foot[1])), 150, 150, theta1=turn, theta2=90, color=X, linewidth=1.4)
    )
    axes.text(322, 184, "alpha, about x", color=X, ha="right", va="center", fontweight="bold")
    arrow(
        axes, top + 78 * along - 20 * ACROSS, top + 78 * along + 20 * ACROSS - 2 * UP, Z, bend=0.7, width=1.4
    )
    spot = top + 66 * along
    axes.text(
        spot[0] + 34,
        spot[1] - 8,
        "theta, about z\n(a turn's reading adds)",
        color=Z,
        va="center",
        fontweight="bold",
    )
    arrow(axes, before + 36 * UP + 3 * ACROSS, before + 3 * UP + 36 * ACROSS, Y, bend=-0.4, width=1.4)
    axes.text(
        152, 138, "beta, about y\n(only where axes are parallel)", color=Y, va="center", fontweight="bold"
    )


def main() -> None:
    """Draw both."""
    with mpl.rc_context(_STYLE):
        for path, figure in ((FRAMES, frames()), (CONSTANTS, constants())):
            figure.savefig(path, format="svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
