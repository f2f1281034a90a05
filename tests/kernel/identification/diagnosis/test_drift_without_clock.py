"""What a diagnosis owes recordings without a clock: drift in the order of rows, and no drift in the place of physics.

Recordings come from ``support.drifting_arm``, a forward model in numpy apart from the library's.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from support.drifting_arm import (
    JOINTS,
    SIGMA,
    TURN_SIGMA,
    built,
    machine_text,
    tool_pose,
)
from support.examples import by_day
from support.simulated import machine_from
from truepose.api import diagnose, predict
from truepose.arrays import Array
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import unheard
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

N = 80
Moves = Callable[[dict[str, float], Array, float], None]
"""Changes constants and true joint angles (rad) at a share of the way through the recording."""


def arm(folder: Path) -> Machine:
    return machine_from(folder, machine_text(), "arm")


def recorded(moves: Moves, order: str = "random", seed: int = 5, n: int = N) -> pd.DataFrame:
    """Rows in the order of acquisition, no clock; ``raster``: the second joint goes up in eight steps, once."""
    rng = np.random.default_rng(seed)
    p, q = built(rng), np.radians(rng.uniform(-110, 110, (n, len(JOINTS))))
    if order == "raster":
        q[:, 1] = np.radians(np.repeat(np.linspace(-110, 110, 8), -(-n // 8))[:n])
    rows = []
    for k in range(n):
        here, joints = dict(p), q[k].copy()
        moves(here, joints, k / (n - 1))
        pose = tool_pose(here, joints)
        turn, place = np.radians(TURN_SIGMA) * rng.standard_normal(3), SIGMA * rng.standard_normal(3)
        seen = Rotation.from_matrix(pose[:3, :3]) * Rotation.from_euler("XYZ", turn)
        rows.append([*np.degrees(q[k]), *(pose[:3, 3] + place), *np.degrees(seen.as_rotvec())])
    return pd.DataFrame(rows, columns=[*JOINTS, "x", "y", "z", "rx", "ry", "rz"])


def base_drifts(p: dict[str, float], q: Array, share: float) -> None:
    p["base.x"] += 0.3 * share


def zero_drifts(p: dict[str, float], q: Array, share: float) -> None:
    p["q3.theta"] = p.get("q3.theta", 0.0) + 1e-3 * share


def scaled(p: dict[str, float], q: Array, share: float) -> None:
    q[1] *= 1.0 + 2e-3


def uneven(p: dict[str, float], q: Array, share: float) -> None:
    q[1] += 1e-3 * np.sin(3.0 * q[1])


def named(found: Diagnosis) -> set[tuple[str, tuple[str, ...]]]:
    return {(f.effect, f.place) for f in found.findings}


@pytest.fixture(scope="module")
def drifting(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """Of an arm whose base drifts, with poses in random order."""
    return diagnose(arm(tmp_path_factory.mktemp("drifting")), recorded(base_drifts))


@pytest.mark.parametrize("order", by_day(["random", "raster"], "random"))
def test_a_base_that_drifts_is_named_without_a_clock(tmp_path: Path, drifting: Diagnosis, order: str) -> None:
    found = drifting if order == "random" else diagnose(arm(tmp_path), recorded(base_drifts, order))
    assert named(found) == {("mount-drift", ("base",))}
    (one,) = found.findings
    assert one.probability > 0.9
    assert one.levels.kind == "time"
    told = one.parameters["x"]
    assert told.unit == "mm"
    assert told.value == pytest.approx(0.3, abs=4 * told.std)  # up to the last row
    assert 0.8 < found.fits["after"].chi2_per_dof < 1.25


def test_a_zero_that_drifts_is_known_by_joint_and_driver(tmp_path: Path) -> None:
    """No effect of the catalogue is a zero that creeps; its place and its driver are said all the same."""
    found = diagnose(arm(tmp_path), recorded(zero_drifts))
    (one,) = found.findings
    assert (one.effect, one.place, one.levels.kind) == ("empirical", ("q3",), "time")
    assert one.levels.driver > 0.9
    assert found.remainder is not None
    assert found.remainder.driver == "row"


@pytest.mark.nightly
@pytest.mark.parametrize(("moves", "effect"), [(scaled, "actuator-scale"), (uneven, "transmission-error")])
def test_physics_of_a_joint_swept_once_is_no_drift(tmp_path: Path, moves: Moves, effect: str) -> None:
    """The joint's reading and the order of rows go together; base, tool and other joints are what tell them apart."""
    found = diagnose(arm(tmp_path), recorded(moves, "raster"))
    assert named(found) == {(effect, ("q2",))}
    assert found.findings[0].levels.driver > 0.9


def test_nothing_that_moves_gives_no_drift(tmp_path: Path) -> None:
    found = diagnose(arm(tmp_path), recorded(lambda p, q, share: None, "raster"))
    assert found.verdict == "adequate"
    assert not found.findings


def test_a_later_recording_is_predicted_where_the_drift_ended(tmp_path: Path, drifting: Diagnosis) -> None:
    table = recorded(base_drifts)
    write_calibrated(tmp_path / "improved.yaml", drifting.after, drifting.recording)
    improved = load_machine(tmp_path / "improved.yaml")
    off = predict(improved, table)["x"].to_numpy() - table["x"].to_numpy()
    assert np.std(off) < 1.3 * SIGMA  # the fitted rows themselves, drift and all
    later = recorded(lambda p, q, share: base_drifts(p, q, 1.0), n=50)
    # the same arm, since built() draws first; it stands where the drift left it
    off = predict(improved, later)["x"].to_numpy() - later["x"].to_numpy()
    assert np.sqrt(np.mean(off**2)) < 2.0 * SIGMA
    assert any(
        "as it was at their end" in note for note in unheard(improved, load_recording(improved, later))
    )


def test_places_in_order_begin_anew_with_each_session_and_yield_to_a_clock(tmp_path: Path) -> None:
    machine = arm(tmp_path)
    table = recorded(lambda p, q, share: None, n=6).assign(session=[1, 1, 1, 1, 2, 2])
    rows = load_recording(machine, table)
    place = rows.driver("row")
    assert place is not None
    assert place.tolist() == [-3, -2, -1, 0, -3, -2]
    part = rows.subset([5, 0]).driver("row")
    assert part is not None
    assert part.tolist() == [-2, -3]
    assert load_recording(machine, table.assign(time=range(6))).driver("row") is None
