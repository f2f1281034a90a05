"""Laws of prediction and simulation: they agree, they invert calibration, units and drivers hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from support import MACHINES
from support.simulated import drawn_table, poses_of, readings_of, recorded
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import predict, simulate, unassembled, with_inputs
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.table import read_table
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.units import convert

KINDS = ("serial", "pus", "ups", "distance")


def table_of(machine: Machine, n: int = 25, /, **columns: Any) -> pd.DataFrame:
    """Random poses in the machine's range."""
    return drawn_table(machine, n, 8, pose=np.arange(n), **columns)


@pytest.mark.parametrize("kind", KINDS)
def test_simulation_without_noise_is_the_prediction(kind: str) -> None:
    machine = load_machine(MACHINES / f"{kind}.yaml")
    rows = poses_of(machine, table_of(machine))
    silent, predicted = simulate(machine, rows, seed=None), predict(machine, rows)
    assert set() < set(silent) <= set(predicted)
    for name in silent:
        np.testing.assert_array_equal(silent[name], predicted[name])


def test_noise_is_the_instruments_and_follows_the_seed() -> None:
    machine = load_machine(MACHINES / "serial.yaml")
    rows = poses_of(machine, table_of(machine, 400))
    silent, first, same, other = (simulate(machine, rows, seed=seed) for seed in (None, 1, 1, 2))
    pd.testing.assert_frame_equal(first, same)
    assert not first.equals(other)
    assert float(np.std((first - silent).to_numpy())) == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_calibration_recovers_what_was_simulated(kind: str, tmp_path: Path) -> None:
    """Parameters drawn from their tolerances: predictions come back within their own 1-sigma."""
    drawn = load_machine(MACHINES / f"{kind}.yaml")
    table = table_of(drawn, 60)
    rows = poses_of(drawn, table)
    truth = _moved(drawn, np.random.default_rng(11))
    recording = load_recording(drawn, readings_of(truth, table, seed=3))
    fit = estimate(drawn, recording, damping=0.0)
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    calibrated = load_machine(tmp_path / "calibrated.yaml")
    found, wanted = predict(calibrated, rows), simulate(truth, rows, seed=None)
    pulls = [((found[c] - wanted[c]) / found[f"{c}.std"].replace(0.0, np.inf)).to_numpy() for c in wanted]
    assert 0.2 < float(np.sqrt(np.mean(np.square(pulls)))) < 2.0
    assert float(np.max(np.abs(pulls))) < 7.0
    free = fit.prior.free[np.isfinite(fit.prior.sigma[fit.prior.free])]
    held = free[fit.std[free] < 1e3 * fit.prior.scale[free]]
    true = np.array([p.nominal for p in truth.parameters])
    assert float(np.max(np.abs((fit.p - true)[held] / fit.std[held]))) < 5.0


def _moved(machine: Machine, rng: np.random.Generator) -> Machine:
    """The machine as built: each parameter off its drawing by a draw from its (finite) tolerance."""

    def built(parameters: tuple[object, ...]) -> tuple[object, ...]:
        out = []
        for p in parameters:
            sigma = p.tolerance if np.isfinite(p.tolerance) else 0.0  # type: ignore[attr-defined]
            out.append(replace(p, nominal=p.nominal + sigma * rng.standard_normal()))  # type: ignore[attr-defined,type-var]
        return tuple(out)

    sensors = []
    for sensor in machine.sensors:
        held = {field: built(getattr(sensor, field)) for field in ("points", "own") if hasattr(sensor, field)}
        sensors.append(replace(sensor, **held))  # type: ignore[type-var]
    mechanism = replace(machine.mechanism, parameters=built(machine.mechanism.parameters))  # type: ignore[arg-type]
    frames = built(machine.frames)
    return replace(machine, mechanism=mechanism, frames=frames, sensors=tuple(sensors))  # type: ignore[arg-type]


def test_std_of_tolerances_and_of_an_unknown_base(tmp_path: Path) -> None:
    machine = load_machine(MACHINES / "ups.yaml")
    table = table_of(machine)
    rows = poses_of(machine, table)
    assert np.isinf(predict(machine, rows)["x.std"]).all()  # the base may stand anywhere
    recording = recorded(machine, table, seed=1)
    write_calibrated(tmp_path / "calibrated.yaml", estimate(machine, recording), recording)
    std = predict(load_machine(tmp_path / "calibrated.yaml"), rows)["x.std"]
    assert (std < 0.005).all()


def test_effects_of_a_calibrated_file_use_the_rows_own_drivers(tmp_path: Path) -> None:
    machine = load_machine(MACHINES / "pus.yaml")
    effect = parse_effect("thermal-expansion@base:alpha=2e-5[1/K]", machine)
    recording = recorded(
        machine, table_of(machine, **{"temperature.base": np.linspace(15, 25, 25)}), effect, seed=1
    )
    fit = estimate(machine, recording, (effect,))
    write_calibrated(tmp_path / "improved.yaml", fit, recording)
    improved = load_machine(tmp_path / "improved.yaml")
    rows = poses_of(improved, table_of(machine, **{"temperature.base": np.full(25, 30.0)}))
    found, wanted = predict(improved, rows), simulate(machine, rows, [effect], seed=None)
    plain = simulate(machine, rows, seed=None)
    missed = max(float(np.max(np.abs(found[c] - wanted[c]))) for c in wanted)
    ignored = max(float(np.max(np.abs(plain[c] - wanted[c]))) for c in wanted)
    assert missed < 0.1 * ignored


def test_an_unseen_session_takes_the_shift_of_the_latest(tmp_path: Path) -> None:
    machine = load_machine(MACHINES / "serial.yaml")
    effect = parse_effect("frame-shift@base:z=3[mm],session=1", machine)
    recording = recorded(machine, table_of(machine, session=np.repeat([4, 7], [12, 13])), effect, seed=1)
    write_calibrated(tmp_path / "improved.yaml", estimate(machine, recording, (effect,)), recording)
    improved = load_machine(tmp_path / "improved.yaml")
    z = {}
    for session in (4, 7, 9):
        later = poses_of(improved, table_of(machine, session=np.full(25, session)))
        z[session] = predict(improved, later)["z"].to_numpy()
    np.testing.assert_allclose(z[9], z[7])
    np.testing.assert_allclose(z[7] - z[4], 3.0, atol=0.05)


def test_a_row_that_cannot_be_assembled_stays_empty(tmp_path: Path) -> None:
    machine = load_machine(MACHINES / "ups.yaml")
    path, frame = tmp_path / "p.csv", table_of(machine)
    frame.iloc[3, 1] = 500.0
    frame.to_csv(path, index=False)
    actuators = tuple(replace(a, range=None) for a in machine.mechanism.actuators)
    unbound = replace(machine, mechanism=replace(machine.mechanism, actuators=actuators))
    rows = load_recording(unbound, [path], need_observations=False)
    found = predict(unbound, rows)
    assert found.loc[3].isna().all()
    assert not found.drop(index=3).isna().any().any()
    assert unassembled(rows, found) == [
        f"{path}: row 4: the mechanism cannot be assembled there; the row is empty"
    ]
    with pytest.raises(InputError, match="row 4"):
        simulate(unbound, rows)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("actuator-scal@q2:s=1", "did you mean actuator-scale"),
        ("actuator-scale@q9:s=1", "known: q1, q2"),
        ("actuator-scale@q2:t=1", "unknown name 't'"),
        ("actuator-scale@q2:s=1[mm]", "unit 'mm' is a length"),
        ("actuator-scale@q2:s=much", "expected name=value"),
        ("actuator-scale@q2:s=1,s=2", "twice"),
        ("actuator-scale", "expected SLUG@PLACE"),
        ("outliers@q2", "has no place"),
    ],
)
def test_an_effect_that_cannot_be_read_is_told(text: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        parse_effect(text, load_machine(MACHINES / "serial.yaml"))
    assert "\n" not in str(caught.value)


def test_effects_are_read_with_units_settings_and_several_places() -> None:
    machine = load_machine(MACHINES / "pus.yaml")
    coupling = parse_effect("axis-coupling@rho3+rho2:k=1e-4", machine)
    assert coupling.place == ("rho3", "rho2") and coupling.values == {"k": 1e-4}
    heat = parse_effect("thermal-expansion@base:alpha=20[um/(m*K)],lag=900", machine)
    assert heat.values["alpha"] == pytest.approx(2e-5) and heat.settings_map["lag"] == 900.0
    bent = parse_effect("platform-deformation@platform:K[1,1]=0.016,K[1,2]=-0.002[1]", machine)
    assert bent.values["K[1,1]"] == 0.016 and bent.values["K[1,2]"] == -0.002


def test_columns_of_the_poses_pass_through(tmp_path: Path) -> None:
    machine = load_machine(MACHINES / "serial.yaml")
    path = tmp_path / "p.csv"
    logged = {"role": ["validation"] * 25, "note": ["a"] * 25, "x": np.zeros(25)}
    table_of(machine, **logged).to_csv(path, index=False)
    rows = load_recording(machine, [path], need_observations=False)
    frame = with_inputs(read_table(path), simulate(machine, rows))
    assert list(frame) == ["pose", "role", "note", "q1 [mm]", "q2 [rad]", "q3 [rad]", "x", "y", "z"]
    assert (frame["x"] != 0).all() and set(frame["role"]) == {"validation"}


def test_an_effect_that_diagnosis_does_not_look_for_here_can_be_simulated() -> None:
    """Gains left open by the drawing: a wrong one is a constant to the diagnosis, an effect to the user."""
    machine = load_machine(MACHINES / "ups.yaml")
    assert parse_effect("actuator-scale@m4:s=8e-4", machine).values == {"s": 8e-4}
    with pytest.raises(InputError, match="m9"):
        parse_effect("actuator-scale@m9:s=8e-4", machine)


def poses(machine: Machine, path: Path, n: int = 25, columns: Mapping[str, object] | None = None) -> Path:
    """A file of random poses in the machine's range."""
    rng = np.random.default_rng(8)
    data: dict[str, object] = {"pose": np.arange(n), **(columns or {})}
    if any(sensor.differs_from_row for sensor in machine.sensors):
        data["from"] = np.maximum(np.arange(n) - 1, 0)
    for actuator in machine.mechanism.actuators:
        assert actuator.range is not None
        data[f"{actuator.reading} [{actuator.reading_unit}]"] = rng.uniform(*actuator.range, n)
    pd.DataFrame(data).to_csv(path, index=False)
    return path


def _in_micrometres(text: str, path: Path) -> Machine:
    """The same arm with every length in um and every angle in mrad."""
    from truepose.models.file.machine_file import write_machine
    from truepose.models.file.yaml_document import read_document

    path.write_text(text, encoding="utf-8")
    raw, um, mrad = read_document(path), 1000.0, float(np.radians(1.0)) * 1000.0
    raw["units"] = {"length": "um", "angle": "mrad"}
    for joint in raw["mechanism"]["joints"]:
        turning = joint["kind"] == "revolute"
        for key in {"d", "r"} & set(joint):
            joint[key] *= um
        for key in {"alpha", "beta", "theta"} & set(joint):
            joint[key] *= mrad
        joint["range"] = [v * (mrad if turning else um) for v in joint["range"]]
    raw["frames"]["base"]["tolerance"] = {"xyz": 5 * um, "rpy": mrad}
    raw["frames"]["tool"] = {"in": "flange", "xyz": [200 * um, 0, 30 * um], "tolerance": {"xyz": um}}
    raw["sensor"]["sigma"] = {"xyz": 0.01 * um}
    raw["tolerances"] = {"length": 0.1 * um, "angle": 0.1 * mrad}
    for mass in raw["masses"].values():
        mass["com"] = [v * um for v in mass["com"]]
    write_machine(path, raw)
    return load_machine(path)


def test_a_file_in_other_units_predicts_the_same(tmp_path: Path) -> None:
    machine = load_machine(MACHINES / "serial.yaml")
    rows = load_recording(machine, [poses(machine, tmp_path / "p.csv")], need_observations=False)
    text = (MACHINES / "serial.yaml").read_text(encoding="utf-8")
    other = _in_micrometres(text, tmp_path / "um.yaml")
    rows_um = load_recording(other, [tmp_path / "p.csv"], need_observations=False)
    found, wanted = predict(other, rows_um), predict(machine, rows)
    assert len(wanted.columns) >= 6
    for column in wanted:
        angle = str(column).startswith("pose.r")
        factor = convert(1.0, "mrad", "deg") if angle else convert(1.0, "um", "mm")
        np.testing.assert_allclose(found[column] * factor, wanted[column], rtol=1e-9, atol=1e-9)
