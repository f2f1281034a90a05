"""Drawings of effects that geometry shows best: sketches of the part, as drawn and as it really is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from catalogue_canvas import DRAWN, ERROR, REAL, Canvas, Point, fitted
from catalogue_law import law

SKETCHES: Final[dict[str, Callable[[Canvas], None]]] = {}


def sketched(slug: str) -> Callable[[Callable[[Canvas], None]], Callable[[Canvas], None]]:
    """Register a drawing."""

    def add(draw: Callable[[Canvas], None]) -> Callable[[Canvas], None]:
        SKETCHES[slug] = draw
        return draw

    return add


@sketched("axis-coupling")
def _axis_coupling(paper: Canvas) -> None:
    for x, r, teeth, colour in ((52.0, 24.0, 16, DRAWN), (104.0, 24.0, 16, REAL)):
        turn = np.linspace(0, 2 * np.pi, 8 * teeth + 1)
        radius = r + 2.4 * np.sign(np.sin(teeth * turn + (np.pi if colour == REAL else 0.0)))
        paper.line(
            *zip(x + radius * np.cos(turn), 46 + radius * np.sin(turn), strict=True), colour=colour, width=1.1
        )
        paper.dot(x, 46, colour)
    paper.arc(52, 46, 14, (200, 340), DRAWN)
    paper.arc(104, 46, 14, (340, 200))
    paper.text(52, 88, "driving")
    paper.text(104, 88, "driven", ERROR)


@sketched("axis-straightness")
def _axis_straightness(paper: Canvas) -> None:
    t = np.linspace(-1, 1, 60)
    aside = law(
        "axis-straightness",
        "x",
        {"y2": 12.0, "y3": 14.0},
        {"x": t},
        settings={"degree": 3.0},
        port="x.motion.y",
    )
    rail = [(80 + 68 * float(a), 52 - float(b)) for a, b in zip(t, aside, strict=True)]
    paper.line((12, 52), (148, 52), colour=DRAWN, dashed=True)
    paper.line(*rail)
    at, slope = rail[50], np.arctan2(rail[51][1] - rail[49][1], rail[51][0] - rail[49][0])
    _block(paper, at, float(slope), 26, 14)
    paper.arrow((at[0], 52), (at[0], at[1] + 2))


@sketched("axis-wobble")
def _axis_wobble(paper: Canvas) -> None:
    paper.line((80, 84), (80, 8), colour=DRAWN, dashed=True)
    paper.box(62, 62, 36, 18)
    paper.line((80, 70), (96, 14))
    ring = np.linspace(0, 2 * np.pi, 50)
    paper.line(*zip(80 + 16 * np.cos(ring), 16 + 5 * np.sin(ring), strict=True), colour=ERROR, width=1.2)
    paper.dot(96, 16, ERROR)
    paper.arc(80, 70, 42, (272, 284))


@sketched("flexure-shift")
def _flexure_shift(paper: Canvas) -> None:
    paper.hatch(50, 110, 80)
    paper.line((80, 80), (80, 8), colour=DRAWN, dashed=True)
    way = np.linspace(0, 1, 30)
    bent = [(80 + 14 * float(s) ** 2, 80 - 34 * float(s)) for s in way]
    paper.line(*bent, width=1.6)
    paper.line(bent[-1], (bent[-1][0] + 26, bent[-1][1] - 36), width=4)
    paper.dot(80, 62, DRAWN)
    paper.dot(84, 63, ERROR)
    paper.arrow((96, 63), (87, 63))


@sketched("frame-shift")
def _frame_shift(paper: Canvas) -> None:
    _triad(paper, (52, 66), 0.0, DRAWN, dashed=True)
    _triad(paper, (96, 58), -0.22, REAL)
    paper.arrow((58, 62), (88, 56))
    paper.text(52, 84, "session 1")
    paper.text(112, 84, "session 2", REAL)


@sketched("gravity-sag")
def _gravity_sag(paper: Canvas) -> None:
    paper.hatch(20, 140, 82)
    for x in (46.0, 74.0):
        _spring(paper, (x, 82), (x, 70 if x < 60 else 74), 4)
    paper.line((60, 70), (60, 24), (128, 24), colour=DRAWN, dashed=True)
    paper.line((40, 69), (80, 74))
    paper.line((60, 71), (66, 25), (132, 34))
    paper.arrow((132, 36), (132, 58), DRAWN)
    paper.arc(60, 71, 36, (270, 279))


@sketched("axis-flexure")
def _axis_flexure(paper: Canvas) -> None:
    paper.line((30, 84), (78, 36), colour=DRAWN, width=2.4)
    paper.line((78, 36), (128, 6), colour=DRAWN, dashed=True)
    way = np.linspace(0, 1, 30)
    paper.line(*[(78 + 52 * float(s), 36 - 30 * float(s) + 14 * float(s) ** 2) for s in way])
    paper.arrow((130, 24), (130, 46), DRAWN)
    paper.arc(78, 36, 44, (329, 342))


@sketched("joint-compliance")
def _joint_compliance(paper: Canvas) -> None:
    paper.line((14, 20), (14, 70), colour=DRAWN, width=2.4)
    paper.line((14, 45), (40, 45), colour=DRAWN, width=1.6)
    paper.circle(46, 45, 6, DRAWN)
    turn = np.linspace(0, 5 * np.pi, 80)
    paper.line(
        *zip(46 + turn * 0.8 * np.cos(turn), 45 + turn * 0.8 * np.sin(turn), strict=True),
        colour=ERROR,
        width=1,
    )
    paper.line((60, 45), (140, 45), colour=DRAWN, dashed=True)
    paper.line((59, 48), (138, 66))
    paper.arrow((138, 66), (138, 86), DRAWN)
    paper.arc(46, 45, 66, (1, 12))


@sketched("joint-runout")
def _joint_runout(paper: Canvas) -> None:
    paper.circle(62, 58, 24, DRAWN)
    paper.circle(62, 58, 8, ERROR)
    paper.dot(62, 58, DRAWN)
    for angle, colour in ((-0.9, REAL), (0.1, DRAWN)):
        c = (62 + 8 * np.cos(angle), 58 + 8 * np.sin(angle))
        paper.line(
            c, (c[0] + 56 * np.cos(angle), c[1] + 56 * np.sin(angle)), colour=colour, dashed=colour == DRAWN
        )
        paper.dot(*c, colour=ERROR)
    paper.arc(62, 58, 46, (4, -46), DRAWN)


@sketched("leg-compliance")
def _leg_compliance(paper: Canvas) -> None:
    paper.hatch(50, 110, 82)
    paper.line((52, 16), (108, 16), colour=DRAWN, dashed=True)
    paper.line((52, 24), (108, 24))
    paper.line((80, 82), (80, 66))
    _spring(paper, (80, 66), (80, 40), 7)
    paper.line((80, 40), (80, 24))
    paper.arrow((80, 4), (80, 20), DRAWN)
    paper.text(88, 10, "F", anchor="start")
    paper.arrow((118, 15), (118, 25))


@sketched("link-bending")
def _link_bending(paper: Canvas) -> None:
    paper.line((14, 14), (14, 60), colour=DRAWN, width=2.4)
    paper.line((14, 34), (140, 34), colour=DRAWN, dashed=True)
    s = np.linspace(0, 1, 40)
    bent = 28 * s**2 * (3 - s) / 2  # a cantilever under a weight at its end
    paper.line(*zip(14 + 124 * s, 34 + bent, strict=True), width=2.2)
    paper.arrow((138, 63), (138, 84), DRAWN)
    paper.arrow((146, 34), (146, 61), both=True)


@sketched("platform-deformation")
def _platform_deformation(paper: Canvas) -> None:
    paper.hatch(14, 146, 80)
    paper.line((24, 28), (136, 28), colour=DRAWN, dashed=True)
    s = np.linspace(-1, 1, 40)
    paper.line(*zip(80 + 56 * s, 28 + 12 * s**2 - 8 * s**3, strict=True), width=2.4)
    for x, end, top in ((40.0, 30.0, 46.0), (80.0, 80.0, 28.0), (122.0, 130.0, 31.0)):
        paper.line((x, 80), (end, top), colour=DRAWN)
    paper.arrow((30, 29), (30, 42))


@sketched("screw-windup")
def _screw_windup(paper: Canvas) -> None:
    paper.box(8, 30, 12, 30)
    x = np.arange(20, 104, 4.0)
    paper.line(*zip(x, 45 + 6 * (-1.0) ** np.arange(len(x)), strict=True), colour=DRAWN, width=1.1)
    paper.line((20, 39), (112, 39), colour=DRAWN, width=0.9)
    paper.line((20, 51), (112, 51), colour=DRAWN, width=0.9)
    paper.box(96, 32, 20, 26, dashed=True)
    paper.box(104, 32, 20, 26, REAL)
    paper.arrow((126, 45), (150, 45), DRAWN)
    paper.text(150, 40, "F", anchor="end")
    paper.arrow((96, 66), (104, 66))
    paper.arrow((20, 76), (96, 76), DRAWN, both=True)
    paper.text(58, 87, "s")


@sketched("sensor-scale")
def _sensor_scale(paper: Canvas) -> None:
    for y, step, colour in ((18.0, 12.0, DRAWN), (50.0, 13.4, REAL)):
        paper.box(10, y, 136, 20, colour)
        for k in range(1, 11):
            paper.line(
                (10 + k * step, y), (10 + k * step, y + (10 if k % 5 else 15)), colour=colour, width=1.1
            )
    paper.line((130, 38), (130, 50), colour=ERROR, width=1, dashed=True)
    paper.arrow((130, 78), (144, 78))


@sketched("target-offset")
def _target_offset(paper: Canvas) -> None:
    paper.line((44, 48), (44, 80), (116, 80), (116, 48), colour=DRAWN)
    paper.circle(80, 46, 30, DRAWN, dashed=True)
    paper.circle(87, 40, 30, REAL)
    paper.dot(80, 46, DRAWN)
    paper.dot(87, 40, REAL)
    paper.arrow((80, 46), (87, 40))


@sketched("thermal-expansion")
def _thermal_expansion(paper: Canvas) -> None:
    paper.line((12, 34), (12, 74), colour=DRAWN, width=2.4)
    paper.box(12, 46, 108, 16, dashed=True)
    paper.box(12, 43, 126, 22, REAL)
    paper.arrow((120, 76), (138, 76))
    paper.circle(30, 28, 4, ERROR)
    paper.line((30, 24), (30, 8), colour=ERROR, width=2)
    for x in (52.0, 76.0, 100.0):
        wave = np.linspace(0, 1, 20)
        paper.line(
            *zip(x + 2.5 * np.sin(2 * np.pi * wave), 38 - 26 * wave, strict=True), colour=ERROR, width=1
        )


@sketched("wrong-constant")
def _wrong_constant(paper: Canvas) -> None:
    for x, colour in ((96.0, DRAWN), (132.0, REAL)):
        paper.line((24, 44), (x, 44), colour=colour, dashed=colour == DRAWN)
        paper.circle(x, 44, 6, colour)
    paper.circle(24, 44, 6, DRAWN)
    paper.arrow((24, 20), (96, 20), DRAWN, both=True)
    paper.text(60, 15, "drawing")
    paper.arrow((24, 70), (132, 70), ERROR, both=True)
    paper.text(78, 84, "machine", ERROR)


@sketched("dress-pack")
def _dress_pack(paper: Canvas) -> None:
    q = np.linspace(-np.pi, np.pi, 60)
    paper.axes("one joint, the other in two places", "pull of the hose", zero=45)
    for other, colour in ((0.0, ERROR), (1.2, DRAWN)):
        pull = np.sin(q - other)
        paper.line(*fitted(q, pull), colour=colour)


@sketched("rocking-mount")
def _rocking_mount(paper: Canvas) -> None:
    moment = np.linspace(0, 1, 60)
    paper.axes("moment on the mount", "tilt")
    paper.line(*fitted(moment, np.maximum(moment - 0.5, 0.0)), colour=ERROR)


def _block(paper: Canvas, at: Point, turn: float, width: float, height: float) -> None:
    """A block that sits on a rail."""
    c, s = np.cos(turn), np.sin(turn)
    corners = ((-width / 2, 0), (width / 2, 0), (width / 2, -height), (-width / 2, -height))
    paper.line(*((at[0] + c * x - s * y, at[1] + s * x + c * y) for x, y in corners), closed=True)


def _triad(paper: Canvas, at: Point, turn: float, colour: str, *, dashed: bool = False) -> None:
    for angle in (turn, turn - np.pi / 2):
        end = (at[0] + 42 * np.cos(angle), at[1] + 42 * np.sin(angle))
        paper.line(at, end, colour=colour, dashed=dashed, width=1.8)
    paper.dot(*at, colour=colour)


def _spring(paper: Canvas, start: Point, end: Point, half: float) -> None:
    """A zigzag between two points, one above the other."""
    y = np.linspace(start[1], end[1], 8)
    x = start[0] + half * np.array([0, 1, -1, 1, -1, 1, -1, 0])
    paper.line(*zip(x.tolist(), y.tolist(), strict=True), colour=ERROR, width=1.3)
