"""The cheap fit of base and tool: where they stand, which rows it looks at, and how far off they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.checked_arm import EXACT, Document, document, rig_of
from truepose.identification.leaves.check.pair import MOST_ROWS, chosen
from truepose.identification.leaves.check.rig import motion


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
