"""Sockets and ball bars as sensors: derivatives, together with others, in a diagnosis, in commands and files.

Recordings come from a plain numpy arm, which shares no code with the package."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from support.socket_arm import (
    BAR,
    POSITION,
    SOCKET,
    arm,
    as_built,
    ball_at,
    machine_of,
    nominal,
    read,
    residuals,
    table,
)
from truepose.errors import InputError
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import predict
from truepose.identification.prediction.predictor import Predictor
from truepose.models.load import load_machine

Array = NDArray[np.float64]


def slopes(function: Callable[[Array], Array], p: Array, steps: Array) -> Array:
    """Derivative (..., np) by central differences of fourth order, whose error is that of rounding."""
    columns = []
    for k, h in enumerate(steps):
        e = np.zeros(len(p))
        e[k] = h
        near, far = function(p + e) - function(p - e), function(p + 2 * e) - function(p - 2 * e)
        columns.append((8 * near - far) / (12 * h))
    return np.stack(columns, axis=-1)


# -- derivatives ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sensors", [(SOCKET,), (BAR,), (SOCKET, BAR, POSITION)], ids=["socket", "bar", "all"]
)
def test_jacobians_are_those_of_the_residuals(tmp_path: Path, sensors: Sequence[str]) -> None:
    rng = np.random.default_rng(3)
    machine = machine_of(tmp_path, *sensors)
    frame = table(rng, nominal(), np.array([5.0, -10.0, 80.0]), 3)
    frame[["x", "y", "z"]] = rng.uniform(-500, 500, (len(frame), 3))
    frame["bar.length"] = 300.0
    predictor = Predictor(machine, read(tmp_path, machine, frame))
    unit = np.array([1.0 if p.unit == "mm" else 1e-3 for p in machine.parameters])
    p = predictor.model.p_home + rng.standard_normal(len(unit)) * unit
    weight = rng.uniform(0.2, 1.0, len(frame)) * (rng.random(len(frame)) > 0.2)
    x, _ = predictor.assemble(p)
    exact = np.concatenate([block.jacobian for block in predictor.blocks(p, x, weight)])
    differences = slopes(lambda v: residuals(predictor, v, weight), p, 1e-1 * unit)
    # residuals of 1e4 sigma lose 1e-16 of it to rounding, divided by steps of 1e-4 rad; some columns are not seen
    scale = np.max(np.abs(exact), axis=(0, 1))
    scale = np.maximum(scale, 1e-3 * np.max(scale))
    np.testing.assert_allclose(differences / scale, exact / scale, atol=1e-7)


def test_a_bar_reads_the_distance_of_its_balls(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    machine = machine_of(tmp_path, BAR)
    q = rng.uniform(-2, 2, (12, 6))
    frame = pd.DataFrame(np.degrees(q), columns=[f"q{k}" for k in range(1, 7)])
    frame["bar.length [um]"] = 0.0
    found = predict(machine, read(tmp_path, machine, frame))
    at = ball_at(q, nominal(), np.array([0.0, 20.0, 60.0]))
    expected = np.linalg.norm(at - [400, 100, 50], axis=1)
    np.testing.assert_allclose(found["bar.length"], expected, rtol=1e-12)
    names = [p.name for p in machine.sensors[0].parameters]
    assert names == [f"bar.{end}.{axis}" for end in ("centre", "ball") for axis in "xyz"]
    assert [p.tolerance for p in machine.sensors[0].parameters] == [2, 2, 2, 1, 1, 0.5]
    alone = machine_of(tmp_path, BAR.replace("name: bar, ", ""))
    assert list(alone.sensors[0].columns) == ["length"]
    assert [p.name for p in alone.sensors[0].parameters] == [name.removeprefix("bar.") for name in names]


# -- several sensors, diagnosis ------------------------------------------------------------------------


def test_sockets_add_up_with_other_sensors(tmp_path: Path) -> None:
    rng = np.random.default_rng(29)
    rows, ball = as_built(rng), np.array([5.0, -10.0, 80.0])
    machine = machine_of(tmp_path, SOCKET, BAR, POSITION)
    frame = table(rng, rows, ball, 8)
    q = np.radians(frame[[f"q{k}" for k in range(1, 7)]].to_numpy())
    frame[["x", "y", "z"]] = arm(q, rows)[1] + 0.05 * rng.standard_normal((len(q), 3))
    tip = ball_at(q, rows, np.array([0.3, 20.5, 60.0]))
    frame["bar.length"] = np.linalg.norm(tip - [401, 99, 50.5], axis=1) + 0.02 * rng.standard_normal(len(q))
    recording = read(tmp_path, machine, frame)
    fit = estimate(machine, recording)
    at = {name: k for k, name in enumerate(fit.prior.names)}
    centre = [at[f"bar.centre.{axis}"] for axis in "xyz"]
    assert np.all(np.abs(fit.p[centre] - [401, 99, 50.5]) < 5 * fit.std[centre])
    assert np.all(fit.std[centre] < 0.3)
    assert fit.n_observations == 48 * 7 - 15
    assert 0.75 < fit.chi2_per_dof < 1.25  # 3 sigma of 280 degrees of freedom
    assert list(predict(machine, recording).columns[:2]) == ["bar.length", "bar.length.std"]
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    again = load_machine(tmp_path / "calibrated.yaml")
    np.testing.assert_allclose([p.nominal for p in again.parameters], fit.p, rtol=1e-12, atol=1e-15)


# -- commands and files --------------------------------------------------------------------------------


def test_labels_are_checked(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, SOCKET)
    frame = table(np.random.default_rng(1), nominal(), np.array([5.0, -10.0, 80.0]), 2)
    many = frame.assign(socket=np.arange(len(frame)) % 3)
    with pytest.raises(
        InputError, match=r"rows\.csv: column 'socket': found the sockets 0, 1, 2 of placement 'front'"
    ):
        estimate(machine, read(tmp_path, machine, many))
    empty = frame.assign(socket=frame["socket"].astype(str).where(frame.index != 3, ""))
    with pytest.raises(InputError, match=r"row 4 \(line 5\), column 'socket': found an empty cell"):
        read(tmp_path, machine, empty)


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (SOCKET.replace("60", "-60"), r"sensor\[0\]\.spacing"),
        (SOCKET.replace("sigma: {xyz: 0.05}, ", ""), r"sensor\[0\]\.sigma: missing field"),
        (SOCKET.replace("ball:", "bal:"), r"sensor\[0\]\.bal: unknown field; did you mean 'ball'"),
        (BAR.replace("[400, 100, 50]", "[400, 100]"), r"sensor\[0\]\.centre: expected 3 finite numbers"),
        (BAR.replace("distance:", "xyz:"), r"sensor\[0\]\.sigma\.xyz: unknown field"),
    ],
)
def test_fields_are_checked(tmp_path: Path, sensor: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        machine_of(tmp_path, sensor)


def test_two_balls_need_two_names(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"found parameter 'ball\.x' twice"):
        machine_of(tmp_path, SOCKET, BAR.replace("name: bar, ", ""))


@pytest.mark.nightly
def test_a_scale_is_found_in_sockets(tmp_path: Path) -> None:
    rng = np.random.default_rng(37)
    rows, ball = as_built(rng), np.array([5.0, -10.0, 80.0])
    machine = machine_of(tmp_path, SOCKET)
    frame = table(rng, rows, ball, 8)
    frame["q2"] /= 1 + 5e-3  # the joint turns more than its reading says
    found = diagnose(machine, read(tmp_path, machine, frame))
    assert found.verdict == "missing-physics"
    first = found.findings[0]
    members = {(first.effect, first.place), *((e.effect, e.place) for e in first.equivalents)}
    assert ("actuator-scale", ("q2",)) in members
