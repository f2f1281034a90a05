"""Planned poses as rows of a file: numbers of poses, what a change counts from, units of the file, time and sessions."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from truepose.arrays import Array
from truepose.identification.leaves.planning.discriminate.experiment import Experiment
from truepose.identification.leaves.planning.discriminate.race import Rows
from truepose.identification.leaves.planning.showing import BETWEEN, experiment_table
from truepose.models.file.driver import SESSION, TIME
from truepose.models.machine.machine import Machine

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
