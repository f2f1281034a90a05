"""The cheap fit of base and tool: its misfit is that of the whole model, and its steps are Gauss and Newton's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.checked_arm import EXACT, Document, document, rig_of
from truepose.arrays import Array, Index
from truepose.identification.leaves.check.pair import chosen
from truepose.identification.leaves.check.rig import KEPT, FrameFit, Rig
from truepose.identification.leaves.check.weighing import departures
from truepose.identification.prediction.predictor import Predictor
from truepose.models.machine.machine import FRAMES

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
