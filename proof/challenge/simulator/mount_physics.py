"""What happens around a mechanism: mounts that creep or are knocked, parts that warm up, constants that are wrong, rows.

Each function makes a ``Physics``. Twists of a mount are x y z rx ry rz of its frame's error motion, mm and rad.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from . import heat
from .base import Array, Imperfection, Kind, Place
from .joint_physics import places, second_session
from .ported import Physics, Stage, Work

TWIST = ("x", "y", "z", "rx", "ry", "rz")
HOUR = 3600.0
Grow = Callable[[Work, Array], None]
"""Gives a part a strain (n,)."""


def twist_shape(lever: float) -> Callable[[Place, np.random.Generator], Mapping[str, float]]:
    """A direction of motion: translations of size 1, turns of 1 over the lever (mm)."""

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        along, about = rng.standard_normal((2, 3))
        along, about = along / np.linalg.norm(along), about / np.linalg.norm(about) / lever
        twist = dict(zip(TWIST, (*along, *about), strict=True))
        return {**{k: float(v) for k, v in twist.items()}, "settling": float(rng.uniform(0.2, 1.5))}

    return shape


def _twist(work: Work, imperfection: Imperfection, growth: Array) -> None:
    for axis in TWIST:
        name = f"{imperfection.place[0]}.motion.{axis}"
        work.add(name, imperfection.size * imperfection.shape[axis] * growth)


def mount_drift(mounts: Sequence[str], typical: float, lever: float) -> Physics:
    """A mount that settles: ``size`` mm is its way in an hour at the first rate; the stand relaxes in 1 to 8 hours."""

    def act(work: Work, imperfection: Imperfection) -> None:
        hours = (work.campaign.time - work.campaign.time[0]) / HOUR
        pace = 5 * imperfection.shape["settling"]
        _twist(work, imperfection, pace * -np.expm1(-hours / pace))

    kind = Kind("mount-drift", places(mounts), typical, "mount-drift", ("time",))
    return Physics(kind, act, twist_shape(lever))


def frame_shift(mounts: Sequence[str], typical: float, lever: float) -> Physics:
    """A mount knocked between sessions by ``size`` mm."""

    def act(work: Work, imperfection: Imperfection) -> None:
        _twist(work, imperfection, second_session(work))

    kind = Kind("frame-shift", places(mounts), typical, "frame-shift", ("session",))
    return Physics(kind, act, twist_shape(lever))


def body_temperature(work: Work, place: str, lag: float) -> Array:
    """(n,) degC of a body behind its thermometer (``air`` serves a place without one)."""
    logged = work.campaign.temperatures
    drive = logged.get(place, logged.get("air"))
    if drive is None:
        return np.full(len(work), heat.REFERENCE)
    body = np.empty(len(work))
    for session in np.unique(work.campaign.session):
        rows = work.campaign.session == session
        body[rows] = heat.lump(work.campaign.time[rows], drive[rows], lag)
    return body


def stretching(*names: str) -> Grow:
    """What warms up stretches these values in proportion to themselves."""

    def grow(work: Work, strain: Array) -> None:
        for name in names:
            work.add(name, strain * work.value(name))

    return grow


def thermal_expansion(
    parts: Mapping[str, Grow], typical: float, thermometer: str, slowest: float = 1800.0
) -> Physics:
    """A part grows by ``size`` per kelvin of itself; half of the bodies lag behind their thermometers, up to ``slowest`` s."""

    def act(work: Work, imperfection: Imperfection) -> None:
        part = imperfection.place[0]
        body = body_temperature(work, part, imperfection.shape["lag"])
        parts[part](work, heat.strain(body, imperfection.size))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"lag": float(rng.choice([0.0, rng.uniform(0.2, 1.0) * slowest]))}

    kind = Kind("thermal-expansion", places(list(parts)), typical, "thermal-expansion", (thermometer,))
    return Physics(kind, act, shape)


def wrong_constant(names: Sequence[str], typical: float) -> Physics:
    """A parameter that was mistyped or mismeasured by ``size``, mm (rad for angles and directions)."""

    def act(work: Work, imperfection: Imperfection) -> None:
        work.add(imperfection.place[0], imperfection.size)

    return Physics(Kind("wrong-constant", places(names), typical, "wrong-constant", conceals=True), act)


def outliers(typical: float, units: Array) -> Physics:
    """Two to four rows that are off by about ``size`` mm times ``units`` (n_columns,) in every column."""

    def act(work: Work, imperfection: Imperfection) -> None:
        for row, share in _rows(work, imperfection):
            sides = np.random.default_rng(row).choice([-1.0, 1.0], work.seen.shape[1])
            work.seen[row] += imperfection.size * (0.7 + 0.6 * share) * sides * units

    return Physics(Kind("outliers", (("rows",),), typical, "outliers"), act, row_shape, Stage.ROWS)


def fringe_miscount(half_wave: float) -> Physics:
    """Two to four changes of length that miss ``size`` half waves (mm each), either way."""

    def act(work: Work, imperfection: Imperfection) -> None:
        for row, share in _rows(work, imperfection):
            counts = work.campaign.origin[row] != row
            work.seen[row] += counts * imperfection.size * half_wave * (1.0 if share < 0.5 else -1.0)

    return Physics(Kind("fringe-miscount", (("rows",),), 1.0, "fringe-miscount"), act, row_shape, Stage.ROWS)


def row_shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
    """Which rows: shares of the recording, no two in one twentieth of it."""
    rows = rng.permutation(20)[:4] / 20 + rng.uniform(0, 0.05, 4)
    return {"count": float(rng.integers(2, 5)), **{f"row{j}": float(r) for j, r in enumerate(rows)}}


def _rows(work: Work, imperfection: Imperfection) -> Iterator[tuple[int, float]]:
    """Rows of a ``row_shape``, each with a number in [0, 1) of its own."""
    n = len(work)
    for j in range(int(imperfection.shape["count"])):
        share = imperfection.shape[f"row{j}"]
        yield min(int(share * n), n - 1), (20 * share) % 1.0
