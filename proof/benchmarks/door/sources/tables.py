"""Data sheets of arms that no bundle has: families in the standard convention, with lengths drawn. mm and deg.

A row is (a, alpha, d, theta) of T = RotZ(theta) TransZ(d) TransX(a) RotX(alpha), and whether the joint slides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..pairs import Array

Row = tuple[float, float, float, float]
RATIOS = (50, 81, 101, 121, 160)


@dataclass(frozen=True)
class Sheet:
    """Rows (n, 4), which joints slide (n,), ranges (n, 2) in mm and deg, reach in mm."""

    rows: Array
    slides: tuple[bool, ...]
    ranges: Array
    reach: float

    @property
    def modified(self) -> Array:
        """(n, 5) beta, alpha, d, theta, r of Khalil and Kleinfinger: alpha and a of a row belong to the next joint.

        What the last row turns and shifts is for the tool: see ``rest``.
        """
        n = len(self.rows)
        out = np.zeros((n, 5))
        out[1:, 1], out[1:, 2] = self.rows[:-1, 1], self.rows[:-1, 0]
        out[:, 3], out[:, 4] = self.rows[:, 3], self.rows[:, 2]
        return out

    @property
    def rest(self) -> tuple[float, float]:
        """a and alpha of the last row."""
        return float(self.rows[-1, 0]), float(self.rows[-1, 1])


def _lengths(rng: np.random.Generator, **ranges: tuple[float, float]) -> dict[str, float]:
    return {name: float(np.round(rng.uniform(*span), 1)) for name, span in ranges.items()}


def _sheet(
    rows: Sequence[Row], ranges: Sequence[tuple[float, float]], slides: set[int], reach: float
) -> Sheet:
    table = np.array(rows, dtype=float)
    return Sheet(table, tuple(k in slides for k in range(len(rows))), np.array(ranges, dtype=float), reach)


def elbow(rng: np.random.Generator) -> Sheet:
    """Six axes, shoulder and elbow parallel, a wrist whose axes meet."""
    scale = float(rng.uniform(0.5, 1.8))
    v = _lengths(rng, d1=(250, 500), a1=(20, 250), a2=(300, 700), a3=(-40, 140), d4=(300, 700), d6=(60, 150))
    v = {k: float(np.round(scale * x, 1)) for k, x in v.items()}
    rows = [(v["a1"], -90, v["d1"], 0), (v["a2"], 0, 0, -90), (v["a3"], -90, 0, 0)]
    rows += [(0, 90, v["d4"], 0), (0, -90, 0, 0), (0, 0, v["d6"], 0)]
    ranges = [(-165, 165), (-80, 75), (-60, 85), (-170, 170), (-110, 110), (-175, 175)]
    return _sheet(rows, ranges, set(), v["a2"] + v["d4"] + v["a1"])


def three_parallel(rng: np.random.Generator) -> Sheet:
    """Six axes, three of them parallel, an offset wrist."""
    v = _lengths(rng, d1=(90, 200), a2=(230, 650), a3=(200, 580), d4=(100, 180), d5=(80, 130), d6=(70, 130))
    rows = [(0, 90, v["d1"], 0), (-v["a2"], 0, 0, 0), (-v["a3"], 0, 0, 0)]
    rows += [(0, 90, v["d4"], 0), (0, -90, v["d5"], 0), (0, 0, v["d6"], 0)]
    ranges = [(-170, 170), (-150, -20), (-130, 130), (-160, 160), (-140, 140), (-170, 170)]
    return _sheet(rows, ranges, set(), v["a2"] + v["a3"])


def seven(rng: np.random.Generator) -> Sheet:
    """Seven axes, shoulder, elbow and wrist balls, with or without small offsets."""
    v = _lengths(rng, d1=(280, 380), d3=(350, 450), d5=(350, 430), d7=(80, 160), e=(20, 90))
    off = v["e"] if rng.random() < 0.5 else 0.0
    rows = [(0, -90, v["d1"], 0), (0, 90, 0, 0), (off, 90, v["d3"], 0), (-off, -90, 0, 0)]
    rows += [(0, -90, v["d5"], 0), (0, 90, 0, 0), (0, 0, v["d7"], 0)]
    ranges = [(-165, 165), (-100, 110), (-160, 160), (-110, 105), (-165, 165), (-105, 115), (-170, 170)]
    return _sheet(rows, ranges, set(), v["d3"] + v["d5"])


def scara(rng: np.random.Generator) -> Sheet:
    """Two turns, a quill that slides down, and a turn of the quill."""
    v = _lengths(rng, d1=(180, 420), a1=(200, 450), a2=(150, 400), d3=(20, 60))
    rows = [(v["a1"], 0, v["d1"], 0), (v["a2"], 180, 0, 0), (0, 0, v["d3"], 0), (0, 0, 40, 0)]
    return _sheet(rows, [(-140, 135), (-145, 145), (10, 190), (-180, 180)], {2}, v["a1"] + v["a2"])


def gantry(rng: np.random.Generator) -> Sheet:
    """Three slides at right angles and a head of two turns."""
    v = _lengths(rng, x=(300, 900), y=(200, 700), z=(150, 400), d4=(80, 200), d5=(60, 160))
    rows = [(0, -90, 120, 0), (0, -90, 85, -90), (0, 0, 60, -90), (0, 90, v["d4"], 0), (0, 0, v["d5"], 0)]
    ranges = [(0, v["x"]), (-v["y"] / 2, v["y"] / 2), (0, v["z"]), (-170, 175), (-105, 100)]
    return _sheet(rows, ranges, {0, 1, 2}, v["x"])


def spherical_slide(rng: np.random.Generator) -> Sheet:
    """Two turns, an arm that slides out, and a wrist of three."""
    v = _lengths(rng, d1=(300, 450), d2=(120, 220), d6=(80, 200))
    rows = [(0, -90, v["d1"], 0), (0, 90, v["d2"], 0), (0, 0, 0, 0)]
    rows += [(0, -90, 0, 0), (0, 90, 0, 0), (0, 0, v["d6"], 0)]
    ranges = [(-160, 165), (-105, 100), (320, 900), (-170, 170), (-90, 95), (-170, 170)]
    return _sheet(rows, ranges, {2}, 600.0)


def cartesian(rng: np.random.Generator) -> Sheet:
    """Three slides at right angles; the tool never turns."""
    v = _lengths(rng, x=(300, 900), y=(200, 700), z=(150, 400))
    rows = [(0, -90, 120, 0), (0, -90, 85, -90), (0, 0, 60, -90)]
    ranges = [(0, v["x"]), (-v["y"] / 2, v["y"] / 2), (0, v["z"])]
    return _sheet(rows, ranges, {0, 1, 2}, v["x"])


FAMILIES: Mapping[str, Callable[[np.random.Generator], Sheet]] = {
    "elbow": elbow,
    "three-parallel": three_parallel,
    "seven": seven,
    "scara": scara,
    "gantry": gantry,
    "spherical-slide": spherical_slide,
}
ALL = {**FAMILIES, "cartesian": cartesian}
"""With those that the study of two hundred does not draw: its seeds stay what they were."""
