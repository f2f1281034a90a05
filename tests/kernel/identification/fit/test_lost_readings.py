"""Readings that were lost: what stands in their place does not matter, and all others count as before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import truepose
from support.command import input_error
from support.engines import compile_hastily
from support.generated_c import needs_compiler
from support.machine_texts import machine_from
from truepose.identification.diagnosis.alarms import replicate_noise
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.problem import NormalEquations
from truepose.identification.fit.summary import summarise
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

ARM = """
schema: truepose/machine/1
name: arm
gravity: [0, 0, -9.81]
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute, range: [-170, 170]}}
    - {{name: q2, kind: revolute, alpha: -90, d: 40, range: [-120, 120]}}
    - {{name: q3, kind: revolute, d: 400, range: [-120, 120]}}
frames:
  base: {{xyz: [0, 0, 0], tolerance: {{xyz: 5, rpy: 1}}}}
  tool: {{in: flange, xyz: [300, 20, 10], tolerance: {{xyz: 0, rpy: 0}}}}
tolerances: {{length: 0.2, angle: 0.1}}
sensor: {sensor}
"""
SENSORS = {
    "position": "{type: position, sigma: {xyz: 0.02}}",
    "pose": "{type: pose, sigma: {xyz: 0.02, rot: 0.002}}",
    "targets": "{type: targets, points: {P1: [0, 0, 0], P2: [60, 0, 30]}, sigma: {xyz: 0.02}}",
    "first": "{type: targets, points: {P1: [0, 0, 0]}, sigma: {xyz: 0.02}}",
    "second": "{type: targets, points: {P2: [60, 0, 30]}, sigma: {xyz: 0.02}}",
}


def _machine(folder: Path, kind: str) -> Machine:
    return machine_from(folder, ARM.format(sensor=SENSORS[kind]), f"{kind}")


def _rows(machine: Machine, n: int, seed: int = 4) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    joints = pd.DataFrame(rng.uniform(-100, 100, (n, 3)), columns=["q1", "q2", "q3"])
    effects = [truepose.parse_effect("actuator-scale@q2:s=2e-4", machine)]
    return pd.concat([joints, truepose.simulate(machine, joints, effects, seed=seed)], axis=1)


def _without(rows: pd.DataFrame, cells: list[tuple[int, str]]) -> pd.DataFrame:
    out = rows.copy()
    for row, name in cells:
        out.loc[row, name] = np.nan
    return out


def _same(one: Estimate, other: Estimate) -> None:
    np.testing.assert_allclose(one.p, other.p, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(one.residual[one.used], other.residual[other.used])
    assert (one.n_observations, one.chi2_per_dof) == (other.n_observations, other.chi2_per_dof)


@pytest.mark.parametrize("kind", ["position", "pose", "targets"])
@pytest.mark.parametrize("loss", ["gauss", "huber"])
def test_what_stood_in_a_lost_cell_does_not_matter(tmp_path: Path, kind: str, loss: str) -> None:
    machine = _machine(tmp_path, kind)
    rows = _rows(machine, 30)
    names = list(machine.sensors[0].columns)
    cells = [(k, names[k % len(names)]) for k in (3, 4, 11)]
    fits = []
    for offset in (0.0, 17.0):
        wrong = rows.copy()
        for row, name in cells:
            wrong[name] += np.where(wrong.index == row, offset, 0.0)
        recording = truepose.load_recording(machine, _without(wrong, cells))
        fits.append(estimate(machine, recording, loss=loss))
    _same(*fits)
    turned = sum(name.startswith("r") for _, name in cells)
    lost = len(cells) + 2 * turned  # one component of a rotation vector takes the turn with it
    assert fits[0].n_observations == 30 * len(machine.channels) - lost


def test_a_row_without_a_reading_is_a_row_left_out(tmp_path: Path) -> None:
    machine = _machine(tmp_path, "position")
    rows = _rows(machine, 24)
    lost = truepose.load_recording(machine, _without(rows, [(5, "x"), (5, "y"), (5, "z")]))
    left_out = truepose.load_recording(machine, rows.drop(index=5))
    assert lost.notes[-1] == "DataFrame: no reading is left in row 6: not fitted"
    one, other = estimate(machine, lost), estimate(machine, left_out)
    np.testing.assert_allclose(one.p, other.p, rtol=0, atol=1e-9)  # sums in another order
    assert one.n_observations == other.n_observations
    assert int(one.used.sum()) == 23


def test_the_gradient_vanishes_where_two_sensors_told_apart_say_so(tmp_path: Path) -> None:
    """P2 lost in some rows: the fit's minimum is that of P1 in all rows, P2 in the others, and the tolerances."""
    both, first, second = (_machine(tmp_path, kind) for kind in ("targets", "first", "second"))
    rows = _rows(both, 26)
    gone = np.isin(np.arange(26), (2, 9, 20))
    fit = estimate(both, truepose.load_recording(both, _without(
        rows, [(int(k), f"P2.{axis}") for k in np.flatnonzero(gone) for axis in "xyz"]
    )), tolerance=1e-16)  # fmt: skip
    gradient, square = np.zeros(len(fit.prior.free)), 0.0
    names = [fit.prior.names[k] for k in fit.prior.free]
    for machine, kept in ((first, np.ones(26, dtype=bool)), (second, ~gone)):
        recording = truepose.load_recording(machine, rows[kept])
        predictor = Predictor(machine, recording)
        p = np.array([fit.p[fit.prior.names.index(name)] for name in predictor.model.names])
        at = [predictor.model.names.index(name) for name in names]
        for block in predictor.blocks(p, predictor.assemble(p)[0]):
            gradient += np.einsum("nmi,nm->i", block.jacobian[:, :, at], block.residual)
            square += float(np.sum(block.residual**2))
    tolerance = fit.prior.sigma[fit.prior.free]
    gradient += (fit.p - fit.prior.mean)[fit.prior.free] / tolerance**2
    assert np.max(np.abs(gradient * tolerance)) < 1e-5 * np.sqrt(square)
    assert fit.chi2 == pytest.approx(square, rel=1e-9)
    assert fit.n_observations == 26 * 6 - 9


@needs_compiler
def test_every_route_to_the_minimum_leaves_them_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Row by row, and by compiled sums."""
    machine = _machine(tmp_path, "pose")
    rows = _rows(machine, 60)
    recording = truepose.load_recording(
        machine, _without(rows, [(k, "ry") for k in range(0, 30, 3)] + [(1, "x")])
    )
    plain = estimate(machine, recording)
    sums: list[np.ndarray] = []
    rows_of_sums = NormalEquations.rows

    def counted(self: NormalEquations, p: Any, weight: Any, scale: Any, least: float) -> Any:
        sums.append(weight)
        return rows_of_sums(self, p, weight, scale, least)

    compile_hastily(monkeypatch)
    monkeypatch.setattr(NormalEquations, "rows", counted)
    summed = estimate(machine, recording)
    monkeypatch.undo()
    assert sums
    assert {int(weight.sum()) for weight in sums} == {60 - 11}
    np.testing.assert_allclose(summed.in_tolerances, plain.in_tolerances, atol=2e-4)
    assert summed.n_observations == plain.n_observations


def test_figures_leave_out_points_that_were_not_seen_whole(tmp_path: Path) -> None:
    machine = _machine(tmp_path, "position")
    rows = _rows(machine, 30)
    lost = truepose.load_recording(machine, _without(rows, [(k, "z") for k in range(10)]))
    fit = estimate(machine, lost)
    residual = fit.residual[10:] * 0.02
    expected = np.sqrt(np.mean(np.sum(residual**2, axis=1)))
    assert summarise(fit, lost.validation).rms["position"] == pytest.approx(expected)


def test_replicates_count_what_was_read(tmp_path: Path) -> None:
    machine = _machine(tmp_path, "position")
    rows = _rows(machine, 12)
    rows = pd.concat([rows] * 2, ignore_index=True).assign(pose=[*range(12)] * 2)
    fit = estimate(machine, lost := truepose.load_recording(machine, _without(rows, [(0, "x"), (13, "y")])))
    noise, dof = replicate_noise(fit, lost)
    assert dof == 12 * 3 - 2
    assert noise == 0.0  # the same readings twice


def test_a_frame_nobody_measured_is_found_without_them(tmp_path: Path) -> None:
    text = ARM.format(sensor=SENSORS["pose"]).replace("xyz: 5, rpy: 1", "xyz: .inf, rpy: .inf")
    machine = machine_from(tmp_path, text.replace("xyz: 0, rpy: 0", "xyz: 0, rpy: .inf"), "arm")
    rows = _rows(machine, 20)
    whole = aligned_start(Predictor(machine, truepose.load_recording(machine, rows)))
    gaps = truepose.load_recording(machine, _without(rows, [(0, "x"), (1, "rz"), (2, "ry")]))
    np.testing.assert_allclose(aligned_start(Predictor(machine, gaps)), whole, atol=0.05)


@pytest.mark.nightly
def test_diagnosis_and_prediction_go_through(tmp_path: Path) -> None:
    machine = _machine(tmp_path, "targets")
    rows = _rows(machine, 60)
    rows["role"] = ["validation" if k % 6 == 0 else "calibration" for k in range(60)]
    cells = [(0, "P1.x"), (7, "P2.z"), (8, "P2.z"), (9, "P1.y")]
    whole, gaps = truepose.diagnose(machine, rows), truepose.diagnose(machine, _without(rows, cells))
    assert [(f.effect, f.place) for f in gaps.findings] == [(f.effect, f.place) for f in whole.findings]
    for one, other in zip(gaps.findings, whole.findings, strict=True):
        assert one.probability == pytest.approx(other.probability, abs=0.05)
    truepose.diagnosis_json(gaps)
    assert len(truepose.predict(machine, _without(rows, cells)).dropna()) == 60


def test_a_change_of_length_loses_its_own_row_alone() -> None:
    machine = load_machine(Path(truepose.__file__).parent / "models/machines/nanopositioner/machine.yaml")
    recording = _bundled(machine)
    length = recording.observations["dL"].copy()
    row = int(np.flatnonzero(recording.from_row != np.arange(len(recording)))[5])
    length[row] = np.nan
    lost = replace(recording, observations={"dL": length})
    blocks = [list(Predictor(machine, r).blocks(*_nominal(machine, r))) for r in (recording, lost)]
    (whole,), (gap,) = blocks
    others = np.arange(len(recording)) != row
    np.testing.assert_array_equal(whole.residual[others], gap.residual[others])
    np.testing.assert_array_equal(whole.jacobian[others], gap.jacobian[others])
    assert not gap.residual[row].any()
    assert not gap.jacobian[row].any()


def _nominal(machine: Machine, recording: Recording) -> tuple[Any, Any]:
    predictor = Predictor(machine, recording)
    return predictor.model.p_home, predictor.assemble(predictor.model.p_home)[0]


def _bundled(machine: Machine) -> Recording:
    assert machine.file is not None
    found = sorted(machine.file.path.parent.glob("*.csv"))
    return truepose.load_recording(machine, found[0]).subset(slice(0, 60))


def test_text_and_columns_without_a_reading_are_refused(tmp_path: Path) -> None:
    machine = _machine(tmp_path, "position")
    rows = _rows(machine, 5)
    path = tmp_path / "r.csv"
    rows.assign(x=["nan", *map(str, rows["x"][1:])]).to_csv(path, index=False)
    expected = (
        r"r\.csv: row 1 \(line 2\), column 'x': found 'nan', .* leave the cell empty where a reading was lost"
    )
    with input_error(expected):
        truepose.load_recording(machine, path)
    with input_error(r"column 'q2': found (nan|an empty cell)"):
        truepose.load_recording(machine, _without(rows, [(2, "q2")]))
    assert len(truepose.predict(machine, rows.assign(x=np.nan))) == 5
