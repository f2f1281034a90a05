"""Columns that residuals may follow: their titles, units and values, and which components share an axis."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from support.effect_machines import STAGE
from support.moving_machines import record, written
from support.reports import recorded
from truepose.identification.report.drivers import (
    column_of,
    columns,
    component_groups,
    joint_column,
    order_column,
    reading_unit,
)
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import Channel


@pytest.mark.parametrize(
    ("driver", "title"),
    [
        ("temperature.base", "temperature.base [°C]"),
        ("payload", "payload [kg]"),
        ("approach.q1", "approach.q1 [±1]"),
        ("fan", "fan [as recorded]"),
        ("row", "rows before the last [1]"),
    ],
)
def test_what_was_logged_has_its_unit(machine: Machine, driver: str, title: str) -> None:
    values = np.linspace(-1.0, 1.0, 30)
    recording = replace(recorded(machine), drivers={driver: values})
    column = column_of(machine, recording, driver)
    assert column is not None and (column.name, column.title) == (driver, title)
    np.testing.assert_array_equal(column.values, values)


def test_a_joint_is_told_in_degrees_and_a_slide_as_it_is(machine: Machine, tmp_path: Path) -> None:
    recording = recorded(machine)
    joint = column_of(machine, recording, "q2")
    assert joint is not None and joint.title == "q2 [°]"
    np.testing.assert_allclose(joint.values, recording.q[:, 1] * 180.0 / np.pi)
    assert column_of(machine, recording, "no-such-column") is None
    stage = written(tmp_path, STAGE)
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (5, 3))
    slide = joint_column(stage, record(stage, q), "s2")
    assert slide.title == "s2 [mm]"
    np.testing.assert_array_equal(slide.values, q[:, 1])
    assert reading_unit(stage, "s1") == (1.0, "mm")
    factor, unit = reading_unit(stage, "s3")
    assert factor == pytest.approx(180.0 / np.pi) and unit == "°"


def test_a_column_that_stands_still_is_not_looked_at(machine: Machine) -> None:
    recording = recorded(machine)
    q = recording.q.copy()
    q[:, 0] = 0.3
    names = [one.name for one in columns(machine, replace(recording, q=q))]
    assert names == ["q2", "temperature.base", "order"]


@pytest.mark.parametrize("extra", [8, 9, 10])
def test_eleven_columns_are_kept_beside_the_order_in_their_own_order(machine: Machine, extra: int) -> None:
    """Two joints and nine others fill the page; those asked for go before the others."""
    recording = recorded(machine)
    logged = {f"temperature.t{k:02d}": recording.q[:, 0] + k for k in range(extra)}
    own = replace(recording, drivers=logged)
    names = [one.name for one in columns(machine, own)]
    assert names == ["q1", "q2", *list(logged)[:9], "order"]
    last = list(logged)[-1]
    asked = [one.name for one in columns(machine, own, [last])]
    assert asked == ["q1", "q2", *list(logged)[: min(extra - 1, 8)], last, "order"]


def test_rows_are_counted_from_one(machine: Machine) -> None:
    recording = recorded(machine, 7)
    assert order_column(recording).values.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]


def test_components_share_a_panel_by_their_axis_six_panels_at_most() -> None:
    def named(*names: str) -> list[Channel]:
        return [cast(Channel, cast(Any, SimpleNamespace(name=name))) for name in names]

    assert component_groups(named("P1.x", "P1.y", "P2.x", "P2.y", "length")) == {
        "x": [0, 2], "y": [1, 3], "length": [4],
    }  # fmt: skip
    assert component_groups(named("a.b.x", "x")) == {"x": [0, 1]}
    assert list(component_groups(named(*"abcdefgh"))) == list("abcdef")
