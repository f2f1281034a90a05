"""Laws of forms without a name that are driven by load: what they are beside the names, and a mount that tips is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from support.calibrated_machines import LOADED, SIX_AXES
from support.simulated import machine_from
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import covariance_of, write_calibrated
from truepose.identification.prediction.predict import predicted, predictor_for, simulate
from truepose.identification.prior import FORM_ERROR
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import empirical_forms
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

JOINTS = tuple(f"q{k}" for k in range(1, 7))
ENDS = 200.0
"""N m, at which the forms of these tests end; torques of the arm lie within."""
STANDING = (
    SIX_AXES.replace("rpy: [1, 2, 40]", "rpy: [0, 0, 40]").replace(
        "{type: pose, sigma: {xyz: 0.01, rot: 0.001}}", "{type: position, sigma: {xyz: 0.01}}"
    )
    + "gravity: [0, 0, -9.80665]\nmasses: {head: {kg: 20, com: [0, 0, 0], in: tool}}\n"
)
"""An arm whose only weight is at the point that is measured."""


def machine_of(folder: Path, text: str) -> Machine:
    return machine_from(folder, text, "arm")


def poses_of(machine: Machine, folder: Path, n: int = 90) -> Recording:
    """Random poses, every third of them for validation."""
    rng = np.random.default_rng(8)
    table = pd.DataFrame(rng.uniform(-1.0, 1.0, (n, 6)), columns=[f"{name} [rad]" for name in JOINTS])
    table["role"] = np.where(np.arange(n) % 3 == 0, "validation", "calibration")
    table.to_csv(folder / "poses.csv", index=False)
    return load_recording(machine, [folder / "poses.csv"], need_observations=False)


def test_what_carries_a_load_that_varies_has_forms_of_it(tmp_path: Path) -> None:
    """Joint 1 is vertical and carries none; without masses nothing does."""
    machine = machine_of(tmp_path, LOADED)
    recording = poses_of(machine, tmp_path)
    loaded = [f for f in empirical_forms(machine, recording) if f.needs_load]
    assert {f.kind for f in loaded} == {"load"}
    assert {f.place[0] for f in loaded} == {*JOINTS[1:], "base", "tool"}
    assert all(not f.drivers for f in loaded)
    assert [f.label for f in loaded if f.place == ("base",)] == [
        "empirical@base,load",
        "empirical@base,moment",
    ]
    bare = machine_of(tmp_path, SIX_AXES)
    assert not any(f.needs_load for f in empirical_forms(bare, recording))


@pytest.mark.parametrize(
    ("form", "name"),
    [
        ("empirical@q3:degree=1,c1=4e-4", "joint-compliance@q3:c=2e-6"),
        (
            "empirical@base:degree=1,rx1=2e-4,ry1=2e-4,rz1=2e-4",
            "gravity-sag@base:c=1e-6",
        ),
        (
            f"empirical@base:from.moment=0,to.moment={ENDS:g},degree=1,rx1=2e-4,ry1=2e-4,rz1=2e-4",
            "gravity-sag@base:c=1e-6",
        ),
        ("empirical@tool:degree=1,rx1=2e-3,ry1=2e-3,rz1=2e-3", "gravity-sag@tool:c=1e-5"),
    ],
)
def test_a_line_in_the_load_is_what_has_a_name(tmp_path: Path, form: str, name: str) -> None:
    """With ends at -200 and 200 N m, c1 T1(tau / 200 N m) = (c1 / 200 N m) tau; a mount's about every axis alike."""
    machine = replace(machine_of(tmp_path, LOADED), effects=())
    poses = poses_of(machine, tmp_path)
    over = f"from.load=-{ENDS:g},to.load={ENDS:g}," if "moment" not in form else ""
    own = parse_effect(form.replace(":", f":{over}"), machine)
    found, wanted = (simulate(machine, poses, [e], seed=None) for e in (own, parse_effect(name, machine)))
    moved = simulate(machine, poses, [], seed=None) - wanted
    assert float(np.abs(moved.to_numpy()).max()) > 1e-3
    np.testing.assert_allclose(found.to_numpy(), wanted.to_numpy(), atol=1e-9)


def test_beyond_its_range_a_curve_of_the_load_stays_where_it_ended(tmp_path: Path) -> None:
    """At -1 and 1 the polynomials T1, T2, T3 are -1, 1, -1 and 1, 1, 1: the joint is off by a constant on either side."""
    machine = replace(machine_of(tmp_path, LOADED), effects=())
    poses = poses_of(machine, tmp_path)
    form = "empirical@q2:from.load=-2e-6,to.load=-1e-6,degree=3,c1=1e-4,c2=2e-4,c3=3e-4"
    found = simulate(machine, poses, [parse_effect(form, machine)], seed=None)
    q2 = JOINTS.index("q2")
    sides = []
    for shift in (-2e-4, 6e-4):
        moved = poses.q.copy()
        moved[:, q2] += shift
        sides.append(simulate(machine, replace(poses, q=moved), [], seed=None))
    either = np.minimum(*(np.abs(found - side).max(axis=1) for side in sides))
    assert float(either.max()) < 1e-9


def test_beyond_what_was_seen_it_may_be_all_wrong(tmp_path: Path) -> None:
    """A curve of the load is as unsure as large there, where a compliance errs by a tenth; inside nothing is added."""
    machine = replace(machine_of(tmp_path, LOADED), effects=())
    poses = poses_of(machine, tmp_path)
    added = {}
    for text in ("empirical@q2:from.load=-200,to.load=200,degree=1,c1=4e-4", "joint-compliance@q2:c=2e-6"):
        true = parse_effect(text, machine)
        frame = simulate(replace(machine, file=None), poses, [true], seed=5)
        pd.concat([pd.read_csv(tmp_path / "poses.csv"), frame], axis=1).to_csv(
            tmp_path / "rows.csv", index=False
        )
        recording = load_recording(machine, [tmp_path / "rows.csv"])
        fit = estimate(machine, recording, (true,))
        write_calibrated(tmp_path / "improved.yaml", fit, recording)
        improved = load_machine(tmp_path / "improved.yaml")
        far = replace(poses, q=poses.q * 3.0)
        predictor = predictor_for(improved, far)
        found = predicted(predictor)
        assert found.std is not None
        x, _ = predictor.assemble(predictor.model.p_home)
        _, _, slopes, _ = predictor.columns(predictor.model.p_home, x)
        known = covariance_of(fit)
        order = [predictor.model.names.index(name) for name in known.names]
        plain = known.std(slopes[..., order], fit.prior.scale[fit.prior.free]) ** 2
        signal = slopes[..., -1] * improved.effects[0].amplitudes[0]
        farther = np.abs(far.q).max(axis=1) > 2.0
        added[true.effect.slug] = np.median((found.std**2 - plain)[farther] / signal[farther] ** 2)
    assert added["empirical"] == pytest.approx(2.0, rel=0.2)
    assert added["joint-compliance"] == pytest.approx(2.0 * FORM_ERROR**2, rel=0.2)


def tipped(read: pd.DataFrame, turn: Rotation, size: float, settles: float) -> pd.DataFrame:
    """Readings of a machine whose base tips about the moment of the weight at its tool, and settles.

    By ``size`` tanh(|M| / ``settles``) rad, M = r x m g about the base's origin, r from the readings; ``turn`` is the base's.
    """
    origin = np.array([100.0, 20.0, 5.0])
    point = turn.inv().apply(read[["x", "y", "z"]].to_numpy() - origin)
    moment = np.cross(point * 1e-3, [0.0, 0.0, -20.0 * 9.80665])
    much = np.linalg.norm(moment, axis=1)[:, None]
    tilt = Rotation.from_rotvec(size * np.tanh(much / settles) * moment / much)
    out = read.copy()
    out[["x", "y", "z"]] = turn.apply(tilt.apply(point)) + origin
    return out


@pytest.fixture(scope="module")
def tipping(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """Of an arm on a base that tips, read at its tool."""
    folder = tmp_path_factory.mktemp("tipping")
    machine = machine_of(folder, STANDING)
    poses = poses_of(machine, folder)
    read = tipped(
        simulate(machine, poses, [], seed=2), Rotation.from_euler("z", 40.0, degrees=True), 3e-4, 60.0
    )
    pd.concat([pd.read_csv(folder / "poses.csv"), read], axis=1).to_csv(folder / "rows.csv", index=False)
    return diagnose(machine, load_recording(machine, [folder / "rows.csv"]))


@pytest.mark.nightly
def test_a_base_that_tips_is_found_at_the_base_and_driven_by_load(tipping: Diagnosis) -> None:
    """It is no sag in proportion, and nothing is said of the joints."""
    (base,) = (f for f in tipping.findings if f.place == ("base",))
    assert base.levels.kind == "load"
    assert base.levels.driver > 0.9
    assert not [f for f in tipping.findings if f is not base and f.levels.place > 0.9]
    assert tipping.verdict == "missing-physics"
    assert tipping.applied is not None and tipping.applied.pose is not None
    assert tipping.applied.pose.model < 0.7 * tipping.applied.pose.plain
