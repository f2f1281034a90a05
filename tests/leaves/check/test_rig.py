"""The cheap fit of base and tool: where they stand, by which rows, how far off they are; its misfit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.checked_arm import EXACT, Document, document, rig_of
from truepose.arrays import Array, Index
from truepose.identification.leaves.check.pair import MOST_ROWS, chosen
from truepose.identification.leaves.check.rig import KEPT, FrameFit, Rig, motion
from truepose.identification.leaves.check.weighing import departures
from truepose.identification.prediction.predictor import Predictor
from truepose.models.machine.machine import FRAMES


def moved(frame: str, xyz: tuple[float, ...], rpy: tuple[float, ...], machine: Document) -> Document:
    own = machine["frames"][frame]
    own["xyz"] = [a + b for a, b in zip(own["xyz"], xyz, strict=True)]
    own["rpy"] = [a + b for a, b in zip(own["rpy"], rpy, strict=True)]
    return machine


@pytest.mark.parametrize("kind", ["pose", "position"])
def test_frames_are_found_wherever_they_are(kind: str, tmp_path: Path) -> None:
    sensor = EXACT if kind == "pose" else {"type": "position", "sigma": {"xyz": 0.03}}
    far = moved("base", (300.0, -50.0, 80.0), (0.0, 10.0, 160.0), document(sensor=sensor))
    far = moved("tool", (20.0, 5.0, -10.0), (0.0, 0.0, 40.0) if kind == "pose" else (0.0,) * 3, far)
    rig = rig_of(tmp_path, document(sensor=sensor), far)
    there = rig.stand()
    assert there.misfit < 0.02 and there.length is not None and there.length < 1e-3
    wanted = rig_of(tmp_path, far)
    for found, true in zip(rig.frames_of(there.p), wanted.frames_of(wanted.scene.p), strict=True):
        np.testing.assert_allclose(found[:3, 3], true[:3, 3], atol=1e-2)
    np.testing.assert_allclose(there.p[rig.places[-1] + 1 :], rig.scene.p[rig.places[-1] + 1 :])
    others = np.setdiff1d(np.arange(len(rig.names)), [*rig.at["base"], *rig.at["tool"]])
    np.testing.assert_array_equal(there.p[others], rig.scene.p[others])
    quick = rig.stand(quick=True)
    assert quick.misfit >= there.misfit - 1e-9 and quick.misfit < 1.0


@pytest.mark.parametrize("pitch", [-1.0, 80.0, 100.0, 200.0])
def test_angles_of_a_frame_are_those_next_to_the_stated_ones(pitch: float, tmp_path: Path) -> None:
    machine = document(sensor=EXACT)
    machine["frames"]["base"]["rpy"] = [190.0, pitch, 400.0]
    rig = rig_of(tmp_path, machine)
    again = rig.with_frames(rig.scene.p, rig.frames_of(rig.scene.p))
    np.testing.assert_allclose(again, rig.scene.p, atol=1e-9)


def test_the_motion_is_the_spread_of_the_readings_in_sigmas(tmp_path: Path) -> None:
    rig = rig_of(tmp_path, document(sensor=EXACT))
    seen = rig.scene.rows.observations
    sigma = [0.03] * 3 + [np.radians(0.005)] * 3
    parts = [np.std(seen[n]) / s for n, s in zip(("x", "y", "z", "rx", "ry", "rz"), sigma, strict=True)]
    stand = rig.stand()
    assert motion(rig, stand) == pytest.approx(np.sqrt(np.mean(np.square(parts))), rel=1e-9)
    larger = rig.stand(rig.scene.with_columns({n: 10.0 * seen[n] for n in "xyz"}, 10.0))
    parts[:3] = [10.0 * v for v in parts[:3]]
    assert motion(rig, larger) == pytest.approx(np.sqrt(np.mean(np.square(parts))), rel=1e-9)


def test_rows_to_judge_by_are_spread_over_the_recording(tmp_path: Path) -> None:
    rig = rig_of(tmp_path, document(sensor=EXACT), rows=200)
    rows = chosen(rig.machine, rig.scene)
    assert len(rows) == MOST_ROWS and rows[0] == 0 and rows[-1] == 199
    assert np.ptp(np.diff(rows)) <= 1
    lost = np.arange(200) >= 20
    few = chosen(rig.machine, replace(rig.scene, lost=lost))
    assert few.tolist() == list(range(20))
    held = replace(rig.scene.rows, validation=np.arange(200) % 2 == 0)
    assert (chosen(rig.machine, replace(rig.scene, rows=held)) % 2 == 1).all()
    none = rig.stand(replace(rig.scene, lost=np.ones(200, dtype=bool)))
    assert none.bad and none.length is None and len(none.rows) == 0


POINTS = {"P1": [0.0, 30.0, 0.0], "P2": [10.0, -30.0, 5.0], "P3": [80.0, 0.0, 20.0]}
SENSORS: dict[str, Any] = {
    "pose": EXACT,
    "position": {"type": "position", "sigma": {"xyz": 0.03}},
    "targets": {"type": "targets", "points": POINTS, "sigma": {"xyz": 0.03}},
}


def machine(kind: str) -> Document:
    out = document(sensor=SENSORS[kind])
    out["frames"]["base"]["rpy"], out["frames"]["tool"]["rpy"] = [20.0, -40.0, 70.0], [50.0, 35.0, -80.0]
    return out


def fit_of(rig: Rig) -> tuple[FrameFit, Index]:
    rows = chosen(rig.machine, rig.scene)
    here = rig.predictor.over(rig.scene.rows.subset(rows))
    bare = rig.scene.p.copy()
    bare[np.concatenate([rig.at["base"], rig.at["tool"]])] = 0.0
    x, good = rig.assembled(here, bare, rig.scene)
    return FrameFit(rig, rig.tolerance, here, here.poses(bare, x)[0], good, rig.scene), rows


def off(rig: Rig, seed: int, mm: float, rad: float) -> Array:
    """Constants with base and tool somewhere beside where they are."""
    rng, p = np.random.default_rng(seed), rig.scene.p.copy()
    for frame in ("base", "tool"):
        p[rig.at[frame][:3]] += mm * rng.uniform(-1, 1, 3)
        p[rig.at[frame][3:]] += rad * rng.uniform(-1, 1, 3)
    return p


def trimmed(each: Array, part: float, up: bool) -> float:
    """Rms over the part of all that is least, counted up or down."""
    count = int(np.ceil(part * len(each)) if up else part * len(each))
    return float(np.sqrt(np.mean(np.sort(each)[:count] ** 2)))


@pytest.mark.parametrize("kind", list(SENSORS))
def test_the_misfit_is_that_of_the_whole_model(kind: str, tmp_path: Path) -> None:
    rig = rig_of(tmp_path, machine(kind), rows=13)
    fit, rows = fit_of(rig)
    p = off(rig, 1, 4.0, 0.02)
    whole = Predictor(rig.machine, rig.recording)
    residual = np.concatenate([block.residual for block in whole.blocks(p, whole.assemble(p)[0])])
    sizes = np.sqrt(np.mean(residual**2, axis=1))
    assert KEPT == 0.8 and len(rows) == 13
    assert fit.cost(*rig.frames_of(p), p) == pytest.approx(trimmed(sizes, 0.8, up=True), rel=1e-9)
    there = fit.descended(p, ("base", "tool"), rows, 0)
    assert there.misfit == pytest.approx(trimmed(sizes, 0.8, up=True), rel=1e-9)
    np.testing.assert_allclose(there.residual, residual, rtol=1e-7, atol=1e-7)
    np.testing.assert_array_equal(there.p, p)
    # the error of a point in space: each is three columns
    places = residual[:, : 9 if kind == "targets" else 3] * 0.03
    away = np.sqrt(np.sum(places**2, axis=1) / (3 if kind == "targets" else 1))
    assert there.length == pytest.approx(trimmed(away, 0.8, up=False), rel=1e-9)


@pytest.mark.parametrize("kind", list(SENSORS))
@pytest.mark.parametrize("joint", [0, 2, 4])
def test_what_is_known_bends_for_no_misfit_that_it_cannot_explain(
    joint: int, kind: str, tmp_path: Path
) -> None:
    """Of a joint that counts the other way: what readings gain, as a likelihood of noise that large, pays for the frames."""
    rig = rig_of(tmp_path, machine(kind))
    q = rig.scene.rows.q.copy()
    q[:, joint] *= -1.0
    scene = rig.scene.with_joints(q)
    drawn, found = rig.stand(scene, (), held=FRAMES), rig.stand(scene, ())
    gained = drawn.residual.size * np.log(drawn.misfit / found.misfit)
    assert found.misfit > 100.0
    assert np.sum(departures(rig, found, ()) ** 2) / 2.0 <= gained + 1e-9


@pytest.mark.parametrize("free", [("base",), ("tool",), ("base", "tool")])
@pytest.mark.parametrize("kind", ["pose", "targets"])
def test_steps_converge_by_squares(kind: str, free: tuple[str, ...], tmp_path: Path) -> None:
    """From a centimetre and 3 deg off, turned about all axes: within five steps nothing is left but damping's thousandth."""
    rig = rig_of(tmp_path, machine(kind))
    fit, rows = fit_of(rig)
    start = off(rig, 2, 10.0, 0.05)
    for frame in {"base", "tool"} - set(free):
        start[rig.at[frame]] = rig.scene.p[rig.at[frame]]
    begin = fit.descended(start, free, rows, 0).misfit
    left = [fit.descended(start, free, rows, steps).misfit / begin for steps in (1, 2, 3, 5)]
    assert left[0] < 0.1 and left[1] < 0.01 and left[2] < 1e-4 and left[3] < 1e-7
    end = fit.descended(start, free, rows, 8)
    np.testing.assert_allclose(end.p, rig.scene.p, atol=1e-6)
