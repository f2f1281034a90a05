"""What sensors should read at a pose: derivatives, a cavity by hand, and changes from an earlier row."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.closed_kinematics import readings
from support.moving_machines import ARM, FRAMED, MOVERS, drawn, named, nominal, record, written
from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.prediction.predictor import Predictor, lost_of
from truepose.identification.prediction.sensor_rows import Sight, sights
from truepose.identification.recording.load import load_recording
from truepose.models import lie

SENSORS = {
    "pose": "{type: pose, sigma: {xyz: 0.01, rot: 0.001}}",
    "position": "{type: position, sigma: {xyz: 0.02}}",
    "targets": "{type: targets, points: {P1: [1, 2, 3], P2: [40, 0, 5], P3: [0, 50, -6]}, "
    "sigma: {xyz: 0.01}}",
    "distance": "{type: distance, beam: {xyz: [1, 900, 3], rx: 91, rz: 4}, "
    "mirror: {in: tool, z: 2, rx: 3, ry: -4}, sigma: {distance: 0.001}}",
}


@pytest.mark.parametrize("sensor", SENSORS)
def test_sensor_residuals_by_every_parameter(tmp_path: Path, sensor: str) -> None:
    machine = written(tmp_path, FRAMED + MOVERS + f"sensor: {SENSORS[sensor]}\n")
    rng = np.random.default_rng(6)
    q, columns = readings(machine, rng, 4), machine.sensors[0].columns
    read = {column: rng.uniform(-1, 1, 4) for column in columns}
    predictor = Predictor(machine, record(machine, q, read, from_row=np.array([0, 0, 1, 1])))
    p = drawn(machine, rng)
    x, _ = predictor.assemble(p)

    def residual(at: Array) -> Array:
        return np.concatenate([block.residual for block in predictor.blocks(at, x)])

    exact = np.concatenate([block.jacobian for block in predictor.blocks(p, x)])
    assert exact.shape == (4, len(machine.sensors[0].channels), len(p))
    for k, parameter in enumerate(machine.parameters):
        step = 1e-3 if parameter.unit == "mm" else 1e-6
        ends = [residual(p + sign * step * np.eye(len(p))[k]) for sign in (-1, 1)]
        slope = (ends[1] - ends[0]) / (2 * step)
        scale = 1.0 + np.abs(slope).max()
        np.testing.assert_allclose(exact[:, :, k], slope, atol=1e-6 * scale, err_msg=parameter.name)


@pytest.mark.parametrize("sensor", SENSORS)
def test_residuals_alone_are_those_with_derivatives(tmp_path: Path, sensor: str) -> None:
    machine = written(tmp_path, FRAMED + MOVERS + f"sensor: {SENSORS[sensor]}\n")
    rng, rows = np.random.default_rng(9), slice(0, 5)
    q, columns = readings(machine, rng, 5), machine.sensors[0].columns
    read = {column: rng.uniform(-1, 1, 5) for column in columns}
    read[next(iter(columns))][3] = np.nan
    recording = record(machine, q, read, from_row=np.array([0, 0, 1, 1, 2]))
    predictor, p = Predictor(machine, recording), drawn(machine, rng)
    pose, (comparison,) = predictor.poses(p, predictor.assemble(p)[0])[0], predictor.comparisons()
    lost = lost_of(machine.sensors[0], recording)
    (function,) = sights(machine, list(predictor.model.names), 5)
    nothing = np.zeros((5, len(columns)))
    sight = Sight(pose, np.zeros((5, 6, len(p))), nothing, np.zeros((*nothing.shape, len(p))))
    whole = function.block(sight, p, recording, rows, comparison, lost).residual
    alone = function.residual(pose, p, recording, comparison, lost)
    np.testing.assert_allclose(alone, whole, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_reading_that_is_the_prediction_leaves_nothing(tmp_path: Path, sensor: str) -> None:
    machine = written(tmp_path, FRAMED + ARM + f"sensor: {SENSORS[sensor]}\n")
    rng = np.random.default_rng(7)
    q, p, before = readings(machine, rng, 6), drawn(machine, rng), np.array([0, 0, 1, 1, 3, 2])
    predictor = Predictor(machine, record(machine, q, from_row=before))
    names, values, _, _ = predictor.columns(p, predictor.assemble(p)[0])
    read = dict(zip(names, values.T, strict=True))
    again = Predictor(machine, record(machine, q, read, from_row=before))
    blocks = list(again.blocks(p, again.assemble(p)[0]))
    assert sum(block.residual.size for block in blocks) >= len(q)
    for block in blocks:
        np.testing.assert_allclose(block.residual, 0.0, atol=1e-6)


def test_a_cavity_is_as_long_as_from_its_source_to_the_mirror(tmp_path: Path) -> None:
    """Against a plane and a line intersected by hand."""
    machine = written(tmp_path, FRAMED + MOVERS + f"sensor: {SENSORS['distance']}\n")
    rng = np.random.default_rng(8)
    q, p = readings(machine, rng, 3), drawn(machine, rng)
    c = named(machine, p)
    predictor = Predictor(machine, record(machine, q, from_row=np.zeros(3, dtype=int)))
    _, values, _, world = predictor.columns(p, predictor.assemble(p)[0])
    source = np.array([c["beam.x"], c["beam.y"], c["beam.z"]])
    light = lie.rpy_matrix(np.array([c["beam.rx"], 0, 0]))[:, 2]
    lengths = []
    for pose in world:
        plane = (
            pose[:3, :3]
            @ lie.rpy_matrix(np.array([c["mirror.rx"], 0, 0]))
            @ lie.rpy_matrix(np.array([0, c["mirror.ry"], 0]))
        )
        centre = pose[:3, 3] + pose[:3, 2] * c["mirror.z"]
        spans = np.column_stack([light, -plane[:, 0], -plane[:, 1]])
        lengths.append(np.linalg.solve(spans, centre - source)[0])
    np.testing.assert_allclose(values[:, 0], np.array(lengths) - lengths[0], atol=1e-8)


# -- changes from an earlier row -----------------------------------------------------------------------


def test_changes_need_the_row_they_start_from(tmp_path: Path) -> None:
    machine = written(tmp_path, MOVERS + f"sensor: {SENSORS['distance']}\n")
    path = tmp_path / "r.csv"
    path.write_text(",".join([*machine.mechanism.readings, "dL"]) + "\n" + "0,0,0,0,0,0,0\n")
    with pytest.raises(InputError, match=r"r\.csv.*'?from'?"):
        load_recording(machine, [path])
    assert len(load_recording(machine, [path], need_observations=False)) == 1


def test_a_change_from_a_row_that_is_gone_is_refused(tmp_path: Path) -> None:
    """A subset keeps meaning the same rows, and says so when one of them is not there."""
    machine = written(tmp_path, MOVERS + f"sensor: {SENSORS['distance']}\n")
    q = readings(machine, np.random.default_rng(13), 4)
    recording = record(machine, q, {"dL": np.zeros(4)}, from_row=np.array([0, 0, 1, 1]))
    p = np.array(list(nominal(machine).values()))

    def changes(rows: list[int]) -> Array:
        predictor = Predictor(machine, recording.subset(rows))
        return predictor.columns(p, predictor.assemble(p)[0])[1][:, 0]

    np.testing.assert_allclose(changes([3, 1, 0, 2]), changes([0, 1, 2, 3])[[3, 1, 0, 2]])
    with pytest.raises(InputError, match=r"f\.csv: row 4.*'from'"):
        changes([0, 3])
