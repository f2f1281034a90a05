"""Encoders on the load side of joints, alone and beside a tracker. Readings come from plain numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.derivative_machines import MACHINES, readings
from support.derivative_machines import written as machine_of
from support.plain_kinematics import chain, frame
from support.simulated import machine_from
from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.run import check_files
from truepose.identification.leaves.planning.information import PoseInformation
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

ARM = """schema: truepose/machine/1
name: arm
gravity: [0, 0, -9.81]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, d: 50, range: [-110, 60]}
    - {name: q3, kind: revolute, d: 400, range: [-100, 100]}
frames:
  base: {in: world, xyz: [900, 300, 100], rpy: [0, 0, 40], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [320, 30, 60], tolerance: {xyz: 1}}
SENSOR
tolerances: {angle: 0.05, length: 0.3}
masses: {upper: {kg: 12, com: [300, 0, 0], in: link2}}
"""
TRACKER = "{type: position, sigma: {xyz: 0.02}}"
ENCODERS = "{type: angle, joints: [q2, q3], sigma: {angle: 3 arcsec}, tolerance: {angle: .inf}}"
BOTH = f"sensor:\n  - {TRACKER}\n  - {ENCODERS}"
COMPLIANCE, ZEROS, PLAY = 2e-6, (0.4, -0.9), 3e-4
ROWS = 60
LINKS = ((0, 0, 0, 0, 300), (0, -np.pi / 2, 50, 0, 0), (0, 0, 400, 0, 0))
ARCSEC = np.radians(1 / 3600)


def _machine(folder: Path, sensor: str, more: str = "") -> Machine:
    return machine_from(folder, ARM.replace("SENSOR", sensor) + more, "arm")


def _table(rng: np.random.Generator, *, noise: bool = True) -> dict[str, Array]:
    """An arm whose second joint sags by c times the torque of 12 kg, and whose third has play; tracker and encoders."""
    q = np.radians(rng.uniform([-150, -100, -90], [150, 50, 90], (ROWS, 3)))
    side = rng.choice([-1.0, 1.0], ROWS)
    # the upper arm's height at angle a below the horizon is -300 sin a: its weight turns it by m g 300 cos a downwards
    true = q.copy()
    for _ in range(20):
        true[:, 1] = q[:, 1] + COMPLIANCE * 12 * 9.81 * 0.3 * np.cos(true[:, 1])
    true[:, 2] = q[:, 2] - 0.5 * PLAY * side
    base, tool = frame([900, 300, 100], [0, 0, np.radians(40)]), frame([320, 30, 60])
    at = chain(LINKS, true, base, tool)[:, :3, 3]
    seen = np.radians(ZEROS) + true[:, 1:]
    if noise:
        at = at + 0.02 * rng.standard_normal(at.shape)
        seen = seen + 3 * ARCSEC * rng.standard_normal(seen.shape)
    out = {f"q{k + 1}": np.degrees(q[:, k]) for k in range(3)} | {"approach.q3": side}
    out |= dict(zip("xyz", at.T, strict=True))
    return out | {f"angle.q{k + 2}": np.degrees(seen[:, k]) for k in range(2)}


EFFECTS = """effects:
  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 0, unit: rad/(N*m)}}}
  - {effect: backlash, place: [q3], parameters: {b: {value: 0, unit: rad}}}
"""


def _told(fit: Estimate, label: str) -> tuple[float, float]:
    k = next(k for k, name in enumerate(fit.prior.names) if name.startswith(label))
    free = fit.prior.free.tolist().index(k)
    return float(fit.p[k]), float(np.sqrt(fit.covariance[free, free]))


def test_a_tracker_with_encoders_tells_compliance_and_play_more_sharply(tmp_path: Path) -> None:
    table = _table(np.random.default_rng(3))
    found = {}
    for name, sensor in (("alone", f"sensor: {TRACKER}"), ("both", BOTH)):
        machine = _machine(tmp_path, sensor, EFFECTS)
        found[name] = calibrate(machine, load_recording(machine, table)).fit
    for label, truth in (("joint-compliance@q2", COMPLIANCE), ("backlash@q3", PLAY)):
        value, std = _told(found["both"], label)
        assert abs(value - truth) < 4 * std
        assert std < 0.5 * _told(found["alone"], label)[1]
    for joint, zero in zip(("q2", "q3"), ZEROS, strict=True):
        value, std = _told(found["both"], f"angle.zero.{joint}")
        assert abs(value - np.radians(zero)) < 4 * std


def test_encoders_alone_are_a_sensor(tmp_path: Path) -> None:
    machine = _machine(tmp_path, f"sensor: {ENCODERS}", EFFECTS)
    fit = calibrate(machine, load_recording(machine, _table(np.random.default_rng(4)))).fit
    for label, truth in (("joint-compliance@q2", COMPLIANCE), ("backlash@q3", PLAY)):
        value, std = _told(fit, label)
        assert abs(value - truth) < 4 * std < truth


@pytest.mark.nightly
def test_the_diagnosis_names_both(tmp_path: Path) -> None:
    machine = _machine(tmp_path, BOTH)
    found = diagnose(machine, load_recording(machine, _table(np.random.default_rng(5)))).findings
    assert {(f.effect, f.place) for f in found} == {("joint-compliance", ("q2",)), ("backlash", ("q3",))}


@pytest.mark.nightly
def test_an_eccentric_disc_on_the_load_side_is_its_own_place(tmp_path: Path) -> None:
    table = _table(np.random.default_rng(6))
    table["angle.q3"] = table["angle.q3"] + np.degrees(2e-4 * np.sin(np.radians(table["q3"])))
    machine = _machine(tmp_path, BOTH)
    found = {(f.effect, f.place) for f in diagnose(machine, load_recording(machine, table)).findings}
    assert ("encoder-eccentricity", ("angle.q3",)) in found
    assert ("encoder-eccentricity", ("q3",)) not in found


def test_units_order_and_whole_turns_change_nothing(tmp_path: Path) -> None:
    table = _table(np.random.default_rng(7))
    machine = _machine(tmp_path, BOTH, EFFECTS)
    plain = calibrate(machine, load_recording(machine, table)).fit
    other = {name: column[::-1] for name, column in table.items()}
    other["angle.q2 [arcmin]"] = 60 * (other.pop("angle.q2") % 360)
    again = calibrate(machine, load_recording(machine, other, shuffled=True)).fit
    # the fit ends where a step is small beside a 1-sigma
    std = np.sqrt(np.diag(plain.covariance))
    np.testing.assert_allclose((plain.p - again.p)[plain.prior.free] / std, 0, atol=1e-4)


def test_a_calibrated_file_says_the_zeros(tmp_path: Path) -> None:
    machine = _machine(tmp_path, BOTH, EFFECTS)
    recording = load_recording(machine, _table(np.random.default_rng(8)))
    fit = calibrate(machine, recording).fit
    write_calibrated(tmp_path / "back.yaml", fit, recording)
    back = load_machine(tmp_path / "back.yaml")
    assert back.geometry["angle.zero.q3"].nominal == pytest.approx(_told(fit, "angle.zero.q3")[0], rel=1e-9)


def _scaled(folder: Path, name: str) -> tuple[Machine, Recording]:
    """An open chain or a hexapod with a scale or an encoder on every joint, in five poses."""
    sensor = "sensor:\n  - {type: pose, sigma: {xyz: 0.02, rot: 0.01}}\n  - {type: angle, name: scale, "
    sensor += "sigma: {angle: 1, length: 0.1}, tolerance: {angle: 1, length: 1}}\n"
    body = MACHINES[name]
    machine = machine_of(folder, body[: body.rindex("sensor:")] + sensor, name)
    q, joints = readings(machine, np.random.default_rng(2), 5), machine.mechanism.readings
    unit = {"mm": 1.0, "rad": 180 / np.pi}
    table = {j: q[:, k] * unit[machine.mechanism.reading_units[j]] for k, j in enumerate(joints)}
    table |= {n: np.zeros(5) for s in machine.sensors for n in s.columns}
    table[f"approach.{joints[0]}"] = np.array([1.0, -1.0, 1.0, 1.0, -1.0])
    return machine, load_recording(machine, table)


@pytest.mark.parametrize("name", ["arm", "6-pus", "6-ups"])
def test_jacobians_are_those_of_the_readings(tmp_path: Path, name: str) -> None:
    machine, recording = _scaled(tmp_path, name)
    first = machine.mechanism.readings[0]
    texts = [f"actuator-scale@{first}:s=1e-3", f"backlash@{first}:b=0.01[mm]"]
    predictor = Predictor(machine, recording, [parse_effect(text, machine) for text in texts])
    p, own = predictor.model.p_home, slice(-len(machine.mechanism.readings), None)

    def seen(at: Array) -> Array:
        x, _ = predictor.assemble(at)
        return predictor.columns(at, x)[1][:, own]

    x, _ = predictor.assemble(p)
    exact = predictor.columns(p, x)[2][:, own]
    for k, parameter in enumerate(predictor.model.names):
        move = np.zeros(len(p))
        move[k] = 1e-4 if machine.parameter_units.get(parameter) == "mm" else 1e-6
        slope = (seen(p + move) - seen(p - move)) / (2 * move[k])
        np.testing.assert_allclose(slope, exact[:, :, k], atol=1e-6 * max(1.0, np.abs(exact[:, :, k]).max()))


@pytest.mark.parametrize("name", ["arm", "6-pus", "6-ups"])
def test_planned_information_is_that_of_the_readings(tmp_path: Path, name: str) -> None:
    machine, recording = _scaled(tmp_path, name)
    predictor, own = Predictor(machine, recording), slice(-len(machine.mechanism.readings), None)
    p = predictor.model.p_home
    x, _ = predictor.assemble(p)
    information = PoseInformation(machine)
    at = [predictor.model.names.index(n) for n in information.names]
    scale = np.array([machine.geometry[n].scale for n in information.names])
    sigma = np.array([c.sigma for c in machine.channels])[own]
    expected = predictor.columns(p, x)[2][:, own, at] * scale / sigma[:, None]
    told = information.at(recording.q).signature[:, own]
    np.testing.assert_allclose(told, expected, rtol=1e-6, atol=1e-6 * np.abs(told).max())


def test_a_tracker_that_lags_does_not_move_the_encoders(tmp_path: Path) -> None:
    machine = _machine(tmp_path, BOTH)
    table = _table(np.random.default_rng(9)) | {f"velocity.q{k}": np.full(ROWS, 10.0) for k in (1, 2, 3)}
    lag = parse_effect("latency@sensor1+sensor2:tau=0.01[s]", machine)
    recording = load_recording(machine, table)
    plain, late = Predictor(machine, recording), Predictor(machine, recording, [lag])
    both = [p.columns(p.model.p_home, p.assemble(p.model.p_home)[0])[1] for p in (plain, late)]
    np.testing.assert_allclose(both[0][:, 3:], both[1][:, 3:], atol=1e-15)
    assert (
        np.abs(both[0][:, :3] - both[1][:, :3]).max() > 0.1
    )  # 10 deg/s for 10 ms is 0.1 deg at up to 800 mm


def _radians(rows: pd.DataFrame) -> None:
    rows["angle.q2"] = np.radians(rows["angle.q2"])


def _backwards(rows: pd.DataFrame) -> None:
    rows["angle.q3"] = -rows["angle.q3"]


def _exchanged(rows: pd.DataFrame) -> None:
    rows[["angle.q2", "angle.q3"]] = rows[["angle.q3", "angle.q2"]].to_numpy()


@pytest.mark.parametrize(
    ("spoil", "kind", "where"),
    [
        (_radians, "unit-angle", "angle.q2"),
        (_backwards, "sign", "angle.q3"),
        (_exchanged, "permutation", "angle.q2"),
    ],
)
def test_slips_of_encoders_are_named_and_mended(tmp_path: Path, spoil: object, kind: str, where: str) -> None:
    _machine(tmp_path, BOTH)
    rows = pd.DataFrame(_table(np.random.default_rng(10)))
    rows.to_csv(tmp_path / "right.csv", index=False)
    assert check_files(tmp_path / "arm.yaml", [tmp_path / "right.csv"])[0].verdict == "ok"
    assert callable(spoil)
    spoil(rows)
    rows.to_csv(tmp_path / "day.csv", index=False)
    found = check_files(tmp_path / "arm.yaml", [tmp_path / "day.csv"])[0]
    assert found.verdict == "wrong"
    assert (kind, (where,)) in [(f.kind, f.where) for f in found.found]
    (tmp_path / "mended").mkdir()
    files = found.mended(Pair.read(tmp_path / "arm.yaml", [tmp_path / "day.csv"])).write(tmp_path / "mended")
    assert check_files(Path(files[0]), [Path(files[1])])[0].verdict == "ok"


def test_a_zero_that_is_elsewhere_is_named_and_mended(tmp_path: Path) -> None:
    machine = _machine(tmp_path, BOTH.replace(".inf", "0.05"))
    rows = pd.DataFrame(_table(np.random.default_rng(11)))
    rows.to_csv(tmp_path / "day.csv", index=False)
    found = check_files(tmp_path / "arm.yaml", [tmp_path / "day.csv"])[0]
    assert [(f.kind, f.where) for f in found.found] == [("offset", ("angle.q2",)), ("offset", ("angle.q3",))]
    assert machine.geometry["angle.zero.q2"].nominal == 0.0
    (tmp_path / "mended").mkdir()
    files = found.mended(Pair.read(tmp_path / "arm.yaml", [tmp_path / "day.csv"])).write(tmp_path / "mended")
    mended = load_machine(files[0]).geometry["angle.zero.q2"]
    # play and load shift the middle by less than 0.05 deg
    assert np.degrees(mended.nominal) == pytest.approx(0.4, abs=0.05)
    assert check_files(Path(files[0]), [Path(files[1])])[0].verdict == "ok"


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (
            "{type: angle, joints: [q2, q5], sigma: {angle: 1}}",
            "joints: found 'q5', expected among q1, q2, q3",
        ),
        ("{type: angle, joints: [q2, q2], sigma: {angle: 1}}", "each of them once"),
        (
            "{type: angle, joints: [q2], zero: {q1: 3}, sigma: {angle: 1}}",
            "zero: found 'q1', expected among q2",
        ),
        ("{type: angle, sigma: {length: 1}}", "sigma: found no `angle`, expected it: q1 turns"),
        ("{type: angle, joints: [], sigma: {angle: 1}}", "joints: found none"),
    ],
)
def test_what_is_no_encoder_is_told(tmp_path: Path, sensor: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        _machine(tmp_path, f"sensor: {sensor}")
