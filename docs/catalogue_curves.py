"""Drawings of effects that a curve shows best: computed from the effect's own formula, on a small machine."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Final

import numpy as np

from catalogue_canvas import DRAWN, ERROR, FRAME, REAL, Array, Canvas, fitted
from catalogue_law import law
from truepose.identification.recording.history import (
    creep_sum,
    heat_of_motion,
    line_of_full_loop,
    stop_operator,
)

CURVES: Final[dict[str, Callable[[Canvas], None]]] = {}


def drawn(slug: str) -> Callable[[Callable[[Canvas], None]], Callable[[Canvas], None]]:
    """Register a drawing."""

    def add(draw: Callable[[Canvas], None]) -> Callable[[Canvas], None]:
        CURVES[slug] = draw
        return draw

    return add


@drawn("actuator-scale")
def _actuator_scale(paper: Canvas) -> None:
    q = np.linspace(0, 1, 2)
    real = q + law("actuator-scale", "x", {"s": 0.45}, {"x": q})
    paper.axes("reading", "position")
    paper.line(*fitted(q, q, over=real), colour=DRAWN, dashed=True)
    paper.line(*fitted(q, real))
    end, ideal = fitted(q, real)[-1], fitted(q, q, over=real)[-1]
    paper.arrow((ideal[0] - 2, ideal[1] - 1), (end[0] - 2, end[1] + 4))


@drawn("air-refraction")
def _air_refraction(paper: Canvas) -> None:
    warm = np.linspace(5, 35, 30)
    at = {"temperature.air": warm, "seen.P.x": np.full(30, 1.0), "pressure": np.full(30, 1013.25)}
    error = law("air-refraction", "sensor1", {"share": 1.0}, at, port="P.x.reading")
    zero = fitted(warm, np.zeros(30), over=error)[0][1]
    paper.axes("air, degC", "reading - length", zero=zero)
    paper.line(*fitted(warm, error), colour=ERROR)


@drawn("backlash")
def _backlash(paper: Canvas) -> None:
    q = np.linspace(0, 1, 2)
    there, back = (
        q + law("backlash", "x", {"b": 0.35}, {"x": q, "approach.x": np.full(2, side)})
        for side in (1.0, -1.0)
    )
    both = np.concatenate([there, back])
    up, down = fitted(q, there, over=both), fitted(q, back, over=both)
    paper.axes("reading", "position")
    paper.line(up[0], up[1], down[1], down[0], closed=True)
    middle = [tuple(np.mean(side, axis=0)) for side in (up, down)]
    paper.arrow((middle[0][0], middle[0][1] - 3), (middle[1][0], middle[1][1] + 3), both=True)
    paper.text(middle[0][0] + 8, (middle[0][1] + middle[1][1]) / 2 + 3, "b", ERROR)


@drawn("counterbalance")
def _counterbalance(paper: Canvas) -> None:
    q = np.linspace(0, 2 * np.pi, 60)
    error = law("counterbalance", "q", {"c": 1.0}, {"q": q}, settings={"angle": 0.0, "ratio": 0.6})
    paper.axes("reading", "twist of the joint", zero=45)
    paper.line(*fitted(q, error), colour=ERROR)


@drawn("early-reading")
def _early_reading(paper: Canvas) -> None:
    step = np.linspace(-1, 1, 41)
    steps = {"step.x": step, "step.q": np.full(41, 0.5)}
    share = law("early-reading", "x", {"f": 0.4}, steps, settings={"whole": 1.0})
    zero = fitted(step, np.zeros(41), over=share)[0][1]
    paper.axes("last motion", "short of the goal", zero=zero)
    paper.line(*fitted(step, -share), colour=ERROR)


@drawn("empirical")
def _empirical(paper: Canvas) -> None:
    q = np.linspace(-1, 1, 60)
    error = law(
        "empirical",
        "x",
        {"c2": 0.5, "c3": 1.0, "c4": -0.5},
        {"x": q},
        settings={"from.x": -1.0, "to.x": 1.0, "degree": 4.0},
    )
    paper.axes("any column", "error")
    ends = (16.0, 148.0, 74.0, 24.0)
    paper.line(*fitted(q, error, ends), colour=ERROR)
    scatter = np.random.default_rng(3).normal(0, 0.12, 60)
    for x, y in fitted(q, error + scatter, ends, over=error)[2::4]:
        paper.dot(x, y, DRAWN, 1.6)


@drawn("encoder-eccentricity")
def _encoder_eccentricity(paper: Canvas) -> None:
    paper.circle(36, 45, 26, DRAWN, dashed=True)
    paper.circle(41, 41, 26, REAL)
    paper.dot(36, 45, DRAWN)
    paper.dot(41, 41, REAL)
    q = np.linspace(0, 2 * np.pi, 60)
    error = law("encoder-eccentricity", "q", {"a": 1.0}, {"q": q}, settings={"order": 1.0})
    paper.line((76, 45), (156, 45), colour=DRAWN, width=0.9)
    paper.line(*fitted(q, error, (80, 150, 70, 20)), colour=ERROR)
    paper.text(154, 86, "one turn", anchor="end")


@drawn("friction-hysteresis")
def _friction_hysteresis(paper: Canvas) -> None:
    way = _zigzag(1.0, -1.0, 1.0, -0.45, 0.45)
    stop = stop_operator(way, np.zeros(len(way)), np.zeros(len(way), dtype=np.int64), 0.5)
    at = {"x": way, "stop.x~0.5": stop}
    real = way + law("friction-hysteresis", "x", {"h": 0.42}, at, settings={"width": 0.25})
    paper.axes("reading", "position")
    paper.line(*_loop(way, real))


@drawn("fringe-miscount")
def _fringe_miscount(paper: Canvas) -> None:
    rows = np.arange(11.0)
    heights = 66 - 3.2 * rows
    for k in range(4):
        paper.line((14, 76 - 20 * k), (152, 76 - 20 * k), colour=DRAWN, width=0.7, dashed=True)
    for k, (row, y) in enumerate(zip(rows, heights, strict=True)):
        lost = k == 6
        paper.dot(20 + 12 * row, y - 20 * lost, ERROR if lost else REAL)
    paper.arrow((92, heights[6] - 2), (92, heights[6] - 16))
    paper.text(86, heights[6] - 14, "λ/2", ERROR, anchor="end")


@drawn("latency")
def _latency(paper: Canvas) -> None:
    t = np.linspace(0, 2 * np.pi, 80)
    q = np.sin(t)
    late = q + law("latency", "sensor1", {"tau": 0.45}, {"velocity.x": np.cos(t)}, port="x.displacement")
    paper.axes("time", "joint", zero=FRAME[2])
    paper.line(*fitted(t, q, over=late), colour=DRAWN, dashed=True)
    paper.line(*fitted(t, late))
    paper.arrow((70, 44), (82, 44))
    paper.text(90, 41, "τ", ERROR)


@drawn("lens-distortion")
def _lens_distortion(paper: Canvas) -> None:
    steps = np.linspace(-1, 1, 25)
    for fixed in (-1.0, -0.5, 0.0, 0.5, 1.0):
        for flip in (False, True):
            x, y = (np.full(25, fixed), steps) if flip else (steps, np.full(25, fixed))
            at = {"seen.P.x": x * 0.6, "seen.P.y": y * 0.6, "seen.P.z": np.ones(25)}
            moved = [
                law("lens-distortion", "sensor1", {"k1": -0.45}, at, port=f"P.{axis}.reading") / 0.6
                for axis in "xy"
            ]
            seen = [(80 + 56 * a, 45 + 38 * b) for a, b in zip(x + moved[0], y + moved[1], strict=True)]
            paper.line(
                (80 + 56 * x[0], 45 + 38 * y[0]), (80 + 56 * x[-1], 45 + 38 * y[-1]), colour=DRAWN, width=0.7
            )
            paper.line(*seen, width=1.3)


@drawn("motor-heat")
def _motor_heat(paper: Canvas) -> None:
    t = np.linspace(0, 6000.0, 80)
    q = np.where(t < 2500.0, np.arange(80) % 2, 1.0).astype(float)
    heat = heat_of_motion(t, q, np.zeros(len(t), dtype=np.int64), 900.0)
    error = law("motor-heat", "x", {"c": 1.0}, {"x": q, "heat.x~900": heat}, settings={"lag": 900.0})
    paper.axes("time: at work, then at rest", "zero")
    paper.line(*fitted(t, error), colour=ERROR)


@drawn("mount-drift")
def _mount_drift(paper: Canvas) -> None:
    t = np.linspace(0, 7200, 60)
    steady, settling = (
        law("mount-drift", "base", {"x": size}, {"time": t}, settings={"tau": tau}, port="base.motion.x")
        for tau, size in ((0.0, 0.5), (1500.0, 0.8))
    )
    paper.axes("time", "mount")
    both = np.concatenate([steady, settling])
    paper.line(*fitted(t, steady, over=both), colour=ERROR)
    paper.line(*fitted(t, settling, over=both), colour=ERROR, dashed=True)


@drawn("outliers")
def _outliers(paper: Canvas) -> None:
    noise = np.random.default_rng(5).normal(0, 3.0, 16)
    paper.axes("row", "residual", zero=56)
    for k, height in enumerate(noise):
        paper.dot(24 + 8 * k, (18 if k == 10 else 56 - height), ERROR if k == 10 else REAL)


@drawn("piezo-creep")
def _piezo_creep(paper: Canvas) -> None:
    t = np.concatenate([[-20.0, -1e-3], np.geomspace(0.1, 100.0, 80)])
    q = np.where(t < 0, 0.0, 1.0)
    past = creep_sum(t, q, np.zeros(len(t), dtype=np.int64), 0.1)
    real = q + law("piezo-creep", "x", {"g": 0.15}, {"x": q, "creep.x~0.1": past}, settings={"t0": 0.1})
    paper.axes("time", "position")
    paper.line(*fitted(t, q, over=real), colour=DRAWN, dashed=True)
    paper.line(*fitted(t, real))


@drawn("piezo-hysteresis")
def _piezo_hysteresis(paper: Canvas) -> None:
    way = _zigzag(1.0, -1.0, 1.0, 0.0, 1.0)
    piece, none = np.zeros(len(way), dtype=np.int64), np.zeros(len(way))
    at = {"x": way}
    for half in (0.05, 0.15, 0.3, 0.6):
        at[f"loop.x~{half:g}~-1~1"] = stop_operator(way, none, piece, half) - line_of_full_loop(
            way, half, -1, 1
        )
    real = way + law("piezo-hysteresis", "x", {f"w{k}": 0.3 for k in (1, 2, 3, 4)}, at)
    paper.axes("command", "position")
    paper.line(*_loop(way, real))


@drawn("screw-growth")
def _screw_growth(paper: Canvas) -> None:
    x = np.linspace(0, 1, 2)
    paper.axes("reading, cold and warm", "error")
    cold, warm = (
        law(
            "screw-growth", "x", {"c": 1.0}, {"x": x, "heat.x~900": np.full(2, heat)}, settings={"lag": 900.0}
        )
        for heat in (0.2, 1.0)
    )
    for grown, colour in ((cold, DRAWN), (warm, ERROR)):
        paper.line(*fitted(x, grown, over=np.append(cold, warm)), colour=colour)


@drawn("screw-periodic")
def _screw_periodic(paper: Canvas) -> None:
    q = np.linspace(0, 2.5, 100)
    error = law("screw-periodic", "x", {"a": 1.0}, {"x": q}, settings={"harmonic": 1.0})
    paper.axes("travel", "error", zero=45)
    paper.line(*fitted(q, error, (16, 148, 68, 22)), colour=ERROR)
    paper.arrow((29, 82), (82, 82), DRAWN, both=True)
    paper.text(92, 85, "pitch", anchor="start")


@drawn("sensor-periodic")
def _sensor_periodic(paper: Canvas) -> None:
    length = np.linspace(0, 1.5, 120)
    error = law("sensor-periodic", "sensor2", {"a": 1.0}, {"seen.dL": length}, settings={"order": 1.0})
    paper.box(6, 12, 14, 16)
    paper.line((20, 20), (140, 20), colour=REAL, width=1.2)
    paper.line((140, 8), (140, 32), colour=DRAWN, width=2.4)
    paper.line(*fitted(length, error, (20, 140, 72, 46)), colour=ERROR)
    paper.arrow((30, 82), (70, 82), DRAWN, both=True)
    paper.text(76, 85, "λ/2", anchor="start")


@drawn("transmission-error")
def _transmission_error(paper: Canvas) -> None:
    q = np.linspace(0, 2 * np.pi, 240)
    error = law("transmission-error", "q", {"a": 1.0}, {"q": q}, settings={"order": 9.0})
    error += law("transmission-error", "q", {"b": 0.6}, {"q": q}, settings={"order": 2.0})
    paper.circle(80, 45, 32, DRAWN, dashed=True)
    radius = 32 + 4.5 * error
    paper.line(*zip(80 + radius * np.cos(q), 45 + radius * np.sin(q), strict=True), colour=ERROR)
    paper.line((80, 45), (108, 29), colour=REAL)
    paper.dot(80, 45, DRAWN)


@drawn("zero-shift")
def _zero_shift(paper: Canvas) -> None:
    session = np.array([0.0, 0.0, 1.0, 1.0])
    rows = np.array([0.0, 1.0, 1.0, 2.0])
    zero = law("zero-shift", "x", {"zero": 1.0}, {"session.after.1": session}, settings={"session": 1.0})
    paper.axes("session", "zero")
    paper.line((82, 78), (82, 12), colour=DRAWN, width=0.9, dashed=True)
    paper.line(*fitted(rows, zero, (22, 142, 64, 30)), colour=ERROR)


def _zigzag(*turns: float) -> Array:
    """A way from 0 through turning points in small steps."""
    corners = [0.0, *turns]
    parts = [np.linspace(a, b, 40) for a, b in itertools.pairwise(corners)]
    return np.concatenate(parts)


def _loop(way: Array, real: Array) -> list[tuple[float, float]]:
    """The way after the first stroke: what came before leaves no loop."""
    return fitted(way[40:], real[40:])
