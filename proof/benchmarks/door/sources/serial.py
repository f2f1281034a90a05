"""Serial arms of this benchmark: a data sheet, a specimen, a machine file as ``serial``, ``graph`` or ``urdf``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ..pairs import Array, Document, Pair
from ..rotations import frame
from .campaign import campaign, logged
from .chain import Arm, Body, Physics, tool_poses
from .conditions import DIGITS, Conditions
from .description import graph_section, urdf_text
from .reading import Instrument, instrument
from .tables import ALL, RATIOS, Sheet

NAMES = ("q{}", "j{}", "A{}", "axis{}", "theta{}")
FIELDS = ("beta", "alpha", "d", "theta", "r")
GRAVITY = [0.0, 0.0, -9.80665]


@dataclass(frozen=True)
class Drawing:
    """What the file says. Mounts in mm and deg; tolerances of lengths (mm) and angles (deg)."""

    sheet: Sheet
    names: list[str]
    base: tuple[Array, Array]
    tool: tuple[Array, Array]
    base_tolerance: tuple[float, float]
    tool_tolerance: tuple[float, float]
    length: float
    angle: float
    instrument: Instrument
    bodies: tuple[Body, ...]
    ratios: Array
    ranges: bool


def serial(
    family: str,
    form: str,
    sensor: str,
    rng: np.random.Generator,
    *,
    effects: int = 1,
    still: bool = False,
    unknown: bool = False,
    under: Conditions | None = None,
) -> Pair:
    """A pair of one family in one form. ``unknown``: base and tool are told as such; ``still``: one joint never moves."""
    drawn = _drawing(ALL[family](rng), sensor, rng, unknown)
    if under is not None:
        drawn = _under(drawn, under)
    sheet = drawn.sheet
    slides = np.array(sheet.slides)
    low, high = np.where(slides[:, None], sheet.ranges, np.radians(sheet.ranges)).T
    held = int(rng.integers(1, len(slides) - 1)) if still else None
    c = campaign(low, high, rng, held) if under is None else under.campaign(low, high, ~slides, rng)
    physics = _physics(drawn, rng, effects)
    if under is not None:
        physics = physics.times(under.physics)
    tool = tool_poses(_specimen(drawn, rng), c, physics)
    digits = {} if under is None else {"digits": DIGITS}
    table = pd.concat(
        [logged(c, drawn.names, ~slides, rng, **digits), drawn.instrument.read(tool, rng)], axis=1
    )
    if under is not None:
        table = under.clocked(table)
    document, files = _document(drawn, form, rng)
    kinds = {n: "prismatic" if s else "revolute" for n, s in zip(drawn.names, slides, strict=True)}
    rows = [dict(zip(("a", "alpha", "d", "theta"), map(float, row), strict=True)) for row in sheet.rows]
    told = tuple(rows) if form == "serial" and sheet.rest == (0.0, 0.0) else ()
    return Pair(f"{family} {form} {sensor}", document, table, kinds, files, told, physics.none, tool)


def _drawing(sheet: Sheet, sensor: str, rng: np.random.Generator, unknown: bool) -> Drawing:
    n = len(sheet.rows)
    pattern = str(rng.choice(NAMES))
    far = np.round(
        [*(sheet.reach * rng.uniform(1.0, 2.2, 2) * rng.choice([-1, 1], 2)), *rng.uniform(-400, 400, 1)]
    )
    facing = np.round([*rng.uniform(-8, 8, 2), rng.uniform(-170, 170)], 1)
    side = rng.uniform(25, 80, 2) * rng.choice([-1, 1], 2)
    hand = np.round([*side, rng.uniform(60, 220)], 1)
    held = (
        np.round([*rng.uniform(-40, 40, 2), rng.uniform(-90, 90)], 0) if rng.random() < 0.5 else np.zeros(3)
    )
    wide = (np.inf, np.inf)
    return Drawing(
        sheet,
        [pattern.format(k + 1) for k in range(n)],
        (far, facing),
        (hand, held),
        wide if unknown else (float(rng.choice([2.0, 5.0])), float(rng.choice([0.3, 1.0]))),
        (np.inf, 0.5) if unknown else (1.0, 0.5),
        float(rng.choice([0.1, 0.2, 0.4])),
        float(rng.choice([0.02, 0.05])),
        instrument(sensor, rng, sheet.reach),
        _bodies(sheet, rng),
        rng.choice(RATIOS, n).astype(float),
        bool(rng.random() < 0.5),
    )


def _under(drawn: Drawing, under: Conditions) -> Drawing:
    """Return the drawing with the noise and tolerances of the conditions."""
    return replace(
        drawn,
        length=under.tolerance,
        angle=under.angle(drawn.sheet.reach),
        instrument=drawn.instrument.with_sigma(under.sigma),
        base_tolerance=under.stood(drawn.base_tolerance),
        tool_tolerance=under.stood(drawn.tool_tolerance),
    )


def _bodies(sheet: Sheet, rng: np.random.Generator) -> tuple[Body, ...]:
    n = len(sheet.rows)
    heavy = 30.0 * (sheet.reach / 1000.0) ** 2
    out = [
        Body(k + 1, float(np.round(heavy / (k + 1), 1)), np.round(rng.uniform(-80, 80, 3))) for k in range(n)
    ]
    return (*out, Body(n + 1, float("nan"), np.round(rng.uniform(-30, 60, 3))))


def _specimen(drawn: Drawing, rng: np.random.Generator) -> Arm:
    """Built within tolerances; an unknown mount stands anywhere."""
    rows = drawn.sheet.modified
    slips = np.array([0.0, drawn.angle, drawn.length, drawn.angle, drawn.length])
    built = rows + slips * rng.standard_normal(rows.shape)
    built[:, [0, 1, 3]] = np.radians(built[:, [0, 1, 3]])
    mounts = []
    for (xyz, rpy), (length, angle) in zip(
        (drawn.base, drawn.tool), (drawn.base_tolerance, drawn.tool_tolerance), strict=True
    ):
        off = 150.0 if np.isinf(length) else length
        turned = 40.0 if np.isinf(angle) else angle
        at = xyz + off * rng.standard_normal(3)
        mounts.append(frame(at, np.radians(rpy + turned * rng.standard_normal(3))))
    return Arm(built, np.array(drawn.sheet.slides), mounts[0], mounts[1], drawn.bodies)


def _physics(drawn: Drawing, rng: np.random.Generator, effects: int) -> Physics:
    """``effects`` of four kinds at drawn joints."""
    n, slides = len(drawn.sheet.rows), np.array(drawn.sheet.slides)
    compliance, play, wave = np.zeros(n), np.zeros(n), np.zeros(n)
    chosen = set(rng.permutation(4)[:effects].tolist())
    if 0 in chosen:
        turning = np.flatnonzero(~slides)
        compliance[turning] = rng.uniform(0, 1.5e-6, len(turning))
    if 1 in chosen:
        play[int(rng.integers(n))] = rng.uniform(1e-4, 4e-4)
    if 2 in chosen:
        wave[int(rng.integers(n))] = rng.uniform(5e-5, 3e-4)
    unit = np.where(slides, 200.0, 1.0)  # mm for a slide
    ratio = np.where(slides, 2 * np.pi / 5.0, drawn.ratios)
    return Physics(compliance, unit * play, unit * wave, ratio, 3 in chosen)


def _document(drawn: Drawing, form: str, rng: np.random.Generator) -> tuple[Document, dict[str, str]]:
    files: dict[str, str] = {}
    if form == "serial":
        mechanism: dict[str, Any] = {"type": "serial", "joints": _joints(drawn)}
    elif form == "graph":
        mechanism = graph_section(drawn.sheet, drawn.names, rng)
    else:
        files["arm.urdf"] = urdf_text(drawn.sheet, drawn.names, rng)
        last = f"link{len(drawn.names)}"
        mechanism = {"type": "urdf", "file": "arm.urdf", "base_link": "base", "tip_link": last}
    document: Document = {
        "schema": "truepose/machine/1",
        "name": "machine",
        "units": {"length": "mm", "angle": "deg"},
        "gravity": list(GRAVITY),
        "mechanism": mechanism,
        "frames": {
            "base": _mount("world", drawn.base, drawn.base_tolerance),
            "tool": _mount("flange", drawn.tool, drawn.tool_tolerance),
        },
        "sensor": drawn.instrument.section(),
        "tolerances": {"length": drawn.length, "angle": drawn.angle},
        "masses": _masses(drawn),
    }
    if rng.random() < 0.25 and form == "serial" and not drawn.bodies[0].kg > 40:
        del document["gravity"], document["masses"]  # nothing heavy was stated
    return document, files


def _joints(drawn: Drawing) -> list[dict[str, Any]]:
    out = []
    for k, row in enumerate(drawn.sheet.modified):
        slides = drawn.sheet.slides[k]
        joint: dict[str, Any] = {"name": drawn.names[k], "kind": "prismatic" if slides else "revolute"}
        joint |= dict(zip(FIELDS, map(float, row), strict=True))
        if drawn.ranges:
            joint["range"] = [float(v) for v in drawn.sheet.ranges[k]]
        if not slides:
            joint["gear_ratio"] = float(drawn.ratios[k])
        out.append(joint)
    return out


def _mount(inside: str, at: tuple[Array, Array], tolerance: tuple[float, float]) -> dict[str, Any]:
    held = {"xyz": tolerance[0], "rpy": tolerance[1]}
    return {"in": inside, "xyz": at[0].tolist(), "rpy": at[1].tolist(), "tolerance": held}


def _masses(drawn: Drawing) -> dict[str, Any]:
    n, out = len(drawn.names), {}
    for body in drawn.bodies:
        name = "payload" if np.isnan(body.kg) else f"link{body.link}"
        kg = 0.0 if np.isnan(body.kg) else body.kg
        out[name] = {
            "kg": kg,
            "com": body.com.tolist(),
            "in": "tool" if body.link > n else f"link{body.link}",
        }
    return out


def forms(family: str) -> Sequence[str]:
    """Mechanism forms that a family is written in."""
    return (
        ("serial",)
        if family in ("scara", "gantry", "spherical-slide", "cartesian")
        else ("serial", "graph", "urdf")
    )
