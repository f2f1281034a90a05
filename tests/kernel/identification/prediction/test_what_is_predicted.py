"""Which rows are predicted and how: rows in parts, readings that are changes, sessions, drivers that nobody logged, notes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import MACHINES
from support.simulated import drawn_table, machine_from, poses_of
from truepose.errors import InputError
from truepose.identification.prediction import predictor as predictor_module
from truepose.identification.prediction.predict import (
    POSE,
    predict,
    predicted,
    predictor_for,
    simulate,
    unassembled,
    unheard,
)
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.effect_text import parse_effect
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine


def machine_of(name: str, *texts: str) -> Machine:
    machine = load_machine(MACHINES / f"{name}.yaml")
    return machine.with_effects(tuple(parse_effect(text, machine) for text in texts))


def rows_of(machine: Machine, **columns: Any) -> Recording:
    """Six of them; of changes two and two count from a row."""
    if any(sensor.differs_from_row for sensor in machine.sensors):
        columns = {"from": np.arange(6) // 2, **columns}
    return poses_of(machine, drawn_table(machine, 6, 3, **columns))


def in_file(machine: Machine, **more: Any) -> Machine:
    assert machine.file is not None
    return replace(machine, file=replace(machine.file, **more))


def fitted(rows: int, seen: Mapping[str, list[float]] | None = None) -> dict[str, Any]:
    return {
        "names": ["q2.d"],
        "factor": ["0.01"],
        "seen": {"row": [float(1 - rows), 0.0]} if seen is None else seen,
    }


@pytest.mark.parametrize("block", [1, 4, 6, 100])
@pytest.mark.parametrize("name", ["pus", "distance"])
def test_values_are_the_same_however_many_rows_are_worked_out_together(
    name: str, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = machine_of(name)
    predictor = Predictor(machine, rows_of(machine))
    p = predictor.model.p_home
    x, _ = predictor.assemble(p)
    names, values, _, poses = predictor.columns(p, x)
    monkeypatch.setattr(predictor_module, "BLOCK", block)
    found = predictor.values(p, x)
    assert found[0] == names == [name for sensor in machine.sensors for name in sensor.columns]
    np.testing.assert_allclose(found[1], values, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found[2], poses, rtol=1e-12, atol=1e-12)
    loads = predictor.loads(p, x)
    some = predictor.loads_at([*list(loads)[:2], "nothing"], p, x)
    assert list(some) == list(loads)[:2] or set(some) == set(list(loads)[:2])
    for load, own in some.items():
        np.testing.assert_allclose(own, loads[load], atol=1e-9)


CAVITY = "sensor: {type: distance, beam: {xyz: [1, 900, 3], rx: 91}, mirror: {in: flange}, sigma: {distance: 0.001}}"


def test_a_change_from_a_row_that_is_not_there_is_none_either(tmp_path: Path) -> None:
    """A hexapod before a cavity; rows 2 and 3 count from one that cannot be assembled."""
    text = (MACHINES / "ups.yaml").read_text(encoding="utf-8")
    lines = [CAVITY if line.startswith("sensor:") else line for line in text.splitlines()]
    machine = machine_from(tmp_path, "\n".join(lines), "m")
    predictor = predictor_for(machine, rows_of(machine, **{"from": [0, 0, 1, 1, 0, 4]}))
    predictor.q = predictor.q.copy()
    predictor.q[1] = 1e5
    found = predicted(predictor, with_std=False)
    assert found.good.tolist() == [True, False, False, False, True, True]
    assert found.std is None
    assert np.isnan(found.values[1:4]).all() and np.isnan(found.poses[1:4]).all()
    assert np.isfinite(found.values[[0, 4, 5]]).all() and np.isfinite(found.poses[[0, 4, 5]]).all()


def test_changes_without_a_row_to_count_from_are_refused() -> None:
    machine = machine_of("distance")
    recording = replace(rows_of(machine), from_row=None)
    with pytest.raises(InputError, match=r"'from'"):
        predicted(predictor_for(machine, recording))


def test_no_rows_are_no_predictions() -> None:
    machine = machine_of("serial")
    found = predicted(predictor_for(machine, rows_of(machine).subset(np.zeros(0, dtype=int))))
    assert found.values.shape == (0, 3) and found.poses.shape == (0, 4, 4) and found.good.shape == (0,)
    assert found.std is not None and found.std.shape == (0, 3)


def test_a_prediction_is_told_in_the_units_of_the_file_with_the_tool_s_pose() -> None:
    machine = machine_of("ups")
    recording = rows_of(machine)
    found, frame = predicted(predictor_for(machine, recording)), predict(machine, recording)
    for k, (name, unit) in enumerate(found.columns.items()):
        factor = 180.0 / np.pi if unit == "rad" and machine.units.angle == "deg" else 1.0
        np.testing.assert_allclose(frame[name], factor * found.values[:, k], rtol=1e-12)
    np.testing.assert_allclose(frame[list(POSE[:3])], found.poses[:, :3, 3], rtol=1e-12)
    # the sensor reads the tool's pose, too
    np.testing.assert_allclose(frame[list(POSE)], frame[["x", "y", "z", "rx", "ry", "rz"]], atol=1e-9)
    assert unassembled(recording, frame) == []
    with pytest.raises(InputError, match="sensor: found none, expected one"):
        predictor_for(replace(machine, sensors=()), recording).values(np.zeros(0), np.zeros((0, 0)))


# -- sessions ------------------------------------------------------------------------------------------


def test_sessions_are_those_of_the_fit() -> None:
    """A session that the fit has not seen is as its latest was; without a fit sessions are the rows' own."""
    machine = machine_of("serial", "frame-shift@base:z=3,session=1", "frame-shift@base:z=3,session=2")
    recording = rows_of(machine, session=[1, 2, 2, 5, 7, 9])

    def shifted(*sessions: int) -> list[list[float]]:
        return predictor_for(in_file(machine, sessions=sessions), recording).z.T.tolist()

    assert shifted() == shifted(1, 2, 5, 7, 9) == [[0, 1, 1, 1, 1, 1], [0, 0, 0, 1, 1, 1]]
    assert shifted(1, 5, 7) == [[0, 1, 1, 1, 1, 1], [0, 1, 1, 0, 1, 1]]
    assert shifted(5, 7, 9) == [[1, 1, 1, 0, 1, 1], [1, 1, 1, 0, 0, 1]]


# -- drivers that nobody logged ------------------------------------------------------------------------


def test_drivers_that_are_not_logged_are_noted_each_once() -> None:
    texts = (
        "thermal-expansion@link2:alpha=1e-5", "thermal-expansion@link2:alpha=1e-5,lag=600",
        "thermal-expansion@link3:alpha=1e-5", "joint-compliance@q2:c=1e-6", "thermal-expansion@base:alpha=1e-5",
    )  # fmt: skip
    machine = machine_of("serial", *texts)
    recording = rows_of(machine, **{"temperature.link3": [20.0, 25.0] * 3})
    said = "effects that depend on it see its default"
    assert unheard(machine, recording) == [
        f"no column {name!r}: {said}" for name in ("temperature.link2", "temperature.base")
    ]
    assert unheard(machine_of("serial"), recording) == []


@pytest.mark.parametrize(
    ("covariance", "late"),
    [
        (None, False),
        (fitted(6), False),  # as many rows as were fitted: they may be the same
        (fitted(7), True),
        (fitted(6, {}), False),  # a file that does not say
    ],
)
def test_drift_in_the_order_of_rows_goes_on_only_in_the_rows_that_were_fitted(
    covariance: dict[str, Any] | None, late: bool
) -> None:
    plain = machine_of("serial")
    drift = PlacedEffect.at(effects.get("mount-drift", "test")(), plain, ("base",), {"rows": 5.0, "tau": 0.0})
    drifting = plain.with_effects((drift.with_values([0.0, 0.0, 2.0, 0.0, 0.0, 0.0]),))
    machine = in_file(drifting, covariance=covariance)
    recording = rows_of(machine)
    predictor = predictor_for(machine, recording)
    assert predictor.model.drivers == ("row",)
    assert predictor.z[:, 0].tolist() == ([0.0] * 6 if late else [-5.0, -4.0, -3.0, -2.0, -1.0, 0.0])
    said = ["what drifted in the order of the fitted rows is predicted as it was at their end"]
    assert unheard(machine, recording) == (said if late else [])


def test_a_reading_from_the_row_itself_is_nothing_whatever_the_noise() -> None:
    machine = machine_of("distance")
    recording = rows_of(machine)
    read, silent = simulate(machine, recording, seed=2), simulate(machine, recording, seed=None)
    assert read["dL"][0] == silent["dL"][0] == 0.0  # row 1 counts from row 1
    assert (read["dL"][1:] != silent["dL"][1:]).all()
    own = replace(recording, from_row=np.arange(6))
    assert (simulate(machine, own, seed=2)["dL"] == 0.0).all()
    assert simulate(machine, recording)["dL"].tolist() == simulate(machine, recording, seed=0)["dL"].tolist()
