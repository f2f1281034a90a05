"""Planned measurement poses: no step back, poses that a machine can take, known optima, their tables, refusals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from support import MACHINES
from support.command import input_error
from support.examples import by_day
from support.graph_machines import machine_of
from support.plans import NAMES, poses, written
from truepose.arrays import Array
from truepose.identification.fit.problem import prior_of
from truepose.identification.leaves.planning.climb import Landscape, climb
from truepose.identification.leaves.planning.criterion import log_det
from truepose.identification.leaves.planning.discriminate.experiment import Experiment
from truepose.identification.leaves.planning.discriminate.rows import Rows
from truepose.identification.leaves.planning.exchange import Pool, exchange
from truepose.identification.leaves.planning.information import PoseInformation
from truepose.identification.leaves.planning.plan import plan
from truepose.identification.leaves.planning.showing import BETWEEN, experiment_table, plan_table
from truepose.identification.prediction.predict import simulate
from truepose.identification.recording.load import load_recording
from truepose.models.file.driver import SESSION, TIME
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.sensors.pose import Position

RULER = """
schema: truepose/machine/1
name: ruler
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, range: [-40, 100]}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0, angle: 0, q1.r: 0.5}
effects:
  - {effect: actuator-scale, place: [q1], parameters: {s: 0}}
"""


@dataclass(frozen=True)
class Grouped(Position):
    """A position sensor whose readings mean something only in groups of rows."""

    type = "grouped"
    label_columns = ("group",)


def test_sensors_that_group_rows_are_refused() -> None:
    machine = machine_of("serial")
    with input_error("'grouped': its readings depend on how several rows are grouped"):
        plan(replace(machine, sensors=(Grouped(0.01),)), 5)


@pytest.mark.parametrize("name", ["serial", "distance"])
def test_exchange_ends_where_no_pose_added_and_another_eliminated_gains(name: str) -> None:
    """Against decompositions of the whole information for every candidate; never below its start."""
    information = PoseInformation(machine_of(name))
    signature = information.at(poses(information, 60)).signature
    start = list(range(14))

    def value(design: list[int]) -> float:
        return log_det(information.rows(signature[design]), information.weight)

    found = exchange(Pool.of(signature, information), start)
    assert len(found) == len(start) and value(found) > value(start)
    added = max(([*found, c] for c in range(60) if c not in found), key=value)
    swapped = max((added[:k] + added[k + 1 :] for k in range(len(added))), key=value)
    assert value(swapped) <= value(found) + 2e-6 * abs(value(found))


@pytest.mark.parametrize("name", by_day(NAMES, "serial", "distance"))
def test_each_step_of_a_plan_is_no_worse_than_the_one_before(name: str) -> None:
    found = plan(machine_of(name), 14)
    assert found.by_exchange is not None
    assert found.by_exchange >= np.max(found.random)
    # joints are rounded to 1e-6 of their range after the last step
    assert found.value >= found.by_exchange - 1e-6 * abs(found.by_exchange)
    assert found.shrinkage is not None and found.shrinkage < 0.9


def test_continuous_poses_are_stationary_inside_the_ranges() -> None:
    """No pose can be moved, as far as its ranges allow, with a gain worth the optimiser's time."""
    function = Landscape(PoseInformation(machine_of("serial")))
    information = function.information
    q = climb(function, poses(information, 10))
    _, gradient = function.gradient(information.at(q))
    span = information.high - information.low
    inward = np.where(
        q <= information.low,
        np.maximum(gradient, 0),
        np.where(q >= information.high, np.minimum(gradient, 0), gradient),
    )
    start = function.gradient(information.at(poses(information, 10)))[1]
    assert np.max(np.abs(inward * span)) < 1e-3 * np.max(np.abs(start * span))


def test_a_ruler_is_calibrated_at_its_ends(tmp_path: Path) -> None:
    """A straight line, offset and scale: half of the poses at either end, as is well known."""
    found = plan(load_machine(written(tmp_path, RULER)), 6)
    assert sorted(found.q[:, 0]) == [-40.0] * 3 + [100.0] * 3
    # log det of the line's information, one reading of three (x and y see nothing), priors of r and s
    design = np.column_stack([np.full(6, 0.5), [-40, -40, -40, 100, 100, 100]]) / 0.01
    scale = prior_of(found.machine, found.machine.effects)
    design[:, 1] *= scale.scale[scale.free][1]
    weight = (scale.scale / np.where(scale.sigma > 0, scale.sigma, 1.0))[scale.free]
    assert found.value == pytest.approx(
        np.linalg.slogdet(design.T @ design + np.diag(weight**2))[1], rel=1e-9
    )


@pytest.mark.parametrize("method", ["continuous", "exchange", "random"])
@pytest.mark.parametrize("name", by_day(NAMES, "serial", "distance"))
def test_plans_are_reproducible_and_can_be_measured(name: str, method: str, tmp_path: Path) -> None:
    """The same from the same seed, inside the ranges, and a recording of them can be simulated."""
    machine = machine_of(name)
    found, again, other = (plan(machine, 10, method=method, seed=seed) for seed in (3, 3, 4))
    assert found.q.tobytes() == again.q.tobytes() and found.value == again.value
    assert not np.array_equal(found.q, other.q)
    ranges = np.array([actuator.range for actuator in machine.mechanism.actuators], dtype=float)
    assert (found.q >= ranges[:, 0]).all() and (found.q <= ranges[:, 1]).all()
    table = plan_table(found)
    table.to_csv(tmp_path / "poses.csv", index=False)
    recording = load_recording(machine, [tmp_path / "poses.csv"], need_observations=False)
    assert np.max(np.abs(recording.q - found.q) / (ranges[:, 1] - ranges[:, 0])) < 1e-11
    assert len(simulate(machine, recording)) == 10
    assert ("from" in table) == (name == "distance")


def test_repeats_share_a_pose_number(tmp_path: Path) -> None:
    found = plan(load_machine(written(tmp_path, RULER)), 4)
    table = plan_table(found)
    assert table["pose"].nunique() == 2 and found.repeats(0.01) == 2
    assert table.groupby("pose")["q1"].nunique().max() == 1


def test_poses_that_cannot_be_assembled_are_never_planned(tmp_path: Path) -> None:
    """Legs that reach far beyond what the loops allow."""
    text = (MACHINES / "ups.yaml").read_text().replace("range: [-8, 8]", "range: [-40, 40]")
    machine = load_machine(written(tmp_path, text))
    information = PoseInformation(machine)
    assert not information.at(poses(information, 200)).good.all()
    found = plan(machine, 8)
    assert information.at(found.q).good.all() and np.isfinite(found.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (RULER.replace(", range: [-40, 100]", ""), "joint 'q1': found no range"),
        (RULER.replace(", q1.r: 0.5", "").split("effects:", maxsplit=1)[0], "found no free parameter"),
    ],
)
def test_machines_without_ranges_or_unknowns_are_refused(text: str, says: str, tmp_path: Path) -> None:
    with input_error(says=says):
        plan(load_machine(written(tmp_path, text)), 5)


Q = np.array([[0.5, 10.0], [1.0, 20.0], [0.5, 10.0], [0.5, 20.0]])


def machine(*declared: Any) -> Machine:
    """Of a joint that turns, in the file in degrees, and one that slides, in the file in cm."""
    actuators = [
        SimpleNamespace(reading="q1", reading_unit="rad"),
        SimpleNamespace(reading="q2", reading_unit="mm"),
    ]
    units = {a.reading: a.reading_unit for a in actuators}
    own = {driver.name: driver for driver in declared}
    made = SimpleNamespace(
        mechanism=SimpleNamespace(actuators=actuators, reading_units=units),
        column_unit={"q1": "deg", "q2": "cm"}.__getitem__,
        declared=own.get,
    )
    return cast(Machine, made)


def experiment(
    drivers: dict[str, Array], reference: Array | None = None, *declared: Any, q: Array = Q
) -> Experiment:
    made = SimpleNamespace(rows=Rows(q, drivers), machine=machine(*declared), reference=reference)
    return cast(Experiment, made)


@pytest.mark.parametrize(
    ("name", "apart"),
    [("payload", True), ("temperature.air", True), (SESSION, True), ("approach.q1", False), (TIME, False)],
)
def test_repeats_differ_by_nothing_but_the_side_of_approach_and_the_time(name: str, apart: bool) -> None:
    same = np.tile(Q[0], (3, 1))
    table = experiment_table(experiment({name: np.array([1.0, 2.0, 2.0])}, q=same))
    assert table["pose"].tolist() == ([1, 2, 2] if apart else [1, 1, 1])


def test_rows_that_are_due_at_once_come_one_after_the_other() -> None:
    table = experiment_table(experiment({TIME: np.array([0.0, 0.0, 0.0, 600.0])}))
    assert table["time"].tolist() == [0.0, BETWEEN, 2 * BETWEEN, 600.0] and BETWEEN == 30.0
    both = experiment_table(experiment({TIME: np.zeros(4), SESSION: np.array([1.0, 1.0, 2.0, 2.0])}))
    assert list(both) == ["pose", "session", "time", "q1", "q2"]
    assert both["session"].dtype == np.int64 and both["session"].tolist() == [1, 1, 2, 2]


def test_drivers_are_in_the_units_that_the_file_declares() -> None:
    """A load of a joint goes with the units of its joint; what has no unit stays as it is."""
    oil = SimpleNamespace(name="oil", unit="degC", written="degF")
    values = np.array([20.0, 100.0, 20.0, 0.0])
    table = experiment_table(experiment({"oil": values, "fan": values}, None, oil))
    np.testing.assert_allclose(table["oil"], 1.8 * values + 32.0)
    assert table["fan"].tolist() == values.tolist()
    assert list(table)[-2:] == ["oil", "fan"]
